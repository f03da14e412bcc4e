//! Where the bytes of a file go that is written as it is recorded.

use std::fmt;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

/// A file on a disk, or a pipe to someone who takes the same bytes as they come.
pub enum Destination {
    /// A file.
    File(File),
    /// A pipe, in which nobody can go back, and the number of bytes that went in.
    Pipe(Box<dyn Write + Send>, u64),
}

impl Destination {
    /// A pipe, or whatever else takes bytes in their order.
    #[must_use]
    pub fn pipe(pipe: Box<dyn Write + Send>) -> Self {
        Self::Pipe(pipe, 0)
    }

    /// Whether what was written can be written over.
    #[must_use]
    pub const fn can_go_back(&self) -> bool {
        matches!(self, Self::File(_))
    }
}

impl fmt::Debug for Destination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.can_go_back() { "File" } else { "Pipe" })
    }
}

impl Write for Destination {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.write(bytes),
            Self::Pipe(pipe, n_bytes) => {
                let n = pipe.write(bytes)?;
                *n_bytes += n as u64;
                Ok(n)
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::File(file) => file.flush(),
            Self::Pipe(pipe, _) => pipe.flush(),
        }
    }
}

impl Seek for Destination {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::File(file) => file.seek(to),
            // Where it is, it can say.
            Self::Pipe(_, n_bytes) if to == SeekFrom::Current(0) => Ok(*n_bytes),
            Self::Pipe(..) => {
                Err(io::Error::new(io::ErrorKind::NotSeekable, "a pipe runs one way"))
            }
        }
    }
}
