//! What shines when, and what the cameras were set to: all that a run may change but the motion.

use super::effects::WorldEffects;
use super::illumination::Illumination;
use super::schedule::{RunSetting, SettingSchedule};

/// The settings of a run and the light they make.
#[derive(Debug)]
pub(super) struct Lamps {
    pub(super) schedule: SettingSchedule,
    pub(super) light: Illumination,
}

impl Lamps {
    pub(super) fn new(schedule: SettingSchedule, effects: &WorldEffects) -> Self {
        let light = Illumination::new(&schedule, effects.flicker, effects.moving_shadow);
        Self { schedule, light }
    }

    /// The same with one more setting.
    pub(super) fn with(&self, setting: RunSetting, effects: &WorldEffects) -> Self {
        let settings = self.schedule.settings().iter().copied().chain([setting]);
        Self::new(SettingSchedule::new(settings.collect()), effects)
    }
}
