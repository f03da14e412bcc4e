//! The sessions of trials.

use super::error::ProveError;
use super::plasmode::{PlasmodeError, PlasmodeRecording};
use super::truth::{ConcealedTrial, Family};
use evrig_core::time::Span;
use evrig_session::import::{EpochChoice, import_aedat4};
use evrig_session::rig::Rig;
use evrig_session::trajectory::{OptionalSegments, Trajectory};
use evrig_sim::world::WorldDescription;
use evrig_sim::{Simulation, simulate};
use serde_json::json;
use std::path::Path;

/// Makes the sessions of a run.
#[derive(Debug, Clone)]
pub enum SessionMaker {
    /// The simulated rig, so many seconds a session.
    World {
        /// The rig; its RGB path is off, which no diagnosis looks at.
        rig: Box<Rig>,
        /// How long a session is at most.
        duration: Span,
    },
    /// A real recording, read once.
    Plasmode(Box<PlasmodeRecording>),
}

impl SessionMaker {
    /// The simulated rig.
    ///
    /// # Errors
    /// Never, as long as the bundled rig is sound.
    pub fn world(duration: Span) -> Result<Self, ProveError> {
        let plain = Rig::simulated().and_then(|rig| rig.without_rgb());
        let rig = plain.map_err(|e| describe("rig sim", &e))?;
        Ok(Self::World { rig: Box::new(rig), duration })
    }

    /// A real recording.
    ///
    /// # Errors
    /// When it cannot be read, or has no events or no frames.
    pub fn plasmode(recording: &Path) -> Result<Self, PlasmodeError> {
        Ok(Self::Plasmode(Box::new(PlasmodeRecording::read(recording)?)))
    }

    /// Whose sessions these are.
    #[must_use]
    pub const fn family(&self) -> Family {
        match self {
            Self::World { .. } => Family::World,
            Self::Plasmode(_) => Family::Plasmode,
        }
    }

    /// Makes the session of a trial at `root`, which is cleared before.
    ///
    /// # Errors
    /// When the trial asks for what cannot be hidden, or the disk refuses.
    pub fn make(&self, trial: &ConcealedTrial, root: &Path) -> Result<(), ProveError> {
        clear(root)?;
        match self {
            Self::World { rig, duration } => in_the_world(rig, *duration, trial, root),
            Self::Plasmode(recording) => {
                let mut changed = PlasmodeRecording::clone(recording);
                for effect in &trial.truth.effects {
                    changed.apply(effect, trial.seed)?;
                }
                import(&changed, root)
            }
        }
    }
}

/// Makes a session of a recording through the importer any other recording goes through.
fn import(recording: &PlasmodeRecording, root: &Path) -> Result<(), ProveError> {
    let file = root.with_extension("aedat4");
    let io = |source| ProveError::Io { path: file.clone(), source };
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).map_err(io)?;
    }
    recording.write(&file)?;
    import_aedat4(&file, root, EpochChoice::default(), &mut |_| {})?;
    std::fs::remove_file(&file).map_err(io)
}

fn in_the_world(
    rig: &Rig,
    duration: Span,
    trial: &ConcealedTrial,
    root: &Path,
) -> Result<(), ProveError> {
    let name = trial.trajectory.as_str();
    let trajectory = Trajectory::find(name).map_err(|e| describe(name, &e))?;
    let path = trajectory.path(rig, OptionalSegments::LeftOut).map_err(|e| describe(name, &e))?;
    let world = world(trial).map_err(|e| describe(&trial.name, &e))?;
    let simulation = Simulation {
        rig,
        trajectory: &trajectory,
        path: &path,
        world: &world,
        seed: trial.seed,
        out: root,
        duration: Some(duration.min(path.duration())),
    };
    simulate(&simulation, &mut |_| {})?;
    Ok(())
}

/// The world of a trial: nominal but for the image and what is hidden.
fn world(trial: &ConcealedTrial) -> Result<WorldDescription, serde_json::Error> {
    let effects: serde_json::Map<String, serde_json::Value> =
        trial.truth.effects.iter().map(|c| (c.id.clone(), c.description())).collect();
    let mut effects = serde_json::Value::Object(effects);
    if let Some(region) = &trial.truth.region {
        effects["region"] = json!(region);
    }
    serde_json::from_value(json!({ "target": { "image": trial.image }, "effects": effects }))
}

fn describe(what: &str, error: &dyn std::fmt::Display) -> ProveError {
    ProveError::Description { what: what.to_owned(), because: error.to_string() }
}

/// Removes a session; none is as well.
pub(super) fn clear(root: &Path) -> Result<(), ProveError> {
    match std::fs::remove_dir_all(root) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(ProveError::Io { path: root.to_owned(), source })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{TrialMix, draw};
    use super::*;

    #[test]
    fn what_is_hidden_in_a_part_of_the_image_reaches_the_world_as_such() {
        let mix = TrialMix { local: 3, ..TrialMix::none(Family::World) };
        for trial in draw(mix, 4) {
            let region = trial.truth.region.unwrap();
            let description = world(&trial).unwrap();
            let within = description.effects.region.unwrap();
            assert_eq!((within.x_px, within.y_px), (region.x_px, region.y_px));
            assert_eq!(description.effects.keys_on(), [trial.truth.effects[0].id.as_str()]);
        }
    }
}
