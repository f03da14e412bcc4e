//! Destination of a file that is written during a recording.

use std::fmt;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

/// A file, or a pipe that receives the same bytes as they are written.
pub enum Destination {
    /// A file.
    File(File),
    /// A pipe, which cannot seek, and the number of bytes written.
    Pipe(Box<dyn Write + Send>, u64),
}

impl Destination {
    /// A pipe or any other sequential writer.
    #[must_use]
    pub fn pipe(pipe: Box<dyn Write + Send>) -> Self {
        Self::Pipe(pipe, 0)
    }

    /// Whether it can seek.
    #[must_use]
    pub const fn can_seek(&self) -> bool {
        matches!(self, Self::File(_))
    }
}

impl fmt::Debug for Destination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.can_seek() { "File" } else { "Pipe" })
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
            Self::Pipe(_, n_bytes) if to == SeekFrom::Current(0) => Ok(*n_bytes),
            Self::Pipe(..) => Err(io::Error::new(io::ErrorKind::NotSeekable, "a pipe cannot seek")),
        }
    }
}
