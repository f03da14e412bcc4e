//! The images to show, with their labels.

use super::StimulusError;
use image::ImageReader;
use std::path::{Path, PathBuf};

/// What browsers draw, and how it is called.
const TYPES: [(&str, &str); 4] =
    [("png", "image/png"), ("jpg", "image/jpeg"), ("jpeg", "image/jpeg"), ("bmp", "image/bmp")];
/// An image's file beyond this is a mistake.
const MAX_BYTES: u64 = 256 << 20;

/// One image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StimulusImage {
    /// Its file.
    pub path: PathBuf,
    /// What it shows, as a data set's class has it.
    pub label: String,
    /// Its media type.
    pub(super) media_type: &'static str,
}

/// Images in the order in which they are shown; never empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImageList {
    images: Vec<StimulusImage>,
}

impl ImageList {
    /// Reads a list: a folder of images in the order of their names, each labelled by its name,
    /// or a text file with a line `image[,label]` each, paths relative to it, `#` before remarks.
    ///
    /// # Errors
    /// When it cannot be read, is empty, or names something that is no image a browser draws.
    pub fn read(path: &Path) -> Result<Self, StimulusError> {
        let failed = |what: String| StimulusError::List { path: path.to_owned(), what };
        let images = if path.is_dir() { folder(path)? } else { file(path)? };
        if images.is_empty() {
            return Err(failed("holds no image (png, jpg, bmp)".into()));
        }
        Ok(Self { images })
    }

    /// The image at a place.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<&StimulusImage> {
        self.images.get(index)
    }

    /// All of them.
    #[must_use]
    pub fn as_slice(&self) -> &[StimulusImage] {
        &self.images
    }
}

fn folder(path: &Path) -> Result<Vec<StimulusImage>, StimulusError> {
    let failed = |error: std::io::Error| StimulusError::List {
        path: path.to_owned(),
        what: error.to_string(),
    };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(path).map_err(failed)? {
        files.push(entry.map_err(failed)?.path());
    }
    files.sort();
    files.retain(|file| media_type(file).is_some());
    files.into_iter().map(|file| stimulus_image(file, None)).collect()
}

fn file(path: &Path) -> Result<Vec<StimulusImage>, StimulusError> {
    let failed = |what: String| StimulusError::List { path: path.to_owned(), what };
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(|error| failed(error.to_string()))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut images = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| failed(error.to_string()))?;
        let line = record.position().map_or(0, csv::Position::line);
        let name = record.get(0).unwrap_or_default();
        if name.is_empty() || record.len() > 2 {
            let found = record.iter().collect::<Vec<_>>().join(",");
            return Err(failed(format!("line {line}: expected image[,label], found `{found}`")));
        }
        let label = record.get(1).filter(|label| !label.is_empty()).map(str::to_owned);
        let image = stimulus_image(folder.join(name), label).map_err(|error| match error {
            StimulusError::List { path, what } => {
                failed(format!("line {line}: {}: {what}", path.display()))
            }
            other => other,
        })?;
        images.push(image);
    }
    Ok(images)
}

/// Looks whether the file is an image, without decoding it.
fn stimulus_image(path: PathBuf, label: Option<String>) -> Result<StimulusImage, StimulusError> {
    let failed = |what: String| StimulusError::List { path: path.clone(), what };
    let media_type = media_type(&path)
        .ok_or_else(|| failed("is no image that browsers draw; use png, jpg or bmp".into()))?;
    let bytes = std::fs::metadata(&path).map_err(|error| failed(error.to_string()))?.len();
    if bytes > MAX_BYTES {
        return Err(failed(format!("has {bytes} bytes; at most {MAX_BYTES} are shown")));
    }
    let opened = ImageReader::open(&path).and_then(ImageReader::with_guessed_format);
    let reader = opened.map_err(|error| failed(error.to_string()))?;
    reader.into_dimensions().map_err(|error| failed(format!("is no image: {error}")))?;
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let label = label.or(stem).unwrap_or_default();
    Ok(StimulusImage { path, label, media_type })
}

fn media_type(path: &Path) -> Option<&'static str> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    TYPES.iter().find(|(known, _)| *known == extension).map(|(_, media_type)| *media_type)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            image::GrayImage::new(4, 3).save(folder.path().join(name)).unwrap();
        }
        folder
    }

    #[test]
    fn a_list_gives_images_and_labels_in_its_order() {
        let folder = with(&["b.png", "a.png"]);
        let list = folder.path().join("list.csv");
        std::fs::write(&list, "# first the second\nb.png, tabby cat\na.png\n").unwrap();
        let images = ImageList::read(&list).unwrap();
        let labels: Vec<_> = images.as_slice().iter().map(|image| image.label.as_str()).collect();
        assert_eq!(labels, ["tabby cat", "a"]);
        assert_eq!(images.get(0).unwrap().path, folder.path().join("b.png"));
    }

    #[test]
    fn a_folder_gives_its_images_in_the_order_of_their_names() {
        let folder = with(&["b.png", "a.bmp"]);
        std::fs::write(folder.path().join("notes.txt"), "no image").unwrap();
        let images = ImageList::read(folder.path()).unwrap();
        let labels: Vec<_> = images.as_slice().iter().map(|image| image.label.as_str()).collect();
        assert_eq!(labels, ["a", "b"]);
    }

    #[test]
    fn what_is_no_image_is_reported_with_its_line() {
        let folder = with(&["a.png"]);
        std::fs::write(folder.path().join("broken.png"), "text").unwrap();
        let list = folder.path().join("list.csv");
        for (text, expected) in [
            ("a.png\nmissing.png,x\n", "line 2"),
            ("broken.png\n", "is no image"),
            ("a.tiff\n", "use png, jpg or bmp"),
            ("a.png,label,more\n", "expected image[,label]"),
            ("# nothing\n", "holds no image"),
        ] {
            std::fs::write(&list, text).unwrap();
            let message = ImageList::read(&list).unwrap_err().to_string();
            assert!(message.contains(expected) && message.contains("list.csv"), "{message}");
        }
    }
}
