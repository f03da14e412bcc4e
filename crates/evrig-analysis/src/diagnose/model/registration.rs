//! The signal registered to the event camera: pose, blur and clock as fitted.

use super::image_pose::ImagePose;
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::geometry::Size;
use serde::{Deserialize, Serialize};

/// Registration of a signal to an event camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedRegistration {
    /// Pose of the recorded against the predicted image.
    #[serde(alias = "placing")]
    pub pose: ImagePose,
    /// Center of rotation and scaling, pixels.
    #[serde(alias = "middle_px")]
    pub center_px: [f64; 2],
    /// Variance of blur beyond the signal's, square pixels; negative where it is sharper.
    pub blur_px2: f64,
    /// Added to an event's time at `reference_us` to obtain the signal's, microseconds.
    #[serde(alias = "late_us")]
    pub event_to_light_us: f64,
    /// Further addition per microsecond since `reference_us`.
    pub skew: f64,
    /// Reference time, microseconds of the events' clock.
    #[serde(alias = "at_us")]
    pub reference_us: f64,
}

impl FittedRegistration {
    fn light_us(&self, t_us: f64) -> f64 {
        t_us + self.event_to_light_us + self.skew * (t_us - self.reference_us)
    }

    fn event_us(&self, light_us: f64) -> f64 {
        (light_us - self.event_to_light_us + self.skew * self.reference_us) / (1.0 + self.skew)
    }
}

/// A drive as the event camera receives it, on the events' clock.
pub struct RegisteredDrive<'a> {
    drive: &'a dyn Drive,
    registration: FittedRegistration,
}

impl<'a> RegisteredDrive<'a> {
    /// Applies a registration to a drive.
    #[must_use]
    pub const fn new(drive: &'a dyn Drive, registration: FittedRegistration) -> Self {
        Self { drive, registration }
    }

    /// The blurred signal on its own clock.
    fn blurred(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        let is_known = self.drive.sample(place, grid, out);
        let half_blur = 0.5 * self.registration.blur_px2 as f32;
        if half_blur == 0.0 || !is_known {
            return is_known;
        }
        let mut bend = vec![-4.0; grid.n];
        let mut side = vec![f32::NAN; grid.n];
        for [dx, dy] in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
            self.drive.sample([place[0] + dx, place[1] + dy], grid, &mut side);
            for ((bend, side), here) in bend.iter_mut().zip(&side).zip(&*out) {
                *bend += (side - here).exp();
            }
        }
        for (value, bend) in out.iter_mut().zip(bend) {
            *value += (half_blur * bend).clamp(-0.7, 0.7);
        }
        true
    }
}

impl Drive for RegisteredDrive<'_> {
    fn size(&self) -> Size {
        self.drive.size()
    }

    fn span_us(&self) -> [i64; 2] {
        let [first, last] = self.drive.span_us().map(|t| self.registration.event_us(t as f64));
        [first.ceil() as i64, last.floor() as i64]
    }

    fn white_dn(&self) -> f64 {
        self.drive.white_dn()
    }

    fn sample(&self, place: [f64; 2], grid: TimeGrid, out: &mut [f32]) -> bool {
        let place = self.registration.pose.source_of(place, self.registration.center_px);
        let [first, last] = [grid.at(0), grid.at(grid.n.saturating_sub(1))]
            .map(|t| self.registration.light_us(t as f64));
        let own = TimeGrid::covering([first.floor() as i64, last.ceil() as i64], grid.step_us);
        let mut values = vec![f32::NAN; own.n];
        if !self.blurred(place, own, &mut values) {
            return false;
        }
        let mut is_known = false;
        for (i, out) in out.iter_mut().enumerate() {
            let position = own.position(self.registration.light_us(grid.at(i) as f64)).max(0.0);
            let left = (position as usize).min(own.n.saturating_sub(2));
            let (a, b) = (values[left], values.get(left + 1).copied().unwrap_or(f32::NAN));
            *out = a + (b - a) * (position - left as f64) as f32;
            is_known |= out.is_finite();
        }
        is_known
    }

    fn error(&self, place: [f64; 2]) -> f32 {
        self.drive.error(place)
    }
}
