//! What a session states besides events and signal.

use evrig_core::effect_id::EffectId;
use std::f64::consts::FRAC_1_SQRT_2;

/// What a session states besides events and signal.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionFacts {
    /// Whether the signal comes from a map of the target rather than from frames of the same
    /// sensor.
    pub from_scene: bool,
    /// Whether the signal between frames is interpolated along optical flow.
    pub is_motion_compensated: bool,
    /// Exposure starts of the event camera's own frames, microseconds of its clock.
    pub aps_us: Vec<i64>,
    /// Frame interval, microseconds.
    pub frame_us: f64,
    /// White level above black, digital units.
    pub white_dn: f64,
    /// Signal offset, in units of `white_dn`, per digital unit of pedestal: above one where weaker
    /// colours of a mosaic were scaled up.
    pub light_per_pedestal: f64,
    /// Width of an event pixel on the target, millimetres, if known.
    pub pixel_mm: Option<f64>,
    /// Effects that the frames of this session can show.
    pub testable_from_frames: Vec<EffectId>,
    /// Step of the time-stamp grid, microseconds, if there is one.
    pub stamp_step_us: Option<f64>,
    /// Bound on the error of the stated clock offset, microseconds.
    pub offset_bound_us: f64,
    /// An independent measurement of the clock map; `None` where the session states no clock map.
    pub clock_tie: Option<ClockTie>,
}

/// Longest frame interval at which the signal between frames counts as known.
const MAX_DENSE_FRAME_INTERVAL_US: f64 = 5_000.0;

impl SessionFacts {
    /// Whether the signal is known at all times, not only at frames.
    #[must_use]
    pub fn is_light_dense(&self) -> bool {
        self.from_scene || self.frame_us <= MAX_DENSE_FRAME_INTERVAL_US
    }

    /// Standard errors of the clock that the session states, microseconds: in the middle of the
    /// signal, and of the change from there to either end.
    pub(crate) fn clock_error_us(&self) -> [f64; 2] {
        self.clock_tie.map_or([0.0; 2], |tied| tied.error())
    }
}

/// Clock map measured by the light in the cameras' frames, against the map that the session
/// states. The signal uses the measurement; a diagnosis starts from the statement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockTie {
    /// Delay of the event camera's stamps against the statement in the middle of the signal,
    /// microseconds, and its standard error.
    pub offset_us: [f64; 2],
    /// Rate error of its clock, parts in a million, and its standard error.
    pub skew_ppm: [f64; 2],
    /// Bound on the error of the statement (95 %), microseconds.
    pub statement_bound_us: f64,
}

impl ClockTie {
    /// Standard errors of the statement, microseconds: in the middle, and of the change to either
    /// end.
    fn error(&self) -> [f64; 2] {
        // A 95 % bound.
        let stated = self.statement_bound_us / 1.96;
        [stated.hypot(self.offset_us[1]), stated * FRAC_1_SQRT_2]
    }

    /// First instant and step, microseconds, of a signal of some seconds on the events' clock as
    /// stated.
    pub(crate) fn as_stated(&self, [start_us, step_us]: [f64; 2], seconds: f64) -> [f64; 2] {
        let fast = self.skew_ppm[0] * 1e-6;
        let delay_us = self.offset_us[0] - fast * 0.5e6 * seconds;
        [start_us - delay_us, step_us * (1.0 - fast)]
    }

    /// Whether the camera's own frames are delayed too.
    pub(crate) fn is_off(&self) -> bool {
        self.offset_us[0].abs() > self.statement_bound_us.max(200.0) + 4.0 * self.offset_us[1]
    }
}
