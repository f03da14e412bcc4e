//! Sums over what is recorded: any bit that changes, and any two things that change places, change
//! them; where a stream is cut into packets does not.

use evrig_core::event::EventSlice;
use std::hash::Hasher;
use twox_hash::XxHash3_64;

/// Values turned into bytes at once.
const AT_ONCE: usize = 1024;

/// A sum over the columns of a stream of events.
#[derive(Default)]
pub struct EventChecksum([XxHash3_64; 4]);

impl EventChecksum {
    /// Goes on by some events.
    pub fn take(&mut self, events: EventSlice<'_>) {
        let [t, x, y, on] = &mut self.0;
        columns(t, events.t, i64::to_le_bytes);
        columns(x, events.x, u16::to_le_bytes);
        columns(y, events.y, u16::to_le_bytes);
        columns(on, events.on, |on| [u8::from(on)]);
    }

    /// The sum so far.
    #[must_use]
    pub fn value(&self) -> u64 {
        self.0.iter().fold(0, |sum, column| sum.rotate_left(16) ^ column.finish())
    }
}

fn columns<T: Copy, const N: usize>(
    hasher: &mut XxHash3_64,
    values: &[T],
    bytes_of: impl Fn(T) -> [u8; N],
) {
    let mut bytes = [[0_u8; N]; AT_ONCE];
    for run in values.chunks(AT_ONCE) {
        for (bytes, value) in bytes.iter_mut().zip(run) {
            *bytes = bytes_of(*value);
        }
        hasher.write(bytes[..run.len()].as_flattened());
    }
}

/// A sum over the bytes of pictures, one after another.
#[derive(Default)]
pub struct PictureChecksum(XxHash3_64);

impl PictureChecksum {
    /// Goes on by a picture.
    pub fn take(&mut self, bytes: &[u8]) {
        self.0.write(bytes);
    }

    /// The sum so far.
    #[must_use]
    pub fn value(&self) -> u64 {
        self.0.finish()
    }
}

impl std::fmt::Debug for EventChecksum {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "EventChecksum({:016x})", self.value())
    }
}

impl std::fmt::Debug for PictureChecksum {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PictureChecksum({:016x})", self.value())
    }
}
