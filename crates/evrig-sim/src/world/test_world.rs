//! A small rig for tests: both cameras over the middle of a small print, near enough to be quick.

use super::{RunSetting, SettingSchedule, ToolMotion, World, WorldDescription, WorldEffects};
use evrig_core::event::Event;
use evrig_core::time::Span;
use evrig_session::rig::{Pose, Rig};
use std::sync::Arc;

/// Where the cameras are over the middle of the target.
pub(super) const MIDDLE: [f64; 4] = [270.0, 0.0, 100.0, 90.0];

/// The tool goes straight to the right of the image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Glide {
    pub(super) speed_mm_per_s: f64,
}

impl ToolMotion for Glide {
    fn pose_at(&self, time: Span) -> Pose {
        let [x, y, z, r] = MIDDLE;
        Pose::from_mm_deg([x + self.speed_mm_per_s * time.as_secs_f64(), y, z, r])
    }
}

/// A world to be built: an image, a speed, settings, effects.
pub(super) struct TestWorld {
    pub(super) description: WorldDescription,
    pub(super) speed_mm_per_s: f64,
    pub(super) settings: Vec<RunSetting>,
    pub(super) rig_changes: Vec<(&'static str, &'static str)>,
}

impl TestWorld {
    /// Nothing moves, nothing is wrong.
    pub(super) fn still(image: &str) -> Self {
        let mut description = WorldDescription::default();
        description.target.image = image.to_owned();
        Self {
            description,
            speed_mm_per_s: 0.0,
            settings: vec![RunSetting::nominal(Span::ZERO, true)],
            rig_changes: Vec::new(),
        }
    }

    /// The tool goes to the right.
    pub(super) fn moving(image: &str, speed_mm_per_s: f64) -> Self {
        Self { speed_mm_per_s, ..Self::still(image) }
    }

    /// With the effects of a description's table.
    pub(super) fn with(mut self, effects: &str) -> Self {
        self.description.effects = toml::from_str::<WorldEffects>(effects).unwrap();
        self
    }

    /// With the light at a level from a time on.
    pub(super) fn light(mut self, from_s: f64, light_level: f64) -> Self {
        let start = Span::from_secs_f64(from_s);
        self.settings.retain(|setting| setting.start != start);
        self.settings.push(RunSetting { light_level, ..RunSetting::nominal(start, true) });
        self
    }

    pub(super) fn rig(&self) -> Rig {
        let mut text = include_str!("../../../../rig/sim.toml").to_owned();
        let small = [
            ("[0.0, 18.0, -13.0]", "[0.0, 0.0, -13.0]"),
            ("[0.0, -18.0, -13.0]", "[0.0, 0.0, -13.0]"),
            ("size_px = [346, 260]", "size_px = [48, 32]"),
            ("size_px = [692, 520]", "size_px = [120, 80]"),
            ("focal_length_mm = 8.0", "focal_length_mm = 16.0"),
            ("tag_side_mm = 14.35", "tag_side_mm = 2.87"),
            ("picture_side_mm = 43.05", "picture_side_mm = 8.61"),
            ("gap_mm = 4.1\n", "gap_mm = 0.82\n"),
        ];
        for (from, to) in small.into_iter().chain(self.rig_changes.iter().copied()) {
            assert!(text.contains(from), "{from}");
            text = text.replace(from, to);
        }
        Rig::parse("stage.toml", &text).unwrap()
    }

    pub(super) fn world(&self) -> Arc<World> {
        let motion = Arc::new(Glide { speed_mm_per_s: self.speed_mm_per_s });
        let schedule = SettingSchedule::new(self.settings.clone());
        Arc::new(World::new(&self.rig(), motion, schedule, &self.description, 11).unwrap())
    }

    /// Events of the DAVIS within `seconds`, times counted from the world's beginning in µs.
    pub(super) fn events(&self, seconds: f64) -> Vec<Event> {
        let world = self.world();
        let mut twin = super::DavisTwin::new(Arc::clone(&world), Span::ZERO);
        let packet = twin.advance_to(Span::from_secs_f64(seconds));
        let start = world.clocks().unix(Span::ZERO).as_micros();
        packet.events.as_slice().iter().map(|event| Event { t: event.t - start, ..event }).collect()
    }
}

/// Events of each pixel in order of time, pixels row-major; those without any are left out.
pub(super) fn by_pixel(events: &[Event]) -> Vec<Vec<Event>> {
    let mut pixels = std::collections::BTreeMap::<(u16, u16), Vec<Event>>::new();
    for event in events {
        pixels.entry((event.y, event.x)).or_default().push(*event);
    }
    pixels.into_values().collect()
}

/// Number of ON events.
pub(super) fn n_on(events: &[Event]) -> f64 {
    events.iter().filter(|event| event.on).count() as f64
}

/// Pixels of the small sensor.
pub(super) const N_PIXELS: f64 = 48.0 * 32.0;
