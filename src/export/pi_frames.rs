//! Frames of the Pi's camera in a recording, as NumPy arrays.

use super::npz::{Archive, ExportedArray};
use evrig_core::frame::{Channels, Samples};
use evrig_session::{Session, SessionError, StreamEntry};
use std::path::Path;

/// Writes `frames` (N, H, W) or (N, H, W, 3) with the colours R, G, B, `sensor_timestamp_ns`,
/// `real_time_us` (0 where it is not known), `exposure_start_ns` and `exposure_end_ns` of the first
/// row. The log is read twice: there may be more frames than memory.
pub(super) fn write(
    session: &Session,
    entry: &StreamEntry,
    out: &Path,
) -> Result<Vec<ExportedArray>, SessionError> {
    let mut stamps: Vec<[i64; 4]> = Vec::new();
    let mut form = None;
    for picture in session.pi_frames(&entry.name)? {
        let picture = picture?;
        let frame = &picture.frame;
        let this = (frame.size, frame.channels, frame.samples.bits());
        if *form.get_or_insert(this) != this {
            let what = format!("frame {} changes size or depth", stamps.len());
            return Err(SessionError::import(&session.root().join(&entry.file), what));
        }
        let stamp = frame.timing.stamp;
        let [start, end] = frame.timing.exposure.unwrap_or([stamp; 2]);
        let real = picture.properties.real_time.map_or(0, |stamp| stamp.as_micros());
        stamps.push([stamp.as_nanos(), real, start.as_nanos(), end.as_nanos()]);
    }
    let n = stamps.len() as u64;
    let mut archive = Archive::create(out)?;
    if let Some((size, channels, bits)) = form {
        let mut shape = vec![n, size.height.into(), size.width.into()];
        if channels == Channels::Bgr {
            shape.push(3);
        }
        let mut failure = None;
        let pictures = session.pi_frames(&entry.name)?;
        let pictures = pictures.map_while(|p| p.map_err(|error| failure = Some(error)).ok());
        if bits == 8 {
            let samples = pictures.flat_map(|picture| match picture.frame.samples {
                Samples::U8(bgr) if channels == Channels::Bgr => {
                    bgr.chunks_exact(3).flat_map(|pixel| [pixel[2], pixel[1], pixel[0]]).collect()
                }
                Samples::U8(samples) => samples,
                Samples::U16(_) => Vec::new(),
            });
            archive.add("frames", &shape, samples)?;
        } else {
            let samples = pictures.flat_map(|picture| match picture.frame.samples {
                Samples::U16(samples) => samples,
                Samples::U8(_) => Vec::new(),
            });
            archive.add("frames", &shape, samples)?;
        }
        if let Some(error) = failure {
            return Err(error);
        }
    }
    let names = ["sensor_timestamp_ns", "real_time_us", "exposure_start_ns", "exposure_end_ns"];
    for (i, name) in names.into_iter().enumerate() {
        archive.add(name, &[n], stamps.iter().map(|stamp| stamp[i]))?;
    }
    archive.finish()
}
