//! Plots: pure functions from plain values to SVG.
//!
//! A drawing carries no colour of its own: every mark has a class and the page's
//! style sheet gives it ink, so one drawing serves light, dark and paper. Pictures
//! (frames, heat maps) are PNG inside the SVG. All text is escaped where it is written.

pub mod chart;
pub mod cloud;
pub mod colour;
pub mod grid;
pub mod heat;
pub mod interval;
pub mod overlay;
mod panel;
pub mod picture;
pub mod rate;
pub mod ratio;
pub mod scale;
pub mod sheet;
pub mod strip;
pub mod svg;

/// An SVG drawing, in one layout or in two: for a wide page and for a phone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Drawing {
    wide: String,
    narrow: Option<String>,
    is_wide: bool,
}

impl Drawing {
    /// One layout that reads at any width.
    pub(super) fn single(svg: String) -> Self {
        Self { wide: svg, narrow: None, is_wide: false }
    }

    /// One layout for a wide page and one for a phone; the style sheet shows the one that fits.
    pub(super) fn responsive(wide: String, narrow: String) -> Self {
        Self { wide, narrow: Some(narrow), is_wide: false }
    }

    /// The same drawing, which takes the page's full width.
    pub(super) fn over_full_width(self) -> Self {
        Self { is_wide: true, ..self }
    }

    /// Whether it takes the page's full width, rather than half of it.
    #[must_use]
    pub fn is_wide(&self) -> bool {
        self.is_wide
    }

    /// The markup for a wide page.
    #[must_use]
    pub fn wide(&self) -> &str {
        &self.wide
    }

    /// The markup for a phone, where it differs.
    #[must_use]
    pub fn narrow(&self) -> Option<&str> {
        self.narrow.as_deref()
    }
}

/// What a mark stands for; the style sheet gives each its colour in light, dark and print.
///
/// Measured data are black (white on dark), simulated ones crimson; On is amber and
/// Off blue. Lightness tells the members of each pair apart without colour, too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// Measured.
    Real,
    /// Generated.
    Simulated,
    /// Generated with the diagnosed effects added.
    Corrected,
    /// On events.
    On,
    /// Off events.
    Off,
    /// One of several curves of a kind, numbered from 0; colours repeat after four.
    Series(u8),
    /// Marks that guide the eye and are no data.
    Guide,
}

impl Ink {
    /// The class in the style sheet.
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
