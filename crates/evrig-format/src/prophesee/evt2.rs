//! EVT 2.0, one event per word of 32 bits, and EVT 2.1, up to 32 events per word of 64.

use super::WordDecoder;
use crate::CameraEvents;
use evrig_core::event::Event;

const OFF: u64 = 0x0;
const ON: u64 = 0x1;
const TIME_HIGH: u64 = 0x8;
const TRIGGER: u64 = 0xa;

/// Bits of a word's own time; the others are in the words of kind TIME_HIGH.
const LOW_BITS: u32 = 6;
const HIGH_BITS: u32 = 28;

/// The upper bits of the time, which wrap after 4.8 hours.
#[derive(Debug, Default)]
struct HighTime {
    high: i64,
    n_wraps: i64,
    is_known: bool,
}

impl HighTime {
    fn set(&mut self, high: i64) {
        self.n_wraps += i64::from(self.is_known && self.high - high > 1 << (HIGH_BITS - 1));
        (self.high, self.is_known) = (high, true);
    }

    fn at(&self, low: u64) -> i64 {
        (((self.n_wraps << HIGH_BITS) + self.high) << LOW_BITS) + low as i64
    }
}

/// Decodes EVT 2.0.
#[derive(Debug, Default)]
pub(crate) struct Evt2 {
    time: HighTime,
}

/// Decodes EVT 2.1.
#[derive(Debug, Default)]
pub(crate) struct Evt21 {
    time: HighTime,
}

fn word(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |bits, byte| (bits << 8) | u64::from(*byte))
}

impl WordDecoder for Evt2 {
    const BYTES: usize = 4;

    fn decode(&mut self, words: &[u8], into: &mut CameraEvents) {
        let mut n_before = 0;
        let mut n_triggers = 0;
        for bytes in words.chunks_exact(4) {
            let word = word(bytes);
            match word >> 28 {
                TIME_HIGH => self.time.set((word & 0xfff_ffff) as i64),
                kind @ (OFF | ON) if self.time.is_known => {
                    let t = self.time.at((word >> 22) & 0x3f);
                    let (x, y) = (((word >> 11) & 0x7ff) as u16, (word & 0x7ff) as u16);
                    into.events.push(Event { t, x, y, on: kind == ON });
                }
                OFF | ON => n_before += 1,
                TRIGGER => n_triggers += 1,
                _ => {}
            }
        }
        into.leave_out("events before the first full time", n_before);
        into.leave_out("trigger edges", n_triggers);
    }
}

impl WordDecoder for Evt21 {
    const BYTES: usize = 8;

    fn decode(&mut self, words: &[u8], into: &mut CameraEvents) {
        let mut n_before = 0;
        let mut n_triggers = 0;
        for bytes in words.chunks_exact(8) {
            let word = word(bytes);
            match word >> 60 {
                TIME_HIGH => self.time.set(((word >> 32) & 0xfff_ffff) as i64),
                kind @ (OFF | ON) if self.time.is_known => {
                    let t = self.time.at((word >> 54) & 0x3f);
                    let (x, y) = (((word >> 43) & 0x7ff) as u16, ((word >> 32) & 0x7ff) as u16);
                    let valid = word as u32;
                    let columns = (0..32_u16).filter(|bit| (valid >> bit) & 1 == 1);
                    columns.for_each(|bit| {
                        into.events.push(Event { t, x: x + bit, y, on: kind == ON });
                    });
                }
                OFF | ON => n_before += u64::from((word as u32).count_ones()),
                TRIGGER => n_triggers += 1,
                _ => {}
            }
        }
        into.leave_out("events before the first full time", n_before);
        into.leave_out("trigger edges", n_triggers);
    }
}
