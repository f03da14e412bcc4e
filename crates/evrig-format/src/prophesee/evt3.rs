//! EVT 3.0: words of 16 bits that change one part of the next event's address or time.

use super::WordDecoder;
use crate::CameraEvents;
use evrig_core::event::Event;

pub(super) const ADDRESS_Y: u16 = 0x0;
pub(super) const ADDRESS_X: u16 = 0x2;
const VECTOR_BASE_X: u16 = 0x3;
const VECTOR_12: u16 = 0x4;
const VECTOR_8: u16 = 0x5;
pub(super) const TIME_LOW: u16 = 0x6;
pub(super) const TIME_HIGH: u16 = 0x8;
const TRIGGER: u16 = 0xa;

/// Bits of each half of the time, which wraps after 16.8 s.
const HALF_BITS: u32 = 12;

/// A step back of the lower half without a word for the upper one is its wrap. Cameras send that
/// word every 16 us; expelliarmus writes it once.
const MIN_LOW_WRAP: i64 = 1 << (HALF_BITS - 2);

/// Decodes EVT 3.0.
#[derive(Debug, Default)]
pub(crate) struct Evt3 {
    y: u16,
    base_x: u16,
    on: bool,
    low: i64,
    high: Option<i64>,
    n_wraps: i64,
    /// Whether the upper half came since the last lower one.
    is_high_new: bool,
}

impl Evt3 {
    fn t(&self) -> Option<i64> {
        let high = (self.n_wraps << HALF_BITS) + self.high?;
        Some((high << HALF_BITS) + self.low)
    }

    fn set_high(&mut self, high: i64) {
        // A step back of half the range is a wrap; a smaller one is a repeated word.
        self.n_wraps += i64::from(self.high.is_some_and(|last| last - high > 1 << (HALF_BITS - 1)));
        if self.high != Some(high) {
            self.low = 0;
        }
        (self.high, self.is_high_new) = (Some(high), true);
    }

    fn set_low(&mut self, low: i64) {
        if !self.is_high_new && self.low - low > MIN_LOW_WRAP {
            self.high = self.high.map(|high| high + 1);
        }
        (self.low, self.is_high_new) = (low, false);
    }

    fn vector(&mut self, valid: u16, n: u16, into: &mut CameraEvents) -> u64 {
        let columns = (0..n).filter(|bit| (valid >> bit) & 1 == 1);
        let n_lost = match self.t() {
            Some(t) => {
                columns.for_each(|bit| {
                    let x = self.base_x.saturating_add(bit);
                    into.events.push(Event { t, x, y: self.y, on: self.on });
                });
                0
            }
            None => columns.count() as u64,
        };
        self.base_x = self.base_x.saturating_add(n);
        n_lost
    }
}

impl WordDecoder for Evt3 {
    const BYTES: usize = 2;

    fn decode(&mut self, words: &[u8], into: &mut CameraEvents) {
        let mut n_before = 0;
        let mut n_triggers = 0;
        for pair in words.chunks_exact(2) {
            let word = u16::from_le_bytes([pair[0], pair[1]]);
            match word >> 12 {
                ADDRESS_Y => self.y = word & 0x7ff,
                ADDRESS_X => match self.t() {
                    Some(t) => {
                        let on = word & 0x800 != 0;
                        into.events.push(Event { t, x: word & 0x7ff, y: self.y, on });
                    }
                    None => n_before += 1,
                },
                VECTOR_BASE_X => (self.base_x, self.on) = (word & 0x7ff, word & 0x800 != 0),
                VECTOR_12 => n_before += self.vector(word & 0xfff, 12, into),
                VECTOR_8 => n_before += self.vector(word & 0xff, 8, into),
                TIME_LOW => self.set_low(i64::from(word & 0xfff)),
                TIME_HIGH => self.set_high(i64::from(word & 0xfff)),
                TRIGGER => n_triggers += 1,
                _ => {}
            }
        }
        into.leave_out("events before the first full time", n_before);
        into.leave_out("trigger edges", n_triggers);
    }
}
