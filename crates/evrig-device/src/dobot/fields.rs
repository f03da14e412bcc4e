//! Parameter bytes read field by field.

use super::id;

/// Parameters that do not fit their command.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// The parameters end too early.
    #[error(
        "command {} has {found} parameter bytes, too few for it: {needed} were needed",
        named(*id)
    )]
    Short {
        /// The command.
        id: u8,
        /// Bytes there.
        found: usize,
        /// Bytes up to the field that is missing.
        needed: usize,
    },
    /// A field holds a value that means nothing.
    #[error("command {}: expected {expected}, got {found}", named(*id))]
    Value {
        /// The command.
        id: u8,
        /// What is allowed.
        expected: &'static str,
        /// What was found.
        found: u8,
    },
}

/// `84 (PTP)`.
fn named(number: u8) -> String {
    format!("{number} ({})", id::name(number).unwrap_or("unknown"))
}

/// A reader of little-endian fields.
#[derive(Debug)]
pub struct PayloadFields<'a> {
    id: u8,
    params: &'a [u8],
    at: usize,
}

impl<'a> PayloadFields<'a> {
    /// Reads the parameters of command `id` from the front.
    #[must_use]
    pub const fn new(id: u8, params: &'a [u8]) -> Self {
        Self { id, params, at: 0 }
    }

    /// The command whose parameters these are.
    #[must_use]
    pub const fn id(&self) -> u8 {
        self.id
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        let rest = self.params.get(self.at..).unwrap_or_default();
        match rest.first_chunk::<N>() {
            Some(bytes) => {
                self.at += N;
                Ok(*bytes)
            }
            None => {
                let needed = self.at + N;
                Err(Malformed::Short { id: self.id, found: self.params.len(), needed })
            }
        }
    }

    /// The next byte.
    ///
    /// # Errors
    /// When there is none.
    pub fn byte(&mut self) -> Result<u8, Malformed> {
        self.take::<1>().map(|[byte]| byte)
    }

    /// The next u32.
    ///
    /// # Errors
    /// When fewer than four bytes are left.
    pub fn int(&mut self) -> Result<u32, Malformed> {
        self.take().map(u32::from_le_bytes)
    }

    /// The next u32, or `default` when fewer than four bytes are left.
    pub fn int_or(&mut self, default: u32) -> u32 {
        self.int().unwrap_or(default)
    }

    /// The next u64.
    ///
    /// # Errors
    /// When fewer than eight bytes are left.
    pub fn long(&mut self) -> Result<u64, Malformed> {
        self.take().map(u64::from_le_bytes)
    }

    /// The next float, or `default` when fewer than four bytes are left.
    pub fn float_or(&mut self, default: f32) -> f32 {
        self.take().map_or(default, f32::from_le_bytes)
    }

    /// The next `N` floats.
    ///
    /// # Errors
    /// When fewer bytes are left.
    pub fn floats<const N: usize>(&mut self) -> Result<[f32; N], Malformed> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.take().map(f32::from_le_bytes)?;
        }
        Ok(values)
    }

    /// The error of a byte that means nothing.
    #[must_use]
    pub const fn wrong(&self, expected: &'static str, found: u8) -> Malformed {
        Malformed::Value { id: self.id, expected, found }
    }
}
