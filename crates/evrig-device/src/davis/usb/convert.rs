//! The camera's words to events, frames, inertial samples and triggers.

use evrig_core::event::{Event, Events};
use evrig_core::frame::{Frame, FrameTiming, Samples};
use evrig_core::geometry::Size;
use evrig_core::imu::{ImuSample, Trigger, TriggerKind};
use evrig_core::time::{Davis, Span, Stamp, Unix};
use evrig_format::aedat4::Content;
use neuromorphic_drivers::adapters::davis346::{Adapter, FrameEvent, ImuEvent};
use neuromorphic_drivers::types::{Polarity, PolarityEvent, TriggerEvent, TriggerPolarity};

/// m/s^2 in one g, as the driver takes it.
const STANDARD_GRAVITY: f32 = 9.80665;
/// The word with which the camera announces a reset of its clock.
const CLOCK_RESET: u16 = 1;

/// Turns packets into values; holds what one packet leaves unfinished for the next.
pub(super) struct Converter {
    adapter: Adapter,
    /// µs of Unix minus µs of the camera.
    offset_us: i64,
    /// Whether a stamp was seen.
    has_time: bool,
}

/// What one packet held.
#[derive(Debug, Default)]
pub(super) struct ConvertedBatch {
    pub(super) events: Events,
    pub(super) frames: Vec<Frame<Davis>>,
    pub(super) imu: Vec<ImuSample>,
    pub(super) triggers: Vec<Trigger>,
    /// How often the camera set its clock back.
    pub(super) n_resets: u64,
}

impl Converter {
    pub(super) fn new(adapter: Adapter) -> Self {
        Self { adapter, offset_us: 0, has_time: false }
    }

    /// Sets the offset so that the last stamp equals `arrived`; none before the first stamp.
    pub(super) fn set_clock(&mut self, arrived: Stamp<Unix>) -> Option<i64> {
        self.offset_us = arrived.as_micros() - self.adapter.current_t() as i64;
        self.has_time.then_some(self.offset_us)
    }

    /// Converts one packet; a last odd byte, which no camera sends, is left out.
    pub(super) fn take(&mut self, packet: &[u8]) -> ConvertedBatch {
        let ConvertedBatch { mut events, mut frames, mut imu, mut triggers, .. } =
            ConvertedBatch::default();
        let offset_us = self.offset_us;
        let stamp = |t: u64| Stamp::from_micros(t as i64 + offset_us);
        self.adapter.convert(
            packet,
            |event| events.push(polarity(event, offset_us)),
            |sample| imu.push(inertial(sample, offset_us)),
            |mark| triggers.push(trigger(mark, offset_us)),
            |image| frames.push(frame(&image, stamp)),
        );
        let words = packet.chunks_exact(2).map(|word| u16::from_le_bytes([word[0], word[1]]));
        let n_resets = words.clone().filter(|word| *word == CLOCK_RESET).count() as u64;
        self.has_time |= words.into_iter().any(|word| word >> 15 == 1);
        ConvertedBatch { events, frames, imu, triggers, n_resets }
    }
}

impl ConvertedBatch {
    /// Packets with the number of their stream: events, frames if there are any, inertial samples,
    /// triggers.
    pub(super) fn contents(self, has_frames: bool) -> impl Iterator<Item = (u32, Content)> {
        let behind = 1 + u32::from(has_frames);
        let events = (!self.events.is_empty()).then_some((0, Content::Events(self.events)));
        let frames = self.frames.into_iter().filter(move |_| has_frames);
        let frames = frames.map(|frame| (1, Content::Frame(frame)));
        let imu = (!self.imu.is_empty()).then_some((behind, Content::Imu(self.imu)));
        let triggers =
            (!self.triggers.is_empty()).then_some((behind + 1, Content::Triggers(self.triggers)));
        events.into_iter().chain(frames).chain(imu).chain(triggers)
    }
}

