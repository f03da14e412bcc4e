//! The simulated Pi camera on the agent's side of the wire.

use super::world;
use crate::format::raw10::{self, Raw10Error};
use crate::frame::Samples;
use crate::geometry::Size;
use crate::session::{FrameMetadata, PiFrame};

/// What the simulated camera calls itself.
pub const MODEL: &str = "simulated imx708";

/// A request of `size` as the agent hands it over: raw samples packed, colours in the order R, G, B.
///
/// # Errors
/// When the rows cannot be packed: RAW10 has rows of a multiple of four samples.
pub fn delivered(frame: world::PiFrame, size: Size) -> Result<PiFrame, Raw10Error> {
    let said = frame.metadata;
    let raw10 = match &frame.raw {
        Some(raw) => match &raw.samples {
            Samples::U16(samples) => Some(raw10::pack(samples, size)?),
            Samples::U8(_) => None,
        },
        None => None,
    };
    let rgb = frame.rgb.map(|rgb| match rgb.samples {
        Samples::U8(mut samples) => {
            samples.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
            samples
        }
        Samples::U16(_) => Vec::new(),
    });
    let black_level = said.black_level_dn.round() as u16;
    let metadata = FrameMetadata {
        sequence: said.sequence,
        sensor_timestamp: said.sensor_timestamp,
        frame_wall_clock: Some(said.frame_wall_clock),
        real_time: said.real_time,
        exposure: said.exposure,
        analogue_gain: said.analogue_gain,
        digital_gain: 1.0,
        lens_position: None,
        black_levels: [black_level; 4],
        size,
        bayer: "RGGB".to_owned(),
        n_dropped: 0,
    };
    Ok(PiFrame { metadata, raw10, rgb })
}
