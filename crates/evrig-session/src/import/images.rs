//! Frames from a folder of images.

use crate::SessionError;
use crate::manifest::file_name;
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

/// An image of a folder, with the number in its name.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct NamedImage {
    pub(super) path: PathBuf,
    /// The only number of the name, where it is whole.
    pub(super) number: Option<u64>,
    /// The only number of the name.
    pub(super) value: Option<f64>,
}

/// The images of a folder in the order of their names, numbers in them counted as numbers. Hidden
/// files are left out.
pub(super) fn list(folder: &Path) -> Result<Vec<NamedImage>, SessionError> {
    const ENDINGS: [&str; 8] = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "pgm", "ppm"];
    let is_image = |path: &PathBuf| {
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let is_known = ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()));
        is_known && !file_name(path).starts_with('.') && !path.is_dir()
    };
    let entries = std::fs::read_dir(folder).map_err(SessionError::io(folder))?;
    let mut paths: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(is_image).collect();
    if paths.is_empty() {
        let what = format!("holds no images ({})", ENDINGS.join(", "));
        return Err(SessionError::import(folder, what));
    }
    let stem = |path: &Path| path.with_extension("").file_name().map(|n| n.to_owned());
    let text = |path: &Path| stem(path).map(|s| s.to_string_lossy().into_owned());
    paths.sort_by_cached_key(|path| natural_key(&text(path).unwrap_or_default()));
    if let Some(pair) = paths.windows(2).find(|pair| stem(&pair[0]) == stem(&pair[1])) {
        let what = format!(
            "holds the frame twice, as {} and {}; keep one kind of image",
            file_name(&pair[0]),
            file_name(&pair[1])
        );
        return Err(SessionError::import(folder, what));
    }
    let named = |path: PathBuf| {
        let key = natural_key(&text(&path).unwrap_or_default());
        let mut numbers = key.iter().filter(|part| part.has_digits);
        let only = numbers.next().filter(|_| numbers.next().is_none());
        let value = only.and_then(|part| format!("{}.{}", part.whole, part.fraction).parse().ok());
        let whole = only.filter(|part| part.fraction.is_empty());
        NamedImage { path, number: whole.and_then(|part| u64::try_from(part.whole).ok()), value }
    };
    Ok(paths.into_iter().map(named).collect())
}

/// Place of each image on the count that its name's number gives, from 0; none where the numbers
/// are no count: most neighbours must be one step apart, and all whole steps.
pub(super) fn steps(images: &[NamedImage]) -> Option<Vec<u64>> {
    let numbers: Vec<u64> = images.iter().map(|image| image.number).collect::<Option<_>>()?;
    let differences: Option<Vec<u64>> =
        numbers.windows(2).map(|pair| pair[1].checked_sub(pair[0])).collect();
    let differences = differences?;
    let step = differences.iter().copied().min().filter(|step| *step > 0)?;
    let n_single = differences.iter().filter(|difference| **difference == step).count();
    let is_count = 2 * n_single > differences.len()
        && differences.iter().all(|difference| difference % step == 0);
    is_count.then(|| numbers.iter().map(|number| (number - numbers[0]) / step).collect())
}

/// Text and the number behind it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct NameKey {
    text: String,
    whole: u128,
    /// Digits behind a decimal point, without zeros at the end.
    fraction: String,
    has_digits: bool,
}

/// Splits a name without its ending so that `frame10` sorts after `frame9`, and 0.5 after 0.25.
fn natural_key(name: &str) -> Vec<NameKey> {
    let mut key = Vec::new();
    let mut rest = name;
    let digits_end = |text: &str| text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    while !rest.is_empty() {
        let text_end = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (text, behind) = rest.split_at(text_end);
        let (digits, next) = behind.split_at(digits_end(behind));
        let decimals = next.strip_prefix('.').map_or("", |next| &next[..digits_end(next)]);
        rest = if decimals.is_empty() { next } else { &next[1 + decimals.len()..] };
        key.push(NameKey {
            text: text.to_owned(),
            whole: digits.parse().unwrap_or(u128::MAX),
            fraction: decimals.trim_end_matches('0').to_owned(),
            has_digits: !digits.is_empty(),
        });
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
        // Transparency is no brightness.
        DynamicImage::ImageLumaA8(image) => Gray::U8(every_second(image.into_raw())),
        DynamicImage::ImageLumaA16(image) => Gray::U16(every_second(image.into_raw())),
        DynamicImage::ImageRgb16(_) | DynamicImage::ImageRgba16(_) => {
            Gray::U16(gray_from_rgb(&decoded.to_rgb32f(), size).map_err(wrong)?)
        }
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            let what =
                "holds floating-point samples, whose scale is not known; save it with 8 or 16 bits";
            return Err(wrong(what.into()));
        }
        colour => Gray::U8(gray_from_rgb8(colour.to_rgb8().into_raw(), size).map_err(wrong)?),
    };
    Ok((size, gray))
}

fn every_second<T: Copy>(samples: Vec<T>) -> Vec<T> {
    samples.into_iter().step_by(2).collect()
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
        let mut names = vec!["f10", "f9", "f1", "f010b"];
        names.sort_by_cached_key(|name| natural_key(name));
        assert_eq!(names, ["f1", "f9", "f10", "f010b"]);
        let mut names = vec!["1.5", "0.25", "0.5", "10.0", "1.10", "2"];
        names.sort_by_cached_key(|name| natural_key(name));
        assert_eq!(names, ["0.25", "0.5", "1.10", "1.5", "2", "10.0"]);
    }

    #[test]
    fn numbers_in_names_count_frames_where_they_are_steps() {
        let image = |number| NamedImage { path: PathBuf::new(), number: Some(number), value: None };
        let of = |numbers: &[u64]| steps(&numbers.iter().map(|n| image(*n)).collect::<Vec<_>>());
        assert_eq!(of(&[8, 9, 10]), Some(vec![0, 1, 2]));
        assert_eq!(of(&[2, 4, 6, 12]), Some(vec![0, 1, 2, 5]));
        assert_eq!(of(&[0, 8_333, 16_667, 25_000]), None);
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
