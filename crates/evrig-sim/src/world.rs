//! The simulated world: a print under lamps, a tool that moves two cameras over it.
//!
//! It is written from the physics of light, lenses, pixels and clocks, apart
//! from the generators and the diagnosis, which are judged on what it shows:
//! a model is not proven on its own code.
//!
//! [`DavisTwin`] and [`PiTwin`] look at one [`World`] and give what the devices
//! would give. World time is a [`Span`] from the beginning of the path; what is
//! seen is a function of world, description and seed alone, never of threads or
//! of the pace at which a caller asks.

mod clocks;
mod davis;
mod description;
mod draws;
pub mod effects;
mod exposure;
mod host;
mod imu;
mod lamps;
mod light;
mod motion;
mod optics;
mod pi;
mod picture;
mod print;
mod problem;
mod range;
mod schedule;
#[cfg(test)]
mod stage;
#[cfg(test)]
mod tests;
mod texture;
mod view;

pub use clocks::Clocks;
pub use davis::{DAVIS_STEP, DavisPacket, DavisTwin};
pub use description::{
    ClocksOfWorld, DavisSensor, ImuSensor, PiSensorDescription, PrintDescription, WorldDescription,
};
pub use effects::Effects;
pub use motion::Motion;
pub use pi::{PiFrame, PiMetadata, PiTwin};
pub use problem::WorldError;
pub use schedule::{Schedule, Setting};

use evrig_core::time::Span;
use evrig_session::rig::{Pose, Rig};
use evrig_session::trajectory::ToolPath;
use lamps::Lamps;
use motion::Swing;
use nalgebra::{Matrix3, Vector3};
use optics::{Lens, Plane};
use print::Print;
use std::sync::{Arc, PoisonError, RwLock};
use view::{Making, View};

/// Texels along a DAVIS pixel: linear interpolation between them is then within 0.3 % of the light.
const DAVIS_TEXELS_PER_PX: f64 = 8.0;
const PI_TEXELS_PER_PX: f64 = 4.0;

/// Which camera a question is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraName {
    /// The event camera.
    Davis,
    /// The frame camera.
    Pi,
}

/// The world that the simulated cameras look at.
#[derive(Debug)]
pub struct World {
    rig: Rig,
    description: WorldDescription,
    seed: u64,
    motion: Arc<dyn Motion>,
    lamps: RwLock<Arc<Lamps>>,
    swing: Option<Swing>,
    clocks: Clocks,
    plane: Plane,
    print: Print,
    davis: View,
    pi: View,
}

impl World {
    /// A world in which the tool moves as `motion` says.
    ///
    /// # Errors
    /// When the description has a value that no world can have, the picture cannot be
    /// read, or a camera does not face the print.
    pub fn new(
        rig: &Rig,
        motion: Arc<dyn Motion>,
        schedule: Schedule,
        description: &WorldDescription,
        seed: u64,
    ) -> Result<Self, WorldError> {
        let start = motion.pose_at(Span::ZERO);
        Self::over(rig, start, motion, schedule, description, seed)
    }

