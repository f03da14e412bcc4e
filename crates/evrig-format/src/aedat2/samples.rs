//! Samples of frames and of the inertial unit in AEDAT 2.0.
//!
//! A pixel of a frame is read twice, after its reset and after the exposure; its brightness is the
//! difference. A sample of the inertial unit is seven words. As in AedatTools
//! (`ImportAedatDataVersion1or2`).

use crate::recording::RecordingNotes;
use evrig_core::frame::{Frame, FrameTiming, Samples};
use evrig_core::geometry::Size;
use evrig_core::imu::ImuSample;
use evrig_core::time::{Davis, Stamp};

/// The converter's bits are shifted to the upper end of 16, as libcaer does.
const ADC_SHIFT: u32 = 6;

/// Units of the inertial unit (InvenSense MPU-6150) in the ranges that jAER sets: 4 g, 500 deg/s.
const LSB_PER_G: f32 = 8192.0;
const LSB_PER_DEG_PER_S: f32 = 65.5;
const LSB_PER_DEG_C: f32 = 340.0;
const OFFSET_DEG_C: f32 = 35.0;

/// Words of a sample: acceleration, temperature, rotation.
const IMU_WORDS: usize = 7;

/// A frame under construction.
#[derive(Debug)]
pub(super) struct FrameSamples {
    size: Size,
    reset: Vec<Option<u16>>,
    signal: Vec<Option<u16>>,
    n_pairs: usize,
    n_signals: usize,
    /// The last reset and the first signal, µs.
    last_reset_us: i64,
    first_signal_us: Option<i64>,
}

impl FrameSamples {
    pub(super) fn new(size: Size) -> Self {
        let n = size.n_pixels();
        Self {
            size,
            reset: vec![None; n],
            signal: vec![None; n],
            n_pairs: 0,
            n_signals: 0,
            last_reset_us: 0,
            first_signal_us: None,
        }
    }

    /// Takes a reading of a pixel in the coordinates of images; gives the frame that it completes.
    pub(super) fn take(
        &mut self,
        (x, y): (u16, u16),
        address: u32,
        t_us: i64,
        notes: &mut RecordingNotes,
    ) -> Option<Frame<Davis>> {
        if !self.size.contains(x, y) {
            notes.leave_out("samples of frames off the sensor", 1);
            return None;
        }
        let (i, value) = (self.size.index(x, y), (address & 0x3ff) as u16);
        if address & 0x400 == 0 {
            if self.signal[i].is_some() {
                // The former frame has no reading of some pixels.
                self.abandon(notes);
            }
            self.reset[i] = Some(value);
            self.last_reset_us = t_us;
            return None;
        }
        if self.signal[i].replace(value).is_some() {
            self.abandon(notes);
            self.signal[i] = Some(value);
        }
        self.first_signal_us.get_or_insert(t_us);
        self.n_signals += 1;
        self.n_pairs += usize::from(self.reset[i].is_some());
        (self.n_pairs == self.size.n_pixels()).then(|| self.finish())
    }

    /// Counts a frame that stays incomplete.
    pub(super) fn abandon(&mut self, notes: &mut RecordingNotes) {
        if self.n_signals > 0 {
            notes.leave_out("frames without both readings of every pixel", 1);
        }
        *self = Self::new(self.size);
    }

    fn finish(&mut self) -> Frame<Davis> {
        let pairs = self.reset.iter().zip(&self.signal);
        let difference = |(reset, signal): (&Option<u16>, &Option<u16>)| {
            reset.unwrap_or(0).saturating_sub(signal.unwrap_or(0)) << ADC_SHIFT
        };
        let samples = Samples::U16(pairs.map(difference).collect());
        let end = self.first_signal_us.unwrap_or(self.last_reset_us);
        let start = self.last_reset_us;
        // With a rolling shutter the resets of the last rows come after the first signals.
        let exposure = (start <= end).then(|| [start, end].map(Stamp::from_micros));
        let stamp = Stamp::from_micros(exposure.map_or(end, |_| start + (end - start) / 2));
        let timing = FrameTiming { exposure, ..FrameTiming::from_stamp(stamp) };
        let frame = Frame::gray(timing, self.size, samples);
        *self = Self::new(self.size);
        frame
    }
}

/// A sample of the inertial unit under construction.
#[derive(Debug, Default)]
pub(super) struct ImuWords {
    words: Vec<i16>,
    t_us: i64,
}

impl ImuWords {
    /// Takes a word; gives the sample that it completes.
    pub(super) fn take(
        &mut self,
        address: u32,
        t_us: i64,
        notes: &mut RecordingNotes,
    ) -> Option<ImuSample> {
        let kind = ((address >> 28) & 7) as usize;
        if kind != self.words.len() {
            notes.leave_out("words of incomplete inertial samples", self.words.len() as u64);
            self.words.clear();
        }
        if kind != self.words.len() {
            notes.leave_out("words of incomplete inertial samples", 1);
            return None;
        }
        if kind == 0 {
            self.t_us = t_us;
        }
        self.words.push(((address >> 12) & 0xffff) as u16 as i16);
        if self.words.len() < IMU_WORDS {
            return None;
        }
        let words: Vec<f32> = std::mem::take(&mut self.words).into_iter().map(f32::from).collect();
        let axes = |from: usize, unit: f32| [0, 1, 2].map(|axis| words[from + axis] / unit);
        Some(ImuSample {
            stamp: Stamp::from_micros(self.t_us),
            temperature_c: words[3] / LSB_PER_DEG_C + OFFSET_DEG_C,
            acceleration_g: axes(0, LSB_PER_G),
            rotation_deg_per_s: axes(4, LSB_PER_DEG_PER_S),
            magnetic_ut: [0.0; 3],
        })
    }
}
