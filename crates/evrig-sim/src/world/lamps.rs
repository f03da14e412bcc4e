//! What shines when, and what the cameras were set to: all that a run may change but the motion.

use super::effects::Effects;
use super::light::Light;
use super::schedule::{Schedule, Setting};

/// The settings of a run and the light they make.
#[derive(Debug)]
pub(super) struct Lamps {
    pub(super) schedule: Schedule,
    pub(super) light: Light,
}

impl Lamps {
    pub(super) fn new(schedule: Schedule, effects: &Effects) -> Self {
        let light = Light::new(&schedule, effects.flicker, effects.moving_shadow);
        Self { schedule, light }
    }

    /// The same with one more setting.
    pub(super) fn with(&self, setting: Setting, effects: &Effects) -> Self {
        let settings = self.schedule.settings().iter().copied().chain([setting]);
        Self::new(Schedule::new(settings.collect()), effects)
    }
}