    /// The same, with the print placed as the cameras see it when the tool is at `start`.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn over(
        rig: &Rig,
        start: Pose,
        motion: Arc<dyn Motion>,
        schedule: Schedule,
        description: &WorldDescription,
        seed: u64,
    ) -> Result<Self, WorldError> {
        description.check()?;
        let effects = &description.effects;
        let print = Print::new(&description.print, &rig.target)?;
        let frame = rig.mount.davis.frame(start);
        let swing = effects.vibration.map(|v| Swing::new(v, frame.right, frame.down));
        let plane = place_print(rig, start);
        let world = Self {
            davis: davis_view(rig, &print, description)?,
            pi: pi_view(rig, &print, description)?,
            lamps: RwLock::new(Arc::new(Lamps::new(schedule, effects))),
            clocks: Clocks::new(&description.clocks, effects.clock_offset, effects.clock_skew),
            rig: rig.clone(),
            description: description.clone(),
            seed,
            motion,
            swing,
            plane,
            print,
        };
        world.faces_print(start)?;
        Ok(world)
    }

    /// A world in which the tool runs along a path, with the path's settings of light and exposure.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn along(
        rig: &Rig,
        path: &ToolPath,
        description: &WorldDescription,
        seed: u64,
    ) -> Result<Self, WorldError> {
        let schedule = Schedule::of_path(path, rig.davis.aps);
        Self::new(rig, Arc::new(path.clone()), schedule, description, seed)
    }

    /// The rig it was made from.
    #[must_use]
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The description it was made from.
    #[must_use]
    pub fn description(&self) -> &WorldDescription {
        &self.description
    }

    /// Its clocks.
    #[must_use]
    pub fn clocks(&self) -> &Clocks {
        &self.clocks
    }

    /// Sets light, exposure and frames from a time on that nobody has looked at yet.
    pub fn set(&self, setting: Setting) {
        let mut lamps = self.lamps.write().unwrap_or_else(PoisonError::into_inner);
        *lamps = Arc::new(lamps.with(setting, &self.description.effects));
    }

    fn lamps(&self) -> Arc<Lamps> {
        Arc::clone(&self.lamps.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Where the tool truly is, vibration included.
    #[must_use]
    pub fn true_pose(&self, time: Span) -> Pose {
        let pose = self.motion.pose_at(time);
        match &self.swing {
            Some(swing) => swing.applied(pose, self.motion.speed_at(time), time.as_secs_f64()),
            None => pose,
        }
    }

    /// Where a place of the print (millimetres right and down from the middle of picture and tag) truly
    /// is in a camera's picture: continuous coordinates, pixel `i` covers `i..i + 1`. None behind it.
    #[must_use]
    pub fn pixel_of_place(
        &self,
        camera: CameraName,
        place_mm: [f64; 2],
        time: Span,
    ) -> Option<[f64; 2]> {
        let view = self.view(camera);
        let ray_from_plane = self.plane_from_ray(camera, time).try_inverse()?;
        let ray = ray_from_plane * Vector3::new(place_mm[0], place_mm[1], 1.0);
        (ray.z.abs() > 1e-12).then(|| view.camera.lens.pixel([ray.x / ray.z, ray.y / ray.z]))
    }

    /// The true homography from a ray of the camera (right and down over forward, distortion
    /// removed) to millimetres on the print.
    #[must_use]
    pub fn plane_from_ray(&self, camera: CameraName, time: Span) -> Matrix3<f64> {
        self.view(camera).camera.plane_from_ray(&self.plane, self.true_pose(time))
    }

    /// The light that a pixel truly gets at an instant, 1 where white in full light, free of noise.
    ///
    /// # Panics
    /// When the pixel does not lie on the sensor.
    #[must_use]
    pub fn light_on(&self, camera: CameraName, [x, y]: [u16; 2], time: Span) -> f32 {
        let view = self.view(camera);
        exposure::Exposure::new(self, view, time, time, 1).mean(view.camera.size.index(x, y))
    }

    /// Corners of the tag's black border on the print, clockwise from the top left, millimetres.
    #[must_use]
    pub fn tag_corners_mm(&self) -> [[f64; 2]; 4] {
        self.print.tag_corners_mm()
    }

    fn view(&self, camera: CameraName) -> &View {
        match camera {
            CameraName::Davis => &self.davis,
            CameraName::Pi => &self.pi,
        }
    }

    fn faces_print(&self, tool: Pose) -> Result<(), WorldError> {
        for (name, view) in [("davis", &self.davis), ("pi", &self.pi)] {
            let frame = view.camera.mounting.frame(tool);
            let [_, _, forward] = frame.to_camera(self.plane.centre);
            let towards = frame.forward.dot(&self.plane.right.cross(&self.plane.down));
            if forward < 1.0 || towards < 0.1 {
                return Err(WorldError::LooksAway { camera: name, tool: tool.to_string() });
            }
        }
        Ok(())
    }
}

/// Where the print lies: square to the DAVIS at the beginning, turned as the rig says.
fn place_print(rig: &Rig, start: Pose) -> Plane {
    let (davis, pi) = (rig.mount.davis.frame(start), rig.mount.pi.frame(start));
    let (sin, cos) = rig.target.rotation.0.to_radians().sin_cos();
    let between = (davis.centre_mm + pi.centre_mm) / 2.0;
    let centre = rig.target.centre.map_or(between + davis.forward * rig.target.stand_off.0, |c| {
        Vector3::from(c.map(evrig_core::units::Millimetres::value))
    });
    Plane {
        centre,
        right: davis.right * cos + davis.down * sin,
        down: davis.down * cos - davis.right * sin,
    }
}

fn davis_view(
    rig: &Rig,
    print: &Print,
    description: &WorldDescription,
) -> Result<View, WorldError> {
    let effects = &description.effects;
    let move_px = effects.misregistration.unwrap_or_default();
    let shift = [move_px.shift_x_px, move_px.shift_y_px];
    let defocus = effects.defocus.filter(|defocus| defocus.camera.has_davis());
    let vignetting = effects.vignetting.filter(|vignetting| vignetting.camera.has_davis());
    let psf = description.davis.psf_sigma_px;
    View::new(
        print,
        &Making {
            name: "davis",
            camera: &rig.davis.camera,
            mounting: rig.mount.davis,
            lens: Lens::new(&rig.davis.camera).moved(shift, move_px.rotation_deg, move_px.scale),
            psf_sigma_px: psf.hypot(defocus.map_or(0.0, |defocus| defocus.sigma_px)),
            corner_loss: vignetting.map_or(0.0, |vignetting| vignetting.corner_loss),
            texels_per_px: DAVIS_TEXELS_PER_PX,
            stand_off: rig.target.stand_off,
        },
    )
}

fn pi_view(rig: &Rig, print: &Print, description: &WorldDescription) -> Result<View, WorldError> {
    let effects = &description.effects;
    let defocus = effects.defocus.filter(|defocus| defocus.camera.has_pi());
    let vignetting = effects.vignetting.filter(|vignetting| vignetting.camera.has_pi());
    let psf = description.pi.psf_sigma_px;
    View::new(
        print,
        &Making {
            name: "pi",
            camera: &rig.pi.camera,
            mounting: rig.mount.pi,
            lens: Lens::new(&rig.pi.camera),
            psf_sigma_px: psf.hypot(defocus.map_or(0.0, |defocus| defocus.sigma_px)),
            corner_loss: vignetting.map_or(0.0, |vignetting| vignetting.corner_loss),
            texels_per_px: PI_TEXELS_PER_PX,
            stand_off: rig.target.stand_off,
        },
    )
}
