//! Small images as PNG data URIs.

use super::colour::Rgb;
use base64::Engine;
use evrig_core::geometry::Size;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// Row-major colours on a pixel grid.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PixelImage {
    size: Size,
    /// Red, green, blue, opacity.
    pixels: Vec<[u8; 4]>,
}

/// An image that cannot be encoded.
#[derive(Debug, thiserror::Error)]
pub enum PixelImageError {
    /// The number of values does not fit the grid.
    #[error("an image of {size} pixels needs {expected} values, got {got}")]
    WrongLength {
        /// The grid.
        size: Size,
        /// Its number of pixels.
        expected: usize,
        /// Number of values given.
        got: usize,
    },
    /// The encoder failed, for instance on a grid without pixels.
    #[error("an image of {size} pixels cannot be encoded as PNG: {source}")]
    Encode {
        /// The grid.
        size: Size,
        /// The encoder's error.
        source: image::ImageError,
    },
}

/// Refuses a slice whose length is not the grid's.
pub(super) fn check_length(size: Size, got: usize) -> Result<(), PixelImageError> {
    let expected = size.n_pixels();
    if got == expected { Ok(()) } else { Err(PixelImageError::WrongLength { size, expected, got }) }
}

impl PixelImage {
    /// An image whose pixel `i` (row-major) has colour `colour_of(i)`.
    #[must_use]
    pub fn from_fn(size: Size, mut colour_of: impl FnMut(usize) -> Rgb) -> Self {
        Self { size, pixels: (0..size.n_pixels()).map(|i| opaque(colour_of(i))).collect() }
    }

    /// The same, transparent where there is no colour.
    #[must_use]
    pub fn from_fn_with_holes(size: Size, mut colour_of: impl FnMut(usize) -> Option<Rgb>) -> Self {
        let pixel = |i| colour_of(i).map_or([0; 4], opaque);
        Self { size, pixels: (0..size.n_pixels()).map(pixel).collect() }
    }

    /// Colour and opacity of the pixel at column `x` and row `y`, where it is on the grid.
    #[must_use]
    pub fn at(&self, x: u16, y: u16) -> Option<[u8; 4]> {
        self.size.contains(x, y).then(|| self.pixels[self.size.index(x, y)])
    }

    /// Sets one pixel; ignored off the grid.
    pub fn set(&mut self, x: u16, y: u16, colour: Rgb) {
        if self.size.contains(x, y) {
            let index = self.size.index(x, y);
            self.pixels[index] = opaque(colour);
        }
    }

    /// The image as a `data:image/png;base64,` URI.
    ///
    /// # Errors
    /// When the encoder fails.
    pub fn data_uri(&self) -> Result<String, PixelImageError> {
        let mut bytes = Vec::new();
        let flat = self.pixels.as_flattened();
        PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Adaptive)
            .write_image(
                flat,
                self.size.width.into(),
                self.size.height.into(),
                ExtendedColorType::Rgba8,
            )
            .map_err(|source| PixelImageError::Encode { size: self.size, source })?;
        let text = base64::engine::general_purpose::STANDARD.encode(bytes);
        Ok(format!("data:image/png;base64,{text}"))
    }
}

fn opaque([red, green, blue]: Rgb) -> [u8; 4] {
    [red, green, blue, u8::MAX]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_reads_back_pixel_by_pixel() {
        let size = Size::new(5, 3);
        let mut image =
            PixelImage::from_fn_with_holes(size, |i| (i != 7).then_some([i as u8, 2 * i as u8, 0]));
        image.set(4, 2, [9, 8, 7]);
        image.set(5, 0, [1, 1, 1]);
        let uri = image.data_uri().unwrap();
        let base64 = uri.strip_prefix("data:image/png;base64,").unwrap();
        let bytes = base64::engine::general_purpose::STANDARD.decode(base64).unwrap();
        let read = image::load_from_memory(&bytes).unwrap().to_rgba8();
        assert_eq!(image.at(2, 1), Some([0; 4]), "a hole is transparent");
        for y in 0..3 {
            for x in 0..5 {
                assert_eq!(read.get_pixel(x.into(), y.into()).0, image.at(x, y).unwrap());
            }
        }
    }

    #[test]
    fn an_image_without_pixels_is_an_error() {
        assert!(PixelImage::from_fn(Size::new(0, 3), |_| [0; 3]).data_uri().is_err());
    }
}
