//! Writing: npy arrays streamed to disk, npz archives of arrays.

use super::NpyError;
use npyz::WriterBuilder;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use zip::write::SimpleFileOptions;

/// A type that npy arrays are written in.
pub trait Element: npyz::AutoSerialize + Copy {}
impl Element for u8 {}
impl Element for u16 {}
impl Element for u32 {}
impl Element for i16 {}
impl Element for i64 {}
impl Element for f32 {}
impl Element for f64 {}
impl Element for bool {}

/// Writes one npy file, element after element; the shape is stated at the start.
pub struct ArrayWriter<T: Element> {
    path: PathBuf,
    writer: npyz::NpyWriter<T, BufWriter<File>>,
}

impl<T: Element> ArrayWriter<T> {
    /// Makes the file and writes its header.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(path: &Path, shape: &[u64]) -> Result<Self, NpyError> {
        let file = File::create(path).map_err(|e| NpyError::io(path, e))?;
        let writer = npyz::WriteOptions::new()
            .default_dtype()
            .shape(shape)
            .writer(BufWriter::with_capacity(1 << 20, file))
            .begin_nd()
            .map_err(|e| NpyError::io(path, e))?;
        Ok(Self { path: path.to_owned(), writer })
    }

    /// Appends elements in C order.
    ///
    /// # Errors
    /// When writing fails.
    pub fn extend(&mut self, elements: &[T]) -> Result<(), NpyError> {
        self.writer.extend(elements.iter().copied()).map_err(|e| NpyError::io(&self.path, e))
    }

    /// Ends the file.
    ///
    /// # Errors
    /// When writing fails, or the number of elements differs from the shape.
    pub fn finish(self) -> Result<(), NpyError> {
        self.writer.finish().map_err(|e| NpyError::io(&self.path, e))
    }
}

/// Writes an npz archive, array after array, compressed by deflate as `numpy.savez_compressed`
/// does.
pub struct NpzWriter<W: Write + Seek> {
    path: PathBuf,
    zip: zip::ZipWriter<W>,
}

impl NpzWriter<BufWriter<File>> {
    /// Makes the archive.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(path: &Path) -> Result<Self, NpyError> {
        let file = File::create(path).map_err(|e| NpyError::io(path, e))?;
        Ok(Self { path: path.to_owned(), zip: zip::ZipWriter::new(BufWriter::new(file)) })
    }
}

impl<W: Write + Seek> NpzWriter<W> {
    /// Adds an array of the given shape, its elements in C order.
    ///
    /// # Errors
    /// When writing fails or the number of elements differs from the shape.
    pub fn add<T: Element>(
        &mut self,
        name: &str,
        shape: &[u64],
        elements: impl IntoIterator<Item = T>,
    ) -> Result<(), NpyError> {
        // One date for all entries: the same arrays give the same bytes at any time.
        let options = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated)
            .compression_level(Some(1))
            .last_modified_time(zip::DateTime::default())
            .large_file(true);
        let path = self.path.clone();
        self.zip
            .start_file(format!("{name}.npy"), options)
            .map_err(|e| NpyError::format(&path, e.to_string()))?;
        let buffered = BufWriter::with_capacity(1 << 16, &mut self.zip);
        let mut writer = npyz::WriteOptions::new()
            .default_dtype()
            .shape(shape)
            .writer(buffered)
            .begin_nd()
            .map_err(|e| NpyError::io(&path, e))?;
        writer.extend(elements).and_then(|()| writer.finish()).map_err(|e| NpyError::io(&path, e))
    }

    /// Ends the archive.
    ///
    /// # Errors
    /// When writing fails.
    pub fn finish(self) -> Result<(), NpyError> {
        let Self { path, zip } = self;
        let mut inner = zip.finish().map_err(|e| NpyError::format(&path, e.to_string()))?;
        inner.flush().map_err(|e| NpyError::io(&path, e))
    }
}
