//! Images of the rig's log with their metadata.

use super::reader::RigLogReader;
use super::{RigLogError, Topic, image};
use evrig_core::frame::Samples;
use evrig_core::geometry::Size;
use evrig_core::pi_camera::FrameMetadata;
use evrig_core::time::{Stamp, Unix};
use std::collections::VecDeque;
use std::path::Path;

/// Images that may precede the metadata of one image.
const MAX_WAITING: usize = 8;

/// An image with its metadata, samples as stored: Bayer 16 bit, or R, G, B bytes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StoredImage {
    pub metadata: FrameMetadata,
    pub samples: Samples,
}

/// The images of one topic.
pub(crate) struct ImageReader {
    reader: RigLogReader,
    topic: Topic,
    waiting: VecDeque<(Stamp<Unix>, Size, Samples)>,
    n_without_metadata: u64,
}

impl ImageReader {
    /// Opens the log to read the images of `topic`, raw or RGB.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub(crate) fn open(path: &Path, topic: Topic) -> Result<Self, RigLogError> {
        let reader = RigLogReader::open(path, &[topic, Topic::FrameMetadata])?;
        Ok(Self { reader, topic, waiting: VecDeque::new(), n_without_metadata: 0 })
    }

    /// Images left out so far because they have no metadata.
    pub(crate) fn n_without_metadata(&self) -> u64 {
        self.n_without_metadata
    }

    fn image(&self, data: &[u8]) -> Result<(Size, Samples), RigLogError> {
        let malformed = |because: String| self.reader.malformed(self.topic, because);
        let image =
            image::decode(data).ok_or_else(|| malformed("not a foxglove.RawImage".into()))?;
        let (encoding, n_bytes) =
            if self.topic == Topic::Raw { ("mono16", 2) } else { ("rgb8", 3) };
        let side = |n: u32| u16::try_from(n).ok();
        let size = side(image.width).zip(side(image.height)).map(|(w, h)| Size::new(w, h));
        let fits = |size: &Size| image.data.len() == size.n_pixels() * n_bytes;
        let size = size.filter(fits).filter(|_| image.encoding == encoding).ok_or_else(|| {
            malformed(format!(
                "{} x {} `{}` in {} bytes; expected `{encoding}` of {n_bytes} bytes per pixel",
                image.width,
                image.height,
                image.encoding,
                image.data.len(),
            ))
        })?;
        let samples = if self.topic == Topic::Raw {
            let pairs = image.data.chunks_exact(2);
            Samples::U16(pairs.map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect())
        } else {
            Samples::U8(image.data)
        };
        Ok((size, samples))
    }

    /// The waiting image of `metadata`; those before it have no metadata.
    fn explained(&mut self, metadata: FrameMetadata) -> Option<StoredImage> {
        let is_meant = |(at, size, _): &(Stamp<Unix>, Size, Samples)| {
            *at == metadata.real_time && *size == metadata.size
        };
        let place = self.waiting.iter().position(is_meant)?;
        self.n_without_metadata += place as u64;
        self.waiting.drain(..place);
        let (_, _, samples) = self.waiting.pop_front()?;
        Some(StoredImage { metadata, samples })
    }
}

impl Iterator for ImageReader {
    type Item = Result<StoredImage, RigLogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let message = match self.reader.next() {
                Some(Ok(message)) => message,
                Some(Err(error)) => return Some(Err(error)),
                None => {
                    self.n_without_metadata += self.waiting.len() as u64;
                    self.waiting.clear();
                    return None;
                }
            };
            if message.topic == self.topic {
                match self.image(&message.data) {
                    Ok((size, samples)) => {
                        self.waiting.push_back((message.published, size, samples));
                    }
                    Err(error) => return Some(Err(error)),
                }
                if self.waiting.len() > MAX_WAITING {
                    self.waiting.pop_front();
                    self.n_without_metadata += 1;
                }
                continue;
            }
            let metadata: FrameMetadata = match serde_json::from_slice(&message.data) {
                Ok(metadata) => metadata,
                Err(error) => {
                    return Some(Err(self.reader.malformed(message.topic, error.to_string())));
                }
            };
            if let Some(image) = self.explained(metadata) {
                return Some(Ok(image));
            }
        }
    }
}
