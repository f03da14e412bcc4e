//! The simulated world: a printed target under lamps, a tool that moves two cameras over it.
//!
//! It is written from the physics of light, lenses, pixels and clocks, apart from the generators
//! and the diagnosis that are tested on it: a model is not validated on its own code.
//!
//! [`DavisTwin`] and [`PiTwin`] observe one [`World`] and give what the devices would give. World
//! time is a [`Span`](evrig_core::time::Span) from the beginning of the path. The result is a
//! function of world, description and seed alone, never of threads or of the caller's pace.

mod clocks;
mod davis;
mod description;
mod draws;
pub mod effects;
mod error;
mod exposure;
mod host;
mod illumination;
mod imu;
mod lamps;
mod motion;
mod optics;
mod pi;
mod range;
mod scene;
mod schedule;
mod target;
mod target_image;
#[cfg(test)]
mod test_world;
#[cfg(test)]
mod tests;
mod texture;
mod view;

pub use clocks::WorldClocks;
pub use davis::{DAVIS_STEP, DavisPacket, DavisTwin};
pub use description::{
    DavisSensor, ImuSensor, PiSensorDescription, PrintedTargetDescription, WorldClocksDescription,
    WorldDescription,
};
pub use effects::WorldEffects;
pub use error::WorldError;
pub use motion::ToolMotion;
pub use pi::{PiTwin, SimulatedPiFrame, SimulatedPiMetadata};
pub use scene::{CameraName, World};
pub use schedule::{RunSetting, SettingSchedule};
