//! The world in real time: it follows what the arm really did, and its twins may lag behind.
//!
//! A twin works out what a camera sees no further than the motion is known, and it may take longer for
//! that than the time it is about. So cameras that are to close do so at one moment for all
//! ([`LiveWorld::close`]); what they saw before it is worked out afterwards.

use super::arm::{Emulator, Follower};
use super::world::{Motion, Schedule, Setting, World, WorldDescription, WorldError};
use evrig_core::time::{Span, Stamp, Unix};
use evrig_pi::read_clocks;
use evrig_session::rig::{Pose, Rig};
use evrig_session::trajectory::{StepSettings, ToolPath};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// A world that is lived through while it is looked at.
#[derive(Debug)]
pub struct LiveWorld {
    world: Arc<World>,
    source: Source,
    closed_at: Mutex<Option<Span>>,
}

/// What moves the tool.
#[derive(Debug)]
enum Source {
    Arm(Follower),
    /// A path driven to and fro since an instant.
    Path(Instant),
}

impl Motion for Follower {
    fn pose_at(&self, time: Span) -> Pose {
        self.trace().pose_at(time)
    }
}

/// A path there and back, for ever.
#[derive(Debug)]
struct ToAndFro(ToolPath);

impl Motion for ToAndFro {
    fn pose_at(&self, time: Span) -> Pose {
        let length = self.0.duration().as_nanos().max(1);
        let since = time.as_nanos().rem_euclid(2 * length);
        self.0.pose_at(Span::from_nanos(since.min(2 * length - since)))
    }
}

impl LiveWorld {
    /// The world in which a simulated arm moves the cameras; the print lies as they see it when the
    /// tool is at `start`. World time is the arm's clock, and the clocks are this machine's.
    ///
    /// # Errors
    /// When there is no such world, or it wants other clocks than this machine's.
    pub fn moved_by(
        arm: &Emulator,
        rig: &Rig,
        start: Pose,
        description: &WorldDescription,
        seed: u64,
    ) -> Result<Arc<Self>, WorldError> {
        let follower = arm.follow();
        let description = on_this_machine(description, &|| follower.now())?;
        let schedule = Schedule::new(vec![Setting::nominal(Span::ZERO, rig.davis.aps)]);
        let motion: Arc<dyn Motion> = Arc::new(follower.clone());
        let world = World::over(rig, start, motion, schedule, &description, seed)?;
        Ok(Self::new(world, Source::Arm(follower)))
    }

    /// The world in which the cameras go along a path and back, for ever.
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
        let schedule = Schedule::new(vec![Setting::nominal(Span::ZERO, rig.davis.aps)]);
        let motion: Arc<dyn Motion> = Arc::new(ToAndFro(path.clone()));
        let world = World::over(rig, path.start(), motion, schedule, &description, seed)?;
        Ok(Self::new(world, Source::Path(begun)))
    }

    fn new(world: World, source: Source) -> Arc<Self> {
        Arc::new(Self { world: Arc::new(world), source, closed_at: Mutex::new(None) })
    }

    /// What the twins look at.
    #[must_use]
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// World time up to which the motion is known.
    #[must_use]
    pub fn known_until(&self) -> Span {
        match &self.source {
            Source::Arm(follower) => follower.known_until(),
            Source::Path(begun) => Span::from_secs_f64(begun.elapsed().as_secs_f64()),
        }
    }

    /// World time now.
    #[must_use]
    pub fn now(&self) -> Span {
        match &self.source {
            Source::Arm(follower) => follower.now(),
            Source::Path(begun) => Span::from_secs_f64(begun.elapsed().as_secs_f64()),
        }
    }

    /// Closes all cameras now, unless they are closed; when that was.
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
        self.world.set(Setting {
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
