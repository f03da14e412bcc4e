//! What a session states beside its events and its light.

use evrig_core::effect_id::EffectId;
use std::f64::consts::FRAC_1_SQRT_2;

/// What is known of a session beside its events and its light.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionFacts {
    /// Whether the light comes from a map of the print rather than from frames of the same sensor.
    pub from_scene: bool,
    /// Whether the light is led along with what moves from frame to frame.
    pub is_motion_compensated: bool,
    /// Times of the event camera's own frames (start of exposure), microseconds of its clock.
    pub aps_us: Vec<i64>,
    /// The frames' time from one to the next, microseconds.
    pub frame_us: f64,
    /// What white paper reads above black, digital units.
    pub white_dn: f64,
    /// Units of `white_dn` that a pedestal of one digital unit in the frames adds to the light: above
    /// one where the weaker colours of a mosaic were scaled up.
    pub light_per_pedestal: f64,
    /// Width of an event pixel on the print, millimetres, where it is known.
    pub pixel_mm: Option<f64>,
    /// Effects that the frames of this session would show.
    pub testable_from_frames: Vec<EffectId>,
    /// The step of the grid on which the recording's stamps lay, microseconds, where they did.
    pub stamp_step_us: Option<f64>,
    /// By how much the clocks' offset may be wrong for all that the session states, microseconds.
    pub offset_bound_us: f64,
    /// Where light and events are tied by something else than what the session states of its
    /// clocks: what the tie says against that statement. `None` where nothing is stated.
    pub clock_tie: Option<ClockTie>,
}

/// Longest frame interval at which the signal between frames counts as known.
const MAX_DENSE_FRAME_INTERVAL_US: f64 = 5_000.0;

impl SessionFacts {
    /// Whether the light is known at any time, not only when a frame was taken.
    #[must_use]
    pub fn is_light_dense(&self) -> bool {
        self.from_scene || self.frame_us <= MAX_DENSE_FRAME_INTERVAL_US
    }

    /// Standard errors of what an offset of the clocks is measured against, microseconds: in the middle of the light,
    /// and of the change from there to either end. Between frames of the same camera, where nothing ties its events to
    /// the light, they may lag behind the frames by anything that is ordinary, each pixel by its own.
    pub(crate) fn clock_error_us(&self) -> [f64; 2] {
        match self.clock_tie {
            Some(tied) => tied.error(),
            None if self.is_light_dense() => [0.0; 2],
            None => {
                let even = self.offset_bound_us / 3.0_f64.sqrt();
                [even, even * FRAC_1_SQRT_2]
            }
        }
    }
}

/// What a tie of the cameras, by the light in their frames, says against the session's own map of
/// their clocks. The drive comes by the tie; a diagnosis starts from what the session states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockTie {
    /// By how much the event camera's stamps are late against the statement in the middle of the
    /// light, microseconds, and its standard error.
    pub offset_us: [f64; 2],
    /// By how much its clock is fast, parts in a million, and its standard error.
    pub skew_ppm: [f64; 2],
    /// By how much the statement itself may be off, microseconds.
    pub statement_bound_us: f64,
}

impl ClockTie {
    /// Standard errors of the statement, microseconds: in the middle of the light, and of the change
    /// from there to either end, which may be wrong each way.
    fn error(&self) -> [f64; 2] {
        // It holds in 95 of 100 cases.
        let stated = self.statement_bound_us / 1.96;
        [stated.hypot(self.offset_us[1]), stated * FRAC_1_SQRT_2]
    }

    /// First instant and step of a light that lasts so many seconds, microseconds, on the events' clock by what the
    /// session states of it.
    pub(crate) fn as_stated(&self, [start_us, step_us]: [f64; 2], seconds: f64) -> [f64; 2] {
        let fast = self.skew_ppm[0] * 1e-6;
        let delay_us = self.offset_us[0] - fast * 0.5e6 * seconds;
        [start_us - delay_us, step_us * (1.0 - fast)]
    }

    /// Whether the tie shows the camera's own frames as late as its events are said to be here.
    pub(crate) fn is_off(&self) -> bool {
        self.offset_us[0].abs() > self.statement_bound_us.max(200.0) + 4.0 * self.offset_us[1]
    }
}
