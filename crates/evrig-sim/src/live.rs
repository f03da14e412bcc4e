//! The world in real time: it follows the arm's true motion, and its twins may lag behind.
//!
//! A twin renders its camera no further than the motion is known, and may be slower than real time.
//! All cameras therefore close at one instant ([`LiveWorld::close`]); what precedes it is rendered
//! afterwards.

use super::arm::{ArmEmulator, TraceFollower};
use super::world::{RunSetting, SettingSchedule, ToolMotion, World, WorldDescription, WorldError};
use evrig_core::time::{Span, Stamp, Unix};
use evrig_pi::read_clocks;
use evrig_session::rig::{Pose, Rig};
use evrig_session::trajectory::{StepSettings, ToolPath};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// A world rendered while its motion takes place.
#[derive(Debug)]
pub struct LiveWorld {
    world: Arc<World>,
    source: MotionSource,
    closed_at: Mutex<Option<Span>>,
}

/// Source of the tool's motion.
#[derive(Debug)]
enum MotionSource {
    Arm(TraceFollower),
    /// A path driven back and forth since an instant.
    Path(Instant),
}

impl ToolMotion for TraceFollower {
    fn pose_at(&self, time: Span) -> Pose {
        self.trace().pose_at(time)
    }
}

/// A path driven back and forth without end.
#[derive(Debug)]
struct BackAndForth(ToolPath);

impl ToolMotion for BackAndForth {
    fn pose_at(&self, time: Span) -> Pose {
        let length = self.0.duration().as_nanos().max(1);
        let since = time.as_nanos().rem_euclid(2 * length);
        self.0.pose_at(Span::from_nanos(since.min(2 * length - since)))
    }
}

impl LiveWorld {
    /// The world in which a simulated arm moves the cameras; the target is placed for the tool at
    /// `start`. World time is the arm's clock, and the clocks are this machine's.
    ///
    /// # Errors
    /// When the description is invalid, or asks for other clocks than this machine's.
    pub fn moved_by(
        arm: &ArmEmulator,
        rig: &Rig,
        start: Pose,
        description: &WorldDescription,
        seed: u64,
    ) -> Result<Arc<Self>, WorldError> {
        let follower = arm.follow();
        let description = on_this_machine(description, &|| follower.now())?;
        let schedule = SettingSchedule::new(vec![RunSetting::nominal(Span::ZERO, rig.davis.aps)]);
        let motion: Arc<dyn ToolMotion> = Arc::new(follower.clone());
        let world = World::over(rig, start, motion, schedule, &description, seed)?;
        Ok(Self::new(world, MotionSource::Arm(follower)))
    }

    /// The world in which the cameras move along a path and back without end.
    ///
    /// # Errors
    /// As [`Self::moved_by`].
    pub fn along(
        path: &ToolPath,
        rig: &Rig,
        description: &WorldDescription,
        seed: u64,
    ) -> Result<Arc<Self>, WorldError> {
        let begun = Instant::now();
        let now = || Span::from_secs_f64(begun.elapsed().as_secs_f64());
        let description = on_this_machine(description, &now)?;
        let schedule = SettingSchedule::new(vec![RunSetting::nominal(Span::ZERO, rig.davis.aps)]);
        let motion: Arc<dyn ToolMotion> = Arc::new(BackAndForth(path.clone()));
        let world = World::over(rig, path.start(), motion, schedule, &description, seed)?;
        Ok(Self::new(world, MotionSource::Path(begun)))
    }

    fn new(world: World, source: MotionSource) -> Arc<Self> {
        Arc::new(Self { world: Arc::new(world), source, closed_at: Mutex::new(None) })
    }

    /// The world that the twins render.
    #[must_use]
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// World time up to which the motion is known.
    #[must_use]
    pub fn known_until(&self) -> Span {
        match &self.source {
            MotionSource::Arm(follower) => follower.known_until(),
            MotionSource::Path(begun) => Span::from_secs_f64(begun.elapsed().as_secs_f64()),
        }
    }

    /// World time now.
    #[must_use]
    pub fn now(&self) -> Span {
        match &self.source {
            MotionSource::Arm(follower) => follower.now(),
            MotionSource::Path(begun) => Span::from_secs_f64(begun.elapsed().as_secs_f64()),
        }
    }

    /// Closes all cameras now, unless they are closed; gives the world time of closing.
    pub fn close(&self) -> Span {
        let mut closed_at = self.closed_at.lock().unwrap_or_else(PoisonError::into_inner);
        *closed_at.get_or_insert_with(|| self.now())
    }

    /// When the cameras were closed.
    #[must_use]
    pub fn closed_at(&self) -> Option<Span> {
        *self.closed_at.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets light and exposure from now on.
    pub fn set(&self, settings: &StepSettings) {
        self.world.set(RunSetting {
            start: self.now(),
            aps: settings.aps.unwrap_or(self.world.rig().davis.aps),
            exposure_scale: settings.exposure_scale.unwrap_or(1.0),
            light_level: settings.light_level.unwrap_or(1.0),
            n_flashes: settings.n_flashes,
        });
    }
}

/// How often the machine's clocks are compared with the world's; the shortest comparison counts.
const N_COMPARISONS: usize = 20;

/// The description with the clocks of this machine; `now` is the world's time.
fn on_this_machine(
    description: &WorldDescription,
    now: &dyn Fn() -> Span,
) -> Result<WorldDescription, WorldError> {
    let mut description = description.clone();
    let clocks = &mut description.clocks;
    let wrong = [
        ("clocks.pi_skew_ppm", clocks.pi_skew_ppm),
        ("clocks.pi_wall_offset_us", clocks.pi_wall_offset_us),
        ("clocks.pi_wall_steps", clocks.pi_wall_steps.first().map_or(0.0, |step| step[1])),
    ];
    if let Some((key, got)) = wrong.into_iter().find(|(_, value)| *value != 0.0) {
        let expected = "0: in real time the Pi's clocks are this machine's";
        return Err(WorldError::Range { key: key.to_owned(), got, expected: expected.to_owned() });
    }
    let compared = (0..N_COMPARISONS).map(|_| (now(), read_clocks(), now()));
    if let Some((before, read, after)) = compared.min_by_key(|(before, _, after)| *after - *before)
    {
        let middle = before + Span::from_nanos((after - before).as_nanos() / 2);
        let start: Stamp<Unix> = read.realtime - middle;
        clocks.unix_start_us = start.as_micros();
        clocks.pi_boot_ns = (read.boottime_before - middle).as_nanos();
    }
    Ok(description)
}
