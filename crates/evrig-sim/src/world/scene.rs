//! The scene: a target under lamps and a tool that moves two cameras over it.

use super::clocks::WorldClocks;
use super::description::WorldDescription;
use super::error::WorldError;
use super::lamps::Lamps;
use super::motion::{ToolMotion, ToolVibration};
use super::optics::{DistortedPinhole, WorldPlane};
use super::schedule::{RunSetting, SettingSchedule};
use super::target::PrintedTarget;
use super::view::{CameraView, DAVIS_TEXELS_PER_PX, PI_TEXELS_PER_PX, ViewOptions};
use evrig_core::time::Span;
use evrig_session::rig::{Pose, Rig};
use evrig_session::trajectory::ToolPath;
use nalgebra::{Matrix3, Vector3};
use std::sync::{Arc, PoisonError, RwLock};

/// One of the two cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraName {
    /// The event camera.
    Davis,
    /// The frame camera.
    Pi,
}

/// The world of the simulated cameras.
#[derive(Debug)]
pub struct World {
    pub(super) rig: Rig,
    pub(super) description: WorldDescription,
    pub(super) seed: u64,
    pub(super) motion: Arc<dyn ToolMotion>,
    pub(super) lamps: RwLock<Arc<Lamps>>,
    pub(super) swing: Option<ToolVibration>,
    pub(super) clocks: WorldClocks,
    pub(super) plane: WorldPlane,
    pub(super) target: PrintedTarget,
    pub(super) davis: CameraView,
    pub(super) pi: CameraView,
}

impl World {
    /// A world in which the tool moves along `motion`.
    ///
    /// # Errors
    /// When a value is out of range, the target image cannot be read, or a camera does not face the
    /// target.
    pub fn new(
        rig: &Rig,
        motion: Arc<dyn ToolMotion>,
        schedule: SettingSchedule,
        description: &WorldDescription,
        seed: u64,
    ) -> Result<Self, WorldError> {
        let start = motion.pose_at(Span::ZERO);
        Self::over(rig, start, motion, schedule, description, seed)
    }

