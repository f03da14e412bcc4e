//! A custom effect: the lamp's intensity is modulated, and events are simulated from it.
//!
//! ```sh
//! cargo run --example write_effect
//! ```
//! An effect that acts on the light needs no change of the library: it is a drive around a drive.
//! `CONTRIBUTING.md` states how to add one to the library, with a name, parameters and a diagnosis.

#![allow(clippy::print_stdout)]

use evrig::drive::{Drive, TimeGrid};
use evrig::frame::Luminance;
use evrig::generate::effect::{EffectSet, RecordingContext};
use evrig::generate::forward::{ForwardParameters, ForwardSimulator};
use evrig::generate::voltmeter::Coefficients;
use evrig::geometry::Size;
use evrig::scene::FramesDrive;
use std::error::Error;
use std::f64::consts::TAU;

/// Light that swings about its mean: `ln(1 + depth * sin(2 pi f t))` on top of the signal.
struct SwingingLamp<'a> {
    inner: &'a dyn Drive,
    hz: f64,
    depth: f64,
}

impl Drive for SwingingLamp<'_> {
    fn size(&self) -> Size {
        self.inner.size()
    }

    fn span_us(&self) -> [i64; 2] {
        self.inner.span_us()
    }

    fn white_dn(&self) -> f64 {
        self.inner.white_dn()
    }

    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        let is_known = self.inner.sample(place, grid, out);
        for (i, value) in out.iter_mut().enumerate() {
            let seconds = grid.at(i) as f64 * 1e-6;
            *value += (self.depth * (TAU * self.hz * seconds).sin()).ln_1p() as f32;
        }
        is_known
    }

    fn error(&self, place: [f64; 2]) -> f32 {
        self.inner.error(place)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    // A wall of one brightness for a second: without the effect nothing moves.
    let size = Size::new(16, 12);
    let frame = |t_us| Luminance { t_us, size, values: vec![120.0; size.n_pixels()] };
    let wall = FramesDrive::new(&[frame(0), frame(1_000_000)], 0.0, 0.0)?;
    let lamp = SwingingLamp { inner: &wall, hz: 5.0, depth: 0.3 };

    let parameters = ForwardParameters {
        k: Coefficients::DVS346,
        effects: EffectSet::default(),
        step_us: 1_000,
    };
    let forward = ForwardSimulator::new(parameters, RecordingContext::default())?;
    let pixels: Vec<(u16, u16)> = (0..12).flat_map(|y| (0..16).map(move |x| (x, y))).collect();
    for (name, drive) in [("steady", &wall as &dyn Drive), ("swinging", &lamp)] {
        let made = forward.run(drive, &pixels, drive.span_us(), 1)?;
        let events = made.events.as_slice();
        println!("{name}: {} events, {} On", events.len(), events.count_on());
    }
    Ok(())
}
