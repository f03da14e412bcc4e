//! What the run sets besides the motion: light, exposure, frames on and off, flashes.

use evrig_core::time::Span;
use evrig_session::trajectory::ToolPath;

/// What holds from `start` on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// World time from which it holds.
    pub start: Span,
    /// Whether the DAVIS takes frames.
    pub aps: bool,
    /// Exposure of both cameras' frames as a multiple of the rig's.
    pub exposure_scale: f64,
    /// Light as a share of the rig's full light.
    pub light_level: f64,
    /// Flashes after `start`.
    pub n_flashes: u32,
}

/// Settings in the order of their starts. Before the first and without any: full light, no flashes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Schedule {
    settings: Vec<Setting>,
}

impl Setting {
    /// Full light, nominal exposure, no flashes.
    #[must_use]
    pub fn nominal(start: Span, aps: bool) -> Self {
        Self { start, aps, exposure_scale: 1.0, light_level: 1.0, n_flashes: 0 }
    }
}

impl Schedule {
    /// Settings in any order.
    #[must_use]
    pub fn new(mut settings: Vec<Setting>) -> Self {
        settings.sort_by_key(|setting| setting.start);
        Self { settings }
    }

    /// What the steps of a path set; `aps` is what holds where a step says nothing.
    #[must_use]
    pub fn of_path(path: &ToolPath, aps: bool) -> Self {
        let setting = |step: &evrig_session::trajectory::PathStep| {
            let set = &step.settings;
            Setting {
                start: step.start,
                aps: set.aps.unwrap_or(aps),
                exposure_scale: set.exposure_scale.unwrap_or(1.0),
                light_level: set.light_level.unwrap_or(1.0),
                n_flashes: set.n_flashes,
            }
        };
        Self::new(path.steps().iter().map(setting).collect())
    }

    /// All of them.
    #[must_use]
    pub fn settings(&self) -> &[Setting] {
        &self.settings
    }

    /// What holds at `time`.
    #[must_use]
    pub fn at(&self, time: Span) -> Setting {
        let after = self.settings.partition_point(|setting| setting.start <= time);
        let found = self.settings.get(after.saturating_sub(1)).copied();
        found.unwrap_or_else(|| Setting::nominal(Span::ZERO, true))
    }
}
