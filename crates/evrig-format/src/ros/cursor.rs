//! Fields of a message, one after another.

/// How a message is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RosWire {
    /// Packed, little-endian.
    Ros1,
    /// CDR: four bytes that name the byte order, then aligned fields.
    Cdr,
}

/// Bytes in front of a CDR message.
const CDR_HEADER_BYTES: usize = 4;

/// Reads fields.
pub(crate) struct MessageCursor<'a> {
    bytes: &'a [u8],
    at: usize,
    wire: RosWire,
    is_big_endian: bool,
}

impl<'a> MessageCursor<'a> {
    /// None for a representation other than plain CDR.
    pub(crate) fn new(wire: RosWire, bytes: &'a [u8]) -> Option<Self> {
        match wire {
            RosWire::Ros1 => Some(Self { bytes, at: 0, wire, is_big_endian: false }),
            RosWire::Cdr => {
                let (head, bytes) = bytes.split_at_checked(CDR_HEADER_BYTES)?;
                let is_plain = head[0] == 0 && head[1] <= 1;
                is_plain.then_some(Self { bytes, at: 0, wire, is_big_endian: head[1] == 0 })
            }
        }
    }

    pub(crate) fn n_left(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }

    fn field<const N: usize>(&mut self) -> Option<[u8; N]> {
        if self.wire == RosWire::Cdr {
            self.at = self.at.next_multiple_of(N);
        }
        let mut field: [u8; N] = self.take(N)?.try_into().ok()?;
        if self.is_big_endian {
            field.reverse();
        }
        Some(field)
    }

    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let found = self.bytes.get(self.at..self.at.checked_add(n)?)?;
        self.at += n;
        Some(found)
    }

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.field::<1>().map(|[byte]| byte)
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.field().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.field().map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        self.field().map(u64::from_le_bytes)
    }

    pub(crate) fn f64(&mut self) -> Option<f64> {
        self.field().map(f64::from_le_bytes)
    }

    /// x, y, z.
    pub(crate) fn vector(&mut self) -> Option<[f64; 3]> {
        Some([self.f64()?, self.f64()?, self.f64()?])
    }

    /// Bytes behind their number.
    pub(crate) fn bytes(&mut self) -> Option<&'a [u8]> {
        let n = self.u32()?;
        self.take(n as usize)
    }

    pub(crate) fn text(&mut self) -> Option<String> {
        let bytes = self.bytes()?;
        // CDR counts the zero at the end.
        let bytes = bytes.strip_suffix(b"\0").unwrap_or(bytes);
        Some(String::from_utf8_lossy(bytes).into_owned())
    }

    /// Seconds and nanoseconds.
    pub(crate) fn stamp_ns(&mut self) -> Option<i64> {
        let (seconds, nanos) = (self.u32()?, self.u32()?);
        let seconds = match self.wire {
            RosWire::Ros1 => i64::from(seconds),
            RosWire::Cdr => i64::from(seconds.cast_signed()),
        };
        Some(seconds * 1_000_000_000 + i64::from(nanos))
    }

    /// The stamp of a header in ns; the rest of it is passed over.
    pub(crate) fn header(&mut self) -> Option<i64> {
        if self.wire == RosWire::Ros1 {
            self.u32()?;
        }
        let stamp = self.stamp_ns()?;
        self.bytes()?;
        Some(stamp)
    }
}

/// Writes a message in little-endian CDR.
#[derive(Debug)]
pub(crate) struct CdrBuilder(Vec<u8>);

impl CdrBuilder {
    pub(crate) fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    pub(crate) fn field<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        let at = (self.0.len() - CDR_HEADER_BYTES).next_multiple_of(N);
        self.0.resize(CDR_HEADER_BYTES + at, 0);
        self.0.extend(bytes);
        self
    }

    pub(crate) fn text(&mut self, text: &str) -> &mut Self {
        self.field((text.len() as u32 + 1).to_le_bytes());
        self.0.extend(text.bytes());
        self.field([0])
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.field((bytes.len() as u32).to_le_bytes());
        self.0.extend(bytes);
        self
    }

    pub(crate) fn header(&mut self, stamp_ns: i64, frame: &str) -> &mut Self {
        let seconds = stamp_ns.div_euclid(1_000_000_000) as i32;
        let nanos = stamp_ns.rem_euclid(1_000_000_000) as u32;
        self.field(seconds.to_le_bytes()).field(nanos.to_le_bytes()).text(frame)
    }

    pub(crate) fn finish(self) -> Vec<u8> {
        self.0
    }
}
