//! Tag detection by the AprilTag library, on an image or a window of it.

use super::grey_image::{GreyImage, PixelWindow};
use apriltag::families::{
    Tag16h5, Tag25h9, Tag36h11, TagCircle21h7, TagCircle49h12, TagStandard41h12,
};
use apriltag::{Detector, Family, Image};

/// Supported tag families.
pub(super) const FAMILIES: [&str; 6] =
    ["tag36h11", "tag25h9", "tag16h5", "tagCircle21h7", "tagCircle49h12", "tagStandard41h12"];

/// Corrected bit errors: with one, tag36h11 still keeps a distance of nine to any other code.
const BITS_CORRECTED: usize = 1;
/// Standard deviation of the blur of the last attempt, pixels.
const LAST_LOOK_BLUR: f32 = 0.8;

#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct TagSearch {
    /// Corners of the requested tag, in the frame's pixels: bottom left, bottom right, top right,
    /// top left. None where it is in several places: which of them is the target is not known.
    pub(super) corners: Option<[[f64; 2]; 4]>,
    /// In how many places the requested tag is.
    pub(super) n_places: usize,
    /// Ids of other tags of the family.
    pub(super) others: Vec<usize>,
}

pub(super) struct TagDetector {
    detector: Detector,
    id: usize,
}

impl TagDetector {
    /// None when the library does not know the family or has no memory for it.
    pub(super) fn new(family: &str, id: u32) -> Option<Self> {
        let family: Family = match family {
            "tag36h11" => Tag36h11::default().into(),
            "tag25h9" => Tag25h9::default().into(),
            "tag16h5" => Tag16h5::default().into(),
            "tagCircle21h7" => TagCircle21h7::default().into(),
            "tagCircle49h12" => TagCircle49h12::default().into(),
            "tagStandard41h12" => TagStandard41h12::default().into(),
            _ => return None,
        };
        let builder = Detector::builder().add_family_bits(family, BITS_CORRECTED);
        let mut detector = builder.build().ok()?;
        detector.set_thread_number(1);
        Some(Self { detector, id: id as usize })
    }

    /// Searches a window; `decimation` halves (2.0) or keeps (1.0) the resolution of the edge
    /// search.
    pub(super) fn search(
        &mut self,
        grey: &GreyImage,
        window: PixelWindow,
        decimation: f32,
    ) -> TagSearch {
        let Some(image) = to_8_bits(grey, window) else { return TagSearch::default() };
        // A blurred and noisy tag is often found at half the resolution, or after smoothing.
        // Smoothing works in place, so it comes last.
        let mut best = TagSearch::default();
        for (decimation, blur) in [(decimation, 0.0), (2.0, 0.0), (decimation, LAST_LOOK_BLUR)] {
            self.detector.set_decimation(decimation);
            self.detector.set_sigma(blur);
            let search = self.detect(&image, grey, window);
            if search.n_places > 0 {
                return search;
            }
            if search.others.len() > best.others.len() {
                best = search;
            }
        }
        best
    }

    fn detect(&mut self, image: &Image, grey: &GreyImage, window: PixelWindow) -> TagSearch {
        let mut search = TagSearch::default();
        for detection in self.detector.detect(image) {
            if detection.id() != self.id {
                search.others.push(detection.id());
            } else {
                // The library merges detections that overlap.
                search.n_places += 1;
                let [dx, dy] = [window.x0 as f64, window.y0 as f64];
                let scale = grey.scale as f64;
                let corners = detection.corners();
                search.corners = Some(corners.map(|[x, y]| [(x + dx) * scale, (y + dy) * scale]));
            }
        }
        if search.n_places > 1 {
            search.corners = None;
        }
        search
    }
}

/// The window in 8 bits. Values in range are kept; others are scaled so that the brightest block
/// becomes 200. None without light, or if the library has no memory. (Pixel quantiles would not do:
/// a tag covers a hundredth of a frame.)
fn to_8_bits(grey: &GreyImage, window: PixelWindow) -> Option<Image> {
    let [_, paper] = grey.block_range(window);
    if !(paper.is_finite() && paper > 0.0) {
        return None;
    }
    let gain = if (100.0..=255.0).contains(&paper) { 1.0 } else { 200.0 / paper };
    let rows = (window.y0..window.y1).map(|y| &grey.values[y * grey.width..][window.x0..window.x1]);
    let (width, height) = (window.x1 - window.x0, window.y1 - window.y0);
    let mut image = Image::zeros_with_alignment(width, height, 96).ok()?;
    let stride = image.stride();
    for (row, bytes) in rows.zip(image.as_slice_mut().chunks_mut(stride)) {
        for (byte, value) in bytes.iter_mut().zip(row) {
            *byte = (value * gain).clamp(0.0, 255.0) as u8;
        }
    }
    Some(image)
}