fn polarity(event: PolarityEvent<u64, u16, u16>, offset_us: i64) -> Event {
    let on = event.polarity == Polarity::On;
    Event { t: event.t as i64 + offset_us, x: event.x, y: event.y, on }
}

fn inertial(sample: ImuEvent, offset_us: i64) -> ImuSample {
    let ImuEvent { t, temperature, .. } = sample;
    let acceleration = [sample.accelerometer_x, sample.accelerometer_y, sample.accelerometer_z];
    let rotation = [sample.gyroscope_x, sample.gyroscope_y, sample.gyroscope_z];
    ImuSample {
        stamp: Stamp::from_micros(t as i64 + offset_us),
        temperature_c: temperature,
        acceleration_g: acceleration.map(|a| a / STANDARD_GRAVITY),
        rotation_deg_per_s: rotation.map(f32::to_degrees),
        magnetic_ut: [0.0; 3],
    }
}

fn trigger(mark: TriggerEvent<u64, u8>, offset_us: i64) -> Trigger {
    let kind = match mark.polarity {
        TriggerPolarity::Rising => TriggerKind::SignalRose,
        TriggerPolarity::Falling => TriggerKind::SignalFell,
        TriggerPolarity::Pulse => TriggerKind::SignalPulse,
    };
    Trigger { stamp: Stamp::from_micros(mark.t as i64 + offset_us), kind }
}

