//! Plots: pure functions from plain values to SVG.
//!
//! Marks have CSS classes; colours come from the style sheet of the page (light, dark, print) or of
//! a sheet. Images (frames, heat maps) are PNG inside the SVG. All text is escaped.

pub mod bars;
pub mod chart;
pub mod cloud;
pub mod colour;
pub mod grid;
pub mod heat;
mod image_panel;
pub mod interval;
pub mod overlay;
pub mod pixel_image;
pub mod rate;
pub mod ratio;
pub mod scale;
pub mod sheet;
pub mod strip;
pub mod svg;

/// An SVG drawing, with an optional second layout for narrow pages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Drawing {
    wide: String,
    narrow: Option<String>,
    is_wide: bool,
}

impl Drawing {
    pub(super) fn single(svg: String) -> Self {
        Self { wide: svg, narrow: None, is_wide: false }
    }

    pub(super) fn responsive(wide: String, narrow: String) -> Self {
        Self { wide, narrow: Some(narrow), is_wide: false }
    }

    pub(super) fn over_full_width(self) -> Self {
        Self { is_wide: true, ..self }
    }

    /// Whether it takes the full width of the page instead of half.
    #[must_use]
    pub fn is_wide(&self) -> bool {
        self.is_wide
    }

    /// The markup for a wide page.
    #[must_use]
    pub fn wide(&self) -> &str {
        &self.wide
    }

    /// The markup for a narrow page, where it differs.
    #[must_use]
    pub fn narrow(&self) -> Option<&str> {
        self.narrow.as_deref()
    }
}

/// The quantity that a mark shows, which determines its colour.
///
/// Pairs (real and simulated, ON and OFF) differ in lightness as well as in hue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// Measured.
    Real,
    /// Generated.
    Simulated,
    /// Generated with the diagnosed effects added.
    Corrected,
    /// ON events.
    On,
    /// OFF events.
    Off,
    /// One of several curves of a kind, numbered from 0; colours repeat after four.
    Series(u8),
    /// Guide lines.
    Guide,
}

impl Ink {
    /// CSS class.
    #[must_use]
    pub const fn class(self) -> &'static str {
        match self {
            Self::Real => "ink-real",
            Self::Simulated => "ink-sim",
            Self::Corrected => "ink-fix",
            Self::On => "ink-on",
            Self::Off => "ink-off",
            Self::Series(n) => match n % 4 {
                0 => "ink-series-0",
                1 => "ink-series-1",
                2 => "ink-series-2",
                _ => "ink-series-3",
            },
            Self::Guide => "ink-guide",
        }
    }
}
