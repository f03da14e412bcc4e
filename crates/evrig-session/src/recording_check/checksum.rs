//! Order-dependent checksums of what is recorded: any changed bit and any two swapped values change
//! them; the division into packets does not.

use evrig_core::event::EventSlice;
use std::hash::Hasher;
use twox_hash::XxHash3_64;

/// Values converted at once.
const VALUES_PER_BLOCK: usize = 1024;

/// A checksum of the columns of a stream of events.
#[derive(Default)]
pub struct EventChecksum([XxHash3_64; 4]);

impl EventChecksum {
    /// Adds events.
    pub fn take(&mut self, events: EventSlice<'_>) {
        let [t, x, y, on] = &mut self.0;
        columns(t, events.t, i64::to_le_bytes);
        columns(x, events.x, u16::to_le_bytes);
        columns(y, events.y, u16::to_le_bytes);
        columns(on, events.on, |on| [u8::from(on)]);
    }

    /// The checksum so far.
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
    let mut bytes = [[0_u8; N]; VALUES_PER_BLOCK];
    for run in values.chunks(VALUES_PER_BLOCK) {
        for (bytes, value) in bytes.iter_mut().zip(run) {
            *bytes = bytes_of(*value);
        }
        hasher.write(bytes[..run.len()].as_flattened());
    }
}

/// A checksum of the bytes of consecutive frames.
#[derive(Default)]
pub struct ImageChecksum(XxHash3_64);

impl ImageChecksum {
    /// Adds a frame.
    pub fn take(&mut self, bytes: &[u8]) {
        self.0.write(bytes);
    }

    /// The checksum so far.
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

impl std::fmt::Debug for ImageChecksum {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ImageChecksum({:016x})", self.value())
    }
}
