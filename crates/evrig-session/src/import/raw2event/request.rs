//! What to import of the published layout.

use evrig_core::geometry::Size;
use std::path::Path;

/// What to import and how to read it.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportRaw2Event<'a> {
    /// The directory that holds the recordings.
    pub directory: &'a Path,
    /// Any part of the files' names that only this recording has.
    pub id: &'a str,
    /// Size of the Pi's frames.
    pub size: Size,
    /// What the Pi's wall clock showed.
    pub zone: chrono_tz::Tz,
}
