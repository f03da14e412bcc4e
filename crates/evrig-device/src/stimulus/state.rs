//! What the page is to show, and what it confirmed.

use serde::{Deserialize, Serialize};

/// The current state.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StimulusState {
    /// Grows with every change that the page must follow.
    pub sequence: u64,
    /// The image's place in the list.
    pub index: usize,
    /// Whether a recording turns the pages, and the keys do not.
    pub is_driven: bool,
    /// Whether the operator wants no further recording for now.
    pub is_paused: bool,
    /// The screen's own pixels a millimetre; none before the calibration.
    pub px_per_mm: Option<f64>,
    /// Whether a page has asked for the state.
    #[serde(skip)]
    pub is_open: bool,
    /// What a page confirmed last.
    #[serde(skip)]
    pub shown: Option<Shown>,
}

/// What a page confirmed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    /// The state it followed.
    pub sequence: u64,
    /// The image's place in the list.
    pub index: usize,
    /// The scale it was drawn at.
    pub px_per_mm: f64,
    /// The page's width in the screen's pixels.
    pub width_px: f64,
    /// The page's height in the screen's pixels.
    pub height_px: f64,
    /// What the target needs.
    pub needed_px: [f64; 2],
    /// Whether all of the target is on the screen.
    pub fits: bool,
    /// The screen's pixels in one of the page's.
    pub device_pixel_ratio: f64,
}

/// Scales beyond these are mistakes: a projected pixel of 10 mm, a microdisplay of 4 um.
const PX_PER_MM: std::ops::RangeInclusive<f64> = 0.1..=250.0;

impl StimulusState {
    pub(super) fn new(px_per_mm: Option<f64>) -> Self {
        Self {
            sequence: 1,
            index: 0,
            is_driven: false,
            is_paused: false,
            px_per_mm: px_per_mm.filter(|scale| PX_PER_MM.contains(scale)),
            is_open: false,
            shown: None,
        }
    }

    /// Whether a recording may begin.
    pub(super) fn is_ready(&self) -> bool {
        self.is_open && self.px_per_mm.is_some() && !self.is_paused
    }

    /// Turns to an image.
    pub(super) fn turn_to(&mut self, index: usize, is_driven: bool) {
        (self.index, self.is_driven) = (index, is_driven);
        self.sequence += 1;
    }

    /// Turns by a key, which does nothing while a recording turns.
    pub(super) fn step(&mut self, by: i64, n_images: usize) {
        if self.is_driven || n_images == 0 {
            return;
        }
        let last = n_images as i64 - 1;
        let index = (self.index as i64).saturating_add(by).clamp(0, last);
        self.turn_to(index as usize, false);
    }

    /// Pauses or goes on.
    pub(super) fn pause(&mut self, is_paused: bool) {
        self.is_paused = is_paused;
        self.sequence += 1;
    }

    /// Takes what a page confirms; false when it is of another image, or older than what was
    /// confirmed before: two confirmations of one page can arrive in either order.
    pub(super) fn confirm(&mut self, shown: Shown) -> bool {
        let newest = self.shown.as_ref().map_or(0, |newest| newest.sequence);
        let is_current =
            shown.index == self.index && (newest..=self.sequence).contains(&shown.sequence);
        if is_current {
            self.shown = Some(shown);
        }
        is_current
    }

    /// Takes a calibration; false when it cannot be one.
    pub(super) fn calibrate(&mut self, px_per_mm: f64) -> bool {
        let is_sound = PX_PER_MM.contains(&px_per_mm);
        if is_sound {
            self.px_per_mm = Some(px_per_mm);
            self.sequence += 1;
        }
        is_sound
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_turn_within_the_list_and_not_while_a_recording_turns() {
        let mut state = StimulusState::new(None);
        for (by, expected) in [(1, 1), (1, 2), (1, 2), (-5, 0), (i64::MAX, 2)] {
            state.step(by, 3);
            assert_eq!(state.index, expected);
        }
        state.turn_to(1, true);
        state.step(1, 3);
        assert_eq!(state.index, 1);
    }

    #[test]
    fn a_late_confirmation_does_not_replace_a_newer_one() {
        let shown = |sequence, index| Shown {
            sequence,
            index,
            px_per_mm: 4.0,
            width_px: 900.0,
            height_px: 700.0,
            needed_px: [800.0, 600.0],
            fits: true,
            device_pixel_ratio: 1.0,
        };
        let mut state = StimulusState::new(Some(4.0));
        state.turn_to(0, true);
        assert!(state.confirm(shown(2, 0)));
        assert!(!state.confirm(shown(1, 0)), "older");
        assert!(!state.confirm(shown(3, 0)), "of a state that was not there yet");
        assert!(!state.confirm(shown(2, 1)), "another image");
        assert_eq!(state.shown.as_ref().map(|shown| shown.sequence), Some(2));
        assert!(state.confirm(shown(2, 0)), "laid out anew");
    }

    #[test]
    fn it_is_ready_when_a_page_is_open_calibrated_and_not_paused() {
        let mut state = StimulusState::new(Some(0.0));
        state.is_open = true;
        assert!(!state.is_ready(), "a scale of 0 is none");
        assert!(!state.calibrate(f64::NAN) && !state.calibrate(1e9));
        assert!(state.calibrate(3.78) && state.is_ready());
        state.pause(true);
        assert!(!state.is_ready());
    }
}
