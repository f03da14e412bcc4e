//! Frames from a folder of images.

use crate::SessionError;
use evrig_core::geometry::Size;
use image::DynamicImage;
use kornia_image::{Image, ImageSize};
use std::path::{Path, PathBuf};

/// Brightness samples of one image: 8 bit, or 16 bit where the image has more.
pub(super) enum Gray {
    U8(Vec<u8>),
    U16(Vec<u16>),
}

impl Gray {
    /// The samples, if they are of 8 bits.
    pub(super) fn into_u8(self) -> Option<Vec<u8>> {
        if let Self::U8(samples) = self { Some(samples) } else { None }
    }

    /// The samples, if they are of 16 bits.
    pub(super) fn into_u16(self) -> Option<Vec<u16>> {
        if let Self::U16(samples) = self { Some(samples) } else { None }
    }
}

/// The images of a folder in the order of their names, numbers in them counted as numbers.
pub(super) fn list(folder: &Path) -> Result<Vec<PathBuf>, SessionError> {
    const ENDINGS: [&str; 7] = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "pgm"];
    let is_image = |path: &PathBuf| {
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
    };
    let entries = std::fs::read_dir(folder).map_err(SessionError::io(folder))?;
    let mut paths: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(is_image).collect();
    if paths.is_empty() {
        let what = format!("holds no images ({})", ENDINGS.join(", "));
        return Err(SessionError::import(folder, what));
    }
    paths.sort_by_cached_key(|path| natural_key(&crate::manifest::file_name(path)));
    Ok(paths)
}

/// Splits a name so that `frame10` sorts after `frame9`.
fn natural_key(name: &str) -> Vec<(String, u64)> {
    let mut key = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let text_end = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (text, behind) = rest.split_at(text_end);
        let number_end = behind.find(|c: char| !c.is_ascii_digit()).unwrap_or(behind.len());
        let (digits, next) = behind.split_at(number_end);
        key.push((text.to_owned(), digits.parse().unwrap_or(u64::MAX)));
        rest = next;
    }
    key
}

/// Decodes one image to brightness; colour is weighted as in BT.601.
pub(super) fn read_gray(path: &Path) -> Result<(Size, Gray), SessionError> {
    let wrong = |what: String| SessionError::import(path, what);
    let decoded = image::ImageReader::open(path)
        .map_err(SessionError::io(path))?
        .with_guessed_format()
        .map_err(SessionError::io(path))?
        .decode()
        .map_err(|e| wrong(format!("not a readable image: {e}")))?;
    let side =
        |n: u32| u16::try_from(n).map_err(|_| wrong(format!("{n} pixels a side is too many")));
    let size = Size::new(side(decoded.width())?, side(decoded.height())?);
    let gray = match decoded {
        DynamicImage::ImageLuma8(image) => Gray::U8(image.into_raw()),
        DynamicImage::ImageLuma16(image) => Gray::U16(image.into_raw()),
        DynamicImage::ImageRgb16(_) | DynamicImage::ImageRgba16(_) => {
            Gray::U16(gray_from_rgb(&decoded.to_rgb32f(), size).map_err(wrong)?)
        }
        colour => Gray::U8(gray_from_rgb8(colour.to_rgb8().into_raw(), size).map_err(wrong)?),
    };
    Ok((size, gray))
}

fn gray_from_rgb8(rgb: Vec<u8>, size: Size) -> Result<Vec<u8>, String> {
    let image_size = ImageSize { width: size.width.into(), height: size.height.into() };
    let rgb = Image::<u8, 3>::new(image_size, rgb).map_err(|e| e.to_string())?;
    let mut gray = Image::from_size_val(image_size, 0).map_err(|e| e.to_string())?;
    kornia_imgproc::color::gray_from_rgb_u8(&rgb, &mut gray).map_err(|e| e.to_string())?;
    Ok(gray.into_vec())
}

fn gray_from_rgb(rgb: &image::Rgb32FImage, size: Size) -> Result<Vec<u16>, String> {
    let image_size = ImageSize { width: size.width.into(), height: size.height.into() };
    let rgb = Image::<f32, 3>::new(image_size, rgb.as_raw().clone()).map_err(|e| e.to_string())?;
    let mut gray = Image::from_size_val(image_size, 0.0_f32).map_err(|e| e.to_string())?;
    kornia_imgproc::color::gray_from_rgb(&rgb, &mut gray).map_err(|e| e.to_string())?;
    Ok(gray.as_slice().iter().map(|v| (v * 65_535.0).round() as u16).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_ten_comes_behind_frame_nine() {
        let mut names = vec!["f10.png", "f9.png", "f1.png", "f010b.png"];
        names.sort_by_cached_key(|name| natural_key(name));
        assert_eq!(names, ["f1.png", "f9.png", "f10.png", "f010b.png"]);
    }

    #[test]
    fn colour_becomes_brightness_as_in_bt601() {
        let gray = gray_from_rgb8(vec![255, 0, 0, 0, 255, 0, 0, 0, 255], Size::new(3, 1)).unwrap();
        // 0.299, 0.587 and 0.114 of 255 are 76.2, 149.7 and 29.1.
        for (found, expected) in gray.iter().zip([76.2_f32, 149.7, 29.1]) {
            assert!((f32::from(*found) - expected).abs() <= 1.0, "{gray:?}");
        }
    }
}
