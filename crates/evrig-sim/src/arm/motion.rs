//! A move under way: paths with their speeds, and where it breaks off.

use super::kinematics::{self, SimulatedJointLimits};
use super::path::{ArmPoint, LegPath};
use super::profile::SpeedProfile;
use evrig_device::dobot::alarm::Alarm;

/// One path at one profile.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Leg {
    /// Where it goes.
    pub(super) path: LegPath,
    /// How fast.
    pub(super) profile: SpeedProfile,
}

/// What the arm does for a while: legs one after the other, or standing still.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct ArmMotion {
    legs: Vec<Leg>,
    /// Standing still after the legs, seconds.
    rest_s: f64,
    /// When it breaks off (seconds) and why.
    breaks: Option<(f64, Alarm)>,
}

/// What turns points into joints.
#[derive(Debug, Clone, Copy)]
pub(super) struct ArmGeometry<'a> {
    /// Tool offset from the flange, mm.
    pub(super) bias: [f64; 3],
    /// Limits of the joints.
    pub(super) limits: &'a SimulatedJointLimits,
}

impl ArmGeometry<'_> {
    /// The joints at a point.
    ///
    /// # Errors
    /// The planning alarm when the arm cannot reach it.
    pub(super) fn joints(&self, point: ArmPoint) -> Result<[f64; 4], Alarm> {
        let joints = match point {
            ArmPoint::Joints(joints) => joints,
            ArmPoint::Xyzr(xyzr) => kinematics::inverse(xyzr, self.bias)?,
        };
        if self.limits.allow(joints) { Ok(joints) } else { Err(Alarm::PLAN_JOINT_LIMIT) }
    }
}

impl ArmMotion {
    /// Standing still.
    #[must_use]
    pub(super) const fn rest(seconds: f64) -> Self {
        Self { legs: Vec::new(), rest_s: seconds, breaks: None }
    }

    /// The legs in order, checked along the way: the end must be possible, and where
    /// the way leaves the limits before it, the motion breaks off.
    ///
    /// # Errors
    /// The planning alarm of an end that the arm cannot reach.
    pub(super) fn along(legs: Vec<Leg>, body: ArmGeometry<'_>) -> Result<Self, Alarm> {
        /// Places looked at on a leg; a leg of 300 mm is seen every 5 mm.
        const N_SAMPLES: u32 = 64;
        let mut breaks = None;
        let mut start_s = 0.0;
        for leg in &legs {
            body.joints(leg.path.at(1.0))?;
            let duration_s = leg.profile.duration_s();
            for sample in 1..N_SAMPLES {
                let t_s = duration_s * f64::from(sample) / f64::from(N_SAMPLES);
                let point = leg.path.at(leg.profile.fraction(t_s));
                if let (None, Err(alarm)) = (breaks, body.joints(point)) {
                    // The arm stays at the last place that it could reach.
                    let before_s = duration_s * f64::from(sample - 1) / f64::from(N_SAMPLES);
                    breaks = Some((start_s + before_s, on_the_way(alarm)));
                }
            }
            start_s += duration_s;
        }
        Ok(Self { legs, rest_s: 0.0, breaks })
    }

    /// The legs in order, whatever the limits.
    #[must_use]
    pub(super) const fn unchecked(legs: Vec<Leg>) -> Self {
        Self { legs, rest_s: 0.0, breaks: None }
    }

    /// Seconds until it ends or breaks off.
    #[must_use]
    pub(super) fn duration_s(&self) -> f64 {
        self.breaks.map_or_else(
            || self.legs.iter().map(|leg| leg.profile.duration_s()).sum::<f64>() + self.rest_s,
            |(t_s, _)| t_s,
        )
    }

    /// Why it breaks off before its end, if it does.
    #[must_use]
    pub(super) fn breaks_with(&self) -> Option<Alarm> {
        self.breaks.map(|(_, alarm)| alarm)
    }

    /// Speed at the end, mm/s: not zero between blended moves.
    #[must_use]
    pub(super) fn exit_speed(&self) -> f64 {
        self.legs.last().map_or(0.0, |leg| leg.profile.exit())
    }

    /// The point `t_s` seconds after the start; `None` when the motion is standing still.
    #[must_use]
    pub(super) fn at(&self, t_s: f64) -> Option<ArmPoint> {
        let mut t_s = t_s.min(self.duration_s());
        let last = self.legs.len().checked_sub(1)?;
        for (n, leg) in self.legs.iter().enumerate() {
            let duration_s = leg.profile.duration_s();
            if t_s <= duration_s || n == last {
                return Some(leg.path.at(leg.profile.fraction(t_s)));
            }
            t_s -= duration_s;
        }
        None
    }
}

/// The alarm of a limit met on the way instead of at the end.
fn on_the_way(alarm: Alarm) -> Alarm {
    Alarm(alarm.0 + 0x10)
}