    /// The same, with the target placed for the tool at `start`.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn over(
        rig: &Rig,
        start: Pose,
        motion: Arc<dyn ToolMotion>,
        schedule: SettingSchedule,
        description: &WorldDescription,
        seed: u64,
    ) -> Result<Self, WorldError> {
        description.check()?;
        let effects = &description.effects;
        let target = PrintedTarget::new(&description.target, &rig.target)?;
        let frame = rig.mount.davis.frame(start);
        let swing = effects.vibration.map(|v| ToolVibration::new(v, frame.right, frame.down));
        let plane = place_target(rig, start);
        let world = Self {
            davis: davis_view(rig, &target, description)?,
            pi: pi_view(rig, &target, description)?,
            lamps: RwLock::new(Arc::new(Lamps::new(schedule, effects))),
            clocks: WorldClocks::new(&description.clocks, effects.clock_offset, effects.clock_skew),
            rig: rig.clone(),
            description: description.clone(),
            seed,
            motion,
            swing,
            plane,
            target,
        };
        world.check_target_is_in_view(start)?;
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
        let schedule = SettingSchedule::of_path(path, rig.davis.aps);
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
    pub fn clocks(&self) -> &WorldClocks {
        &self.clocks
    }

    /// Sets light, exposure and frames from a time on that was not rendered yet.
    pub fn set(&self, setting: RunSetting) {
        let mut lamps = self.lamps.write().unwrap_or_else(PoisonError::into_inner);
        *lamps = Arc::new(lamps.with(setting, &self.description.effects));
    }

    pub(super) fn lamps(&self) -> Arc<Lamps> {
        Arc::clone(&self.lamps.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// True pose of the tool, vibration included.
    #[must_use]
    pub fn true_pose(&self, time: Span) -> Pose {
        let pose = self.motion.pose_at(time);
        match &self.swing {
            Some(swing) => swing.applied(pose, self.motion.speed_at(time), time.as_secs_f64()),
            None => pose,
        }
    }

    /// True position of a point of the target (millimetres right and down from the middle of image
    /// and tag) in a camera's image: continuous coordinates, pixel `i` covers `i..i + 1`. None
    /// behind it.
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
    /// removed) to millimetres on the target.
    #[must_use]
    pub fn plane_from_ray(&self, camera: CameraName, time: Span) -> Matrix3<f64> {
        self.view(camera).camera.plane_from_ray(&self.plane, self.true_pose(time))
    }

    /// Corners of the tag's black border on the target, clockwise from the top left, millimetres.
    #[must_use]
    pub fn tag_corners_mm(&self) -> [[f64; 2]; 4] {
        self.target.tag_corners_mm()
    }

    pub(super) fn view(&self, camera: CameraName) -> &CameraView {
        match camera {
            CameraName::Davis => &self.davis,
            CameraName::Pi => &self.pi,
        }
    }

    fn check_target_is_in_view(&self, tool: Pose) -> Result<(), WorldError> {
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

/// Pose of the target: parallel to the sensor of the DAVIS at the beginning, rotated as the rig
/// states.
fn place_target(rig: &Rig, start: Pose) -> WorldPlane {
    let (davis, pi) = (rig.mount.davis.frame(start), rig.mount.pi.frame(start));
    let (sin, cos) = rig.target.rotation.0.to_radians().sin_cos();
    let between = (davis.centre_mm + pi.centre_mm) / 2.0;
    let centre = rig.target.centre.map_or(between + davis.forward * rig.target.stand_off.0, |c| {
        Vector3::from(c.map(evrig_core::units::Millimetres::value))
    });
    WorldPlane {
        centre,
        right: davis.right * cos + davis.down * sin,
        down: davis.down * cos - davis.right * sin,
    }
}

fn davis_view(
    rig: &Rig,
    target: &PrintedTarget,
    description: &WorldDescription,
) -> Result<CameraView, WorldError> {
    let effects = &description.effects;
    let move_px = effects.misregistration.unwrap_or_default();
    let shift = [move_px.shift_x_px, move_px.shift_y_px];
    let defocus = effects.defocus.filter(|defocus| defocus.camera.has_davis());
    let vignetting = effects.vignetting.filter(|vignetting| vignetting.camera.has_davis());
    let psf = description.davis.psf_sigma_px;
    CameraView::new(
        target,
        &ViewOptions {
            name: "davis",
            camera: &rig.davis.camera,
            mounting: rig.mount.davis,
            lens: DistortedPinhole::new(&rig.davis.camera).moved(
                shift,
                move_px.rotation_deg,
                move_px.scale,
            ),
            psf_sigma_px: psf.hypot(defocus.map_or(0.0, |defocus| defocus.sigma_px)),
            corner_loss: vignetting.map_or(0.0, |vignetting| vignetting.corner_loss),
            texels_per_px: DAVIS_TEXELS_PER_PX,
            stand_off: rig.target.stand_off,
        },
    )
}

fn pi_view(
    rig: &Rig,
    target: &PrintedTarget,
    description: &WorldDescription,
) -> Result<CameraView, WorldError> {
    let effects = &description.effects;
    let defocus = effects.defocus.filter(|defocus| defocus.camera.has_pi());
    let vignetting = effects.vignetting.filter(|vignetting| vignetting.camera.has_pi());
    let psf = description.pi.psf_sigma_px;
    CameraView::new(
        target,
        &ViewOptions {
            name: "pi",
            camera: &rig.pi.camera,
            mounting: rig.mount.pi,
            lens: DistortedPinhole::new(&rig.pi.camera),
            psf_sigma_px: psf.hypot(defocus.map_or(0.0, |defocus| defocus.sigma_px)),
            corner_loss: vignetting.map_or(0.0, |vignetting| vignetting.corner_loss),
            texels_per_px: PI_TEXELS_PER_PX,
            stand_off: rig.target.stand_off,
        },
    )
}
