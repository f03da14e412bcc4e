//! Settings of a run besides the motion: light, exposure, frames on and off, flashes.

use evrig_core::time::Span;
use evrig_session::trajectory::ToolPath;

/// Settings from `start` on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunSetting {
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
pub struct SettingSchedule {
    settings: Vec<RunSetting>,
}

impl RunSetting {
    /// Full light, nominal exposure, no flashes.
    #[must_use]
    pub fn nominal(start: Span, aps: bool) -> Self {
        Self { start, aps, exposure_scale: 1.0, light_level: 1.0, n_flashes: 0 }
    }
}

impl SettingSchedule {
    /// Settings in any order.
    #[must_use]
    pub fn new(mut settings: Vec<RunSetting>) -> Self {
        settings.sort_by_key(|setting| setting.start);
        Self { settings }
    }

    /// The settings of the steps of a path; `aps` where a step does not set it.
    #[must_use]
    pub fn of_path(path: &ToolPath, aps: bool) -> Self {
        let setting = |step: &evrig_session::trajectory::PathStep| {
            let set = &step.settings;
            RunSetting {
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
    pub fn settings(&self) -> &[RunSetting] {
        &self.settings
    }

    /// The setting at `time`.
    #[must_use]
    pub fn at(&self, time: Span) -> RunSetting {
        let after = self.settings.partition_point(|setting| setting.start <= time);
        let found = self.settings.get(after.saturating_sub(1)).copied();
        found.unwrap_or_else(|| RunSetting::nominal(Span::ZERO, true))
    }
}
