//! The twin of the Pi camera: raw Bayer frames, RGB frames and their metadata.

mod isp;
mod sensor;

use super::draws::{RandomPurpose, WorldRandom};
use super::scene::World;
use evrig_core::frame::{Channels, Frame, FrameTiming, Samples};
use evrig_core::time::{PiSensor, Span, Stamp, Unix};
use std::sync::Arc;

/// The frame camera in a world. It gives frame after frame, the same for whoever asks and however
/// many threads there are.
#[derive(Debug)]
pub struct PiTwin {
    world: Arc<World>,
    from: Span,
    period: Span,
    next: u64,
    sensor: sensor::RollingSensor,
    isp: isp::Isp,
}

/// One request of the camera: both frames come from the same exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedPiFrame {
    /// World time at which it is delivered.
    pub handed_over: Span,
    /// Bayer RGGB, ten bits right-justified; where the rig asks for it.
    pub raw: Option<Frame<PiSensor>>,
    /// Blue, green, red; where the rig asks for it.
    pub rgb: Option<Frame<PiSensor>>,
    /// Its metadata.
    pub metadata: SimulatedPiMetadata,
}

/// Metadata of a frame; the names are libcamera's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedPiMetadata {
    /// Number of the frame; a gap is a frame that was lost.
    pub sequence: u64,
    /// End of the exposure of the sensor's first row (not the crop's), whole microseconds.
    pub sensor_timestamp: Stamp<PiSensor>,
    /// The same instant on the Pi's wall clock.
    pub frame_wall_clock: Stamp<Unix>,
    /// The Pi's wall clock when the frame had been delivered.
    pub real_time: Stamp<Unix>,
    /// Exposure of a row as the camera states it.
    pub exposure: Span,
    /// From frame to frame.
    pub frame_duration: Span,
    /// As the rig states it.
    pub analogue_gain: f64,
    /// Pedestal as the rig states it, in DN.
    pub black_level_dn: f64,
}

impl PiTwin {
    /// The camera; its first frame's first row ends its exposure at world time `from`.
    #[must_use]
    pub fn new(world: Arc<World>, from: Span) -> Self {
        let period = Span::from_secs_f64(1.0 / world.rig.pi.camera.frame_rate.0);
        let (sensor, isp) = (sensor::RollingSensor::new(), isp::Isp::new(&world));
        Self { world, from, period, next: 0, sensor, isp }
    }

    /// World time of the next frame's SensorTimestamp.
    #[must_use]
    pub fn position(&self) -> Span {
        self.from + Span::from_nanos(self.period.as_nanos().saturating_mul(self.next as i64))
    }

    /// World time at which the exposure of a frame stamped `end` ends.
    #[must_use]
    pub fn seen_by(&self, end: Span) -> Span {
        let camera = &self.world.rig.pi.camera;
        let first_row = i64::from(self.world.description.pi.crop_origin_px[1]).max(0);
        let rows = first_row + i64::from(camera.size.height);
        let shutter = self.world.description.effects.rolling_shutter;
        let row_us = shutter.map_or(0.0, |shutter| shutter.row_us.abs());
        let row = camera.row_time.max(Span::from_secs_f64(row_us * 1e-6));
        end + Span::from_nanos(row.as_nanos() * rows)
    }

    /// The next frame that is not lost.
    pub fn next_frame(&mut self) -> SimulatedPiFrame {
        loop {
            let (number, end) = (self.next, self.position());
            self.next += 1;
            let mut draws =
                WorldRandom::new(self.world.seed, RandomPurpose::PiInterface, number, 0);
            // Not so often that nothing is left to wait for.
            let is_lost = draws.uniform() < self.world.description.pi.drop_fraction.min(0.999);
            if !is_lost {
                return self.frame(number, end, draws.exponential());
            }
        }
    }

    /// All frames whose SensorTimestamp lies before `until`.
    pub fn frames_until(&mut self, until: Span) -> Vec<SimulatedPiFrame> {
        let mut frames = Vec::new();
        while self.position() < until {
            frames.push(self.next_frame());
        }
        frames
    }

    fn frame(&mut self, sequence: u64, end: Span, delay: f64) -> SimulatedPiFrame {
        let world = &self.world;
        let (pi, sensor, clocks) = (&world.rig.pi, &world.description.pi, &world.clocks);
        let camera = &pi.camera;
        let scale = world.lamps().schedule.at(end).exposure_scale;
        let scaled = |span: Span| Span::from_secs_f64(span.as_secs_f64() * scale);
        let exposure = scaled(camera.exposure);
        let true_exposure = world
            .description
            .effects
            .exposure_blur
            .map_or(exposure, |blur| scaled(Span::from_secs_f64(blur.exposure_us * 1e-6)));
        let raw = self.sensor.expose(world, sequence, end, true_exposure, scale);
        let row_time = camera.row_time;
        let first_row = i64::from(sensor.crop_origin_px[1]);
        let n_rows = i64::from(camera.size.height) + 2 * first_row.max(0);
        let rows = |n: i64| Span::from_nanos(row_time.as_nanos() * n);
        let latency_us = sensor.latency_us + delay * sensor.latency_spread_us;
        let handed_over = end + rows(n_rows) + Span::from_secs_f64(latency_us * 1e-6);
        let stamp = clocks.pi_sensor(end);
        let first_end = stamp + rows(first_row);
        let timing = FrameTiming {
            stamp,
            exposure: Some([first_end - exposure, first_end]),
            readout: Some([first_end, first_end + rows(i64::from(camera.size.height))]),
            row_time,
        };
        let rgb = pi.rgb.then(|| self.isp.develop(&raw, camera.size));
        let frame = |channels, samples| Frame {
            timing,
            size: camera.size,
            origin: sensor.crop_origin_px,
            channels,
            samples,
        };
        SimulatedPiFrame {
            handed_over,
            raw: pi.raw.then(|| frame(Channels::Gray, Samples::U16(raw))),
            rgb: rgb.map(|rgb| frame(Channels::Bgr, Samples::U8(rgb))),
            metadata: SimulatedPiMetadata {
                sequence,
                sensor_timestamp: stamp,
                frame_wall_clock: clocks.pi_wall(end),
                real_time: clocks.pi_wall(handed_over),
                exposure,
                frame_duration: self.period,
                analogue_gain: camera.gain,
                black_level_dn: camera.black_level_dn,
            },
        }
    }
}
