//! A figure: drawings that belong together, with what a reader must know to read them.

use super::plot::{Drawing, Ink};

/// Drawings under one caption.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// What is shown, in a few words.
    pub title: String,
    /// What to look for, and how the figure was made.
    pub caption: String,
    /// What the marks stand for.
    pub legend: Vec<Key>,
    /// The drawings: one over the page's width, several side by side where there is room.
    pub panels: Vec<Panel>,
    /// The file that holds the numbers.
    pub data: Option<Link>,
}

/// One drawing of a figure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Panel {
    /// What distinguishes it from its neighbour.
    pub title: String,
    /// One number or remark beside the title; may be empty.
    pub note: String,
    /// The drawing in words, for those who do not see it.
    pub alt: String,
    /// The drawing.
    pub drawing: Drawing,
}

/// A line of the legend.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Key {
    ink: Ink,
    sample: Sample,
    text: String,
}

/// The piece of drawing shown in the legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sample {
    /// A solid line.
    Line,
    /// A thin broken line.
    Thin,
    /// A dot.
    Dot,
    /// A pixel of a picture, in the picture's own colours.
    Pixel,
    /// A shaded area.
    Area,
}

/// A link to a file beside the page; never to another host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Link {
    path: String,
}

impl Figure {
    /// The same figure with a link to the numbers behind it.
    #[must_use]
    pub fn with_data(self, link: Link) -> Self {
        Self { data: Some(link), ..self }
    }
}

impl Key {
    /// A line of the legend.
    #[must_use]
    pub fn new(ink: Ink, sample: Sample, text: &str) -> Self {
        Self { ink, sample, text: text.to_owned() }
    }

    /// Class of the ink.
    #[must_use]
    pub fn ink_class(&self) -> &'static str {
        self.ink.class()
    }

    /// Class of the sample.
    #[must_use]
    pub fn sample_class(&self) -> &'static str {
        match self.sample {
            Sample::Line => "key-line",
            Sample::Thin => "key-thin",
            Sample::Dot => "key-dot",
            Sample::Pixel => "key-pixel",
            Sample::Area => "key-area",
        }
    }

    /// What it stands for.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }
}

impl Link {
    /// A link to a path relative to the page, with `/` between its parts.
    ///
    /// Whatever the path contains, the link stays below the page's folder's tree: it is
    /// written as `./path` with every unusual character percent-encoded, so neither a
    /// scheme (`javascript:`) nor a host (`//host`) can come of it.
    #[must_use]
    pub fn beside(path: &str) -> Self {
        Self { path: path.trim_start_matches('/').to_owned() }
    }

    /// The path as it was given, for people.
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
        assert_eq!(Link::beside("derived/compare/a b.json").href(), "./derived/compare/a%20b.json");
        assert_eq!(Link::beside("javascript:alert(1)").href(), "./javascript%3Aalert%281%29");
        assert_eq!(Link::beside("//host/x").href(), "./host/x");
    }
}