/// The driver shifts the converter's 10 bits up to 16; the upper 8 are kept, as DV does.
fn frame(image: &FrameEvent<'_>, stamp: impl Fn(u64) -> Stamp<Davis>) -> Frame<Davis> {
    let exposure = image.exposure_start_t.zip(image.exposure_end_t);
    Frame::gray(
        FrameTiming {
            stamp: stamp(exposure.map_or(image.start_t, |(start, _)| start)),
            exposure: exposure.map(|(start, end)| [stamp(start), stamp(end)]),
            readout: Some([stamp(image.start_t), stamp(image.t)]),
            row_time: Span::ZERO,
        },
        Size::DAVIS346,
        Samples::U8(image.pixels.iter().map(|sample| (sample >> 8) as u8).collect()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use neuromorphic_drivers::inivation_davis346::{ApsOrientation, ImuOrientation, ImuType};

    fn converter() -> Converter {
        let aps = ApsOrientation { flip_x: false, flip_y: false, invert_xy: false };
        let imu = ImuOrientation { flip_x: false, flip_y: false, flip_z: false };
        Converter::new(Adapter::new(false, aps, imu, ImuType::InvenSense9250))
    }

    const fn at(t: u16) -> u16 {
        0x8000 | t
    }
    const fn row(y: u16) -> u16 {
        0x1000 | y
    }
    const fn column(x: u16, on: bool) -> u16 {
        (if on { 0x3000 } else { 0x2000 }) | x
    }
    const WRAP: u16 = 0x7001;

    fn packet(words: &[u16]) -> Vec<u8> {
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    #[test]
    fn events_come_out_with_place_polarity_and_time_beyond_the_wrap() {
        let mut converter = converter();
        converter.take(&packet(&[at(500)]));
        let offset = converter.set_clock(Stamp::from_micros(1_700_000_000_000_000)).unwrap();
        assert_eq!(offset, 1_700_000_000_000_000 - 500);
        let words = [at(510), row(7), column(300, true), column(301, false), WRAP, at(3), row(259)];
        let mut batch = converter.take(&packet(&words));
        // The row holds into the next packet.
        let more = converter.take(&packet(&[column(345, true)]));
        batch.events.extend_from_slice(more.events.as_slice());
        let expected = [
            Event { t: offset + 510, x: 300, y: 7, on: true },
            Event { t: offset + 510, x: 301, y: 7, on: false },
            Event { t: offset + 0x8003, x: 345, y: 259, on: true },
        ];
        assert_eq!(batch.events, expected.into_iter().collect::<Events>());
    }

    #[test]
    fn before_the_first_stamp_there_is_no_clock() {
        let mut converter = converter();
        converter.take(&packet(&[row(3)]));
        assert_eq!(converter.set_clock(Stamp::from_micros(5)), None);
    }

    #[test]
    fn a_frame_is_reset_minus_signal_with_its_exposure() {
        let mut converter = converter();
        let mut words = vec![at(100), 8, at(110), 14];
        let column = |words: &mut Vec<u16>, code: u16, sample: &dyn Fn(u16) -> u16| {
            words.push(code);
            words.extend((0..260).map(|y| 0x4000 | sample(y)));
            words.push(13);
        };
        for _ in 0..346 {
            column(&mut words, 11, &|_| 900);
        }
        words.extend([at(4110), 15]);
        for x in 0..346_u16 {
            column(&mut words, 12, &|y| 900 - (x + y) % 512);
        }
        words.extend([at(9000), 10]);
        let batch = converter.take(&packet(&words));
        let [frame] = batch.frames.as_slice() else { panic!("one frame: {}", batch.frames.len()) };
        let us = |t: i64| Stamp::from_micros(t);
        assert_eq!(frame.timing.exposure, Some([us(110), us(4110)]));
        assert_eq!(frame.timing.readout, Some([us(100), us(9000)]));
        let Samples::U8(samples) = &frame.samples else { panic!("8 bits") };
        for (x, y) in [(0_usize, 0_usize), (345, 259), (17, 200)] {
            assert_eq!(usize::from(samples[y * 346 + x]), ((x + y) % 512) >> 2, "{x}, {y}");
        }
    }

    #[test]
    fn inertial_samples_are_in_g_and_degrees() {
        let mut converter = converter();
        // Accelerometer, gyroscope and temperature at 4 g and 500 deg/s; x at half of full scale.
        let head = [at(7), 5, 0x5300 | 0b1110_0000 | 0b0101];
        let bytes = [0x40, 0, 0, 0, 0xc0, 0, 0, 0, 0x20, 0, 0, 0, 0, 0];
        let words: Vec<u16> =
            head.into_iter().chain(bytes.map(|byte| 0x5000 | byte)).chain([7]).collect();
        let batch = converter.take(&packet(&words));
        let [sample] = batch.imu.as_slice() else { panic!("one sample: {:?}", batch.imu) };
        assert_eq!(sample.stamp, Stamp::from_micros(7));
        let near = |a: f32, b: f32| (a - b).abs() < 1e-3;
        assert!(near(sample.acceleration_g[0], 2.0) && near(sample.acceleration_g[2], -2.0));
        assert!(near(sample.rotation_deg_per_s[0], 125.0), "{sample:?}");
        assert!(near(sample.temperature_c, 21.0));
    }

    #[test]
    fn triggers_and_clock_resets_are_reported() {
        let mut converter = converter();
        let batch = converter.take(&packet(&[at(9), 3, 2, CLOCK_RESET]));
        let kinds: Vec<_> = batch.triggers.iter().map(|mark| mark.kind).collect();
        assert_eq!(kinds, [TriggerKind::SignalRose, TriggerKind::SignalFell]);
        assert_eq!(batch.n_resets, 1);
    }

    #[test]
    fn streams_are_numbered_as_they_are_declared_with_and_without_frames() {
        let words = [at(9), 3, row(1), column(2, true)];
        for (has_frames, expected) in [(true, [0, 3]), (false, [0, 2])] {
            let batch = converter().take(&packet(&words));
            let streams: Vec<u32> = batch.contents(has_frames).map(|(stream, _)| stream).collect();
            assert_eq!(streams, expected);
        }
    }

    #[test]
    fn any_bytes_give_values_and_never_a_panic() {
        let mut converter = converter();
        let mut state = 1_u32;
        for _ in 0..200 {
            let bytes: Vec<u8> = (0..4096)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 24) as u8
                })
                .collect();
            for event in converter.take(&bytes).events.as_slice().iter() {
                assert!(Size::DAVIS346.contains(event.x, event.y));
            }
        }
    }
}
