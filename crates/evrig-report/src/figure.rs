//! A figure: drawings with caption, legend and alternative text.

use super::plot::{Drawing, Ink};

/// Drawings under one caption.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// How the figure was made, and how to read it.
    pub caption: String,
    /// Legend.
    pub legend: Vec<LegendEntry>,
    /// The drawings: one over the page's width, or several side by side.
    pub panels: Vec<Panel>,
    /// The file that holds the numbers.
    pub data: Option<FileLink>,
}

/// One drawing of a figure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Panel {
    /// Title.
    pub title: String,
    /// Remark beside the title; may be empty.
    pub note: String,
    /// Alternative text.
    pub alt: String,
    /// The drawing.
    pub drawing: Drawing,
}

/// An entry of the legend.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LegendEntry {
    ink: Ink,
    sample: LegendMark,
    text: String,
}

/// The mark shown in the legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LegendMark {
    /// A solid line.
    Line,
    /// A thin broken line.
    Thin,
    /// A dot.
    Dot,
    /// A pixel of an image, in the image's colours.
    Pixel,
    /// A shaded area.
    Area,
}

/// A link to a file beside the page; never to another host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileLink {
    path: String,
}

impl Figure {
    /// The same figure with a link to the numbers behind it.
    #[must_use]
    pub fn with_data(self, link: FileLink) -> Self {
        Self { data: Some(link), ..self }
    }
}

impl LegendEntry {
    /// An entry of the legend.
    #[must_use]
    pub fn new(ink: Ink, sample: LegendMark, text: &str) -> Self {
        Self { ink, sample, text: text.to_owned() }
    }

    /// CSS class of the ink.
    #[must_use]
    pub fn ink_class(&self) -> &'static str {
        self.ink.class()
    }

    /// CSS class of the mark.
    #[must_use]
    pub fn sample_class(&self) -> &'static str {
        match self.sample {
            LegendMark::Line => "key-line",
            LegendMark::Thin => "key-thin",
            LegendMark::Dot => "key-dot",
            LegendMark::Pixel => "key-pixel",
            LegendMark::Area => "key-area",
        }
    }

    /// Its text.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }
}

impl FileLink {
    /// A link to a path relative to the page, with `/` between its parts.
    ///
    /// It is written as `./path` with percent-encoding, so that it contains neither a scheme
    /// (`javascript:`) nor a host (`//host`).
    #[must_use]
    pub fn beside(path: &str) -> Self {
        Self { path: path.trim_start_matches('/').to_owned() }
    }

    /// The path as given.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.path
    }

    /// The value of a `href`.
    #[must_use]
    pub fn href(&self) -> String {
        let mut href = String::from("./");
        for byte in self.path.bytes() {
            match byte {
                b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'-' | b'_' | b'.' | b'~' => {
                    href.push(char::from(byte));
                }
                other => href.push_str(&format!("%{other:02X}")),
            }
        }
        href
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_cannot_leave_for_another_host() {
        assert_eq!(
            FileLink::beside("derived/compare/a b.json").href(),
            "./derived/compare/a%20b.json"
        );
        assert_eq!(FileLink::beside("javascript:alert(1)").href(), "./javascript%3Aalert%281%29");
        assert_eq!(FileLink::beside("//host/x").href(), "./host/x");
    }
}
