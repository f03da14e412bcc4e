//! What one camera sees of the target: its geometry and its blurred copy of the target.

use super::error::WorldError;
use super::optics::{DistortedPinhole, ToolCamera, WorldPlane};
use super::target::PrintedTarget;
use super::texture::{TargetBlur, TargetTexture};
use evrig_core::units::Millimetres;
use evrig_session::rig::{CameraDescription, Mounting, Pose};
use nalgebra::Matrix3;

/// Texels along a DAVIS pixel: linear interpolation between them is then within 0.3 % of the light.
pub(super) const DAVIS_TEXELS_PER_PX: f64 = 8.0;
pub(super) const PI_TEXELS_PER_PX: f64 = 4.0;

/// More texels than any rig needs: half a gigabyte.
const MAX_TEXELS: usize = 120_000_000;

/// A camera, the target as its optics leave it, and the light that its lens takes away.
#[derive(Debug)]
pub(super) struct CameraView {
    pub(super) camera: ToolCamera,
    pub(super) texture: TargetTexture,
    /// The ray of each pixel, row-major.
    pub(super) rays: Vec<[f32; 2]>,
    /// Share of the light that reaches each pixel.
    pub(super) gains: Vec<f32>,
    /// The second derivative of what a pixel sees of the target is no more than this, in shares of
    /// white per square pixel: a black edge behind box and Gaussian bends by the Gaussian's peak.
    pub(super) bend_per_px2: f32,
}

/// What a view is made of.
pub(super) struct ViewOptions<'a> {
    pub(super) name: &'static str,
    pub(super) camera: &'a CameraDescription,
    pub(super) mounting: Mounting,
    pub(super) lens: DistortedPinhole,
    pub(super) psf_sigma_px: f64,
    pub(super) corner_loss: f64,
    pub(super) texels_per_px: f64,
    pub(super) stand_off: Millimetres,
}

/// From a ray to texel coordinates, row by row, the last entry near one.
#[derive(Debug, Clone, Copy)]
pub(super) struct TexelFromRay([f32; 9]);

impl CameraView {
    pub(super) fn new(
        target: &PrintedTarget,
        making: &ViewOptions<'_>,
    ) -> Result<Self, WorldError> {
        let camera =
            ToolCamera { mounting: making.mounting, lens: making.lens, size: making.camera.size };
        let per_px = making.texels_per_px;
        let per_mm = making.camera.pixels_per_mm(making.stand_off) * per_px;
        let blur = TargetBlur { aperture: per_px, sigma: making.psf_sigma_px * per_px };
        let pixels = TargetTexture::count(target, per_mm, blur);
        if pixels > MAX_TEXELS {
            return Err(WorldError::TooFine { camera: making.name, pixels, limit: MAX_TEXELS });
        }
        let texture = TargetTexture::new(target, per_mm, blur);
        let width = usize::from(camera.size.width);
        let gain = |i| camera.vignette(making.corner_loss, i % width, i / width) as f32;
        let gains = (0..camera.size.n_pixels()).map(gain).collect();
        let bend_per_px2 = (0.4 / making.psf_sigma_px.max(0.1)) as f32;
        Ok(Self { rays: camera.rays(), camera, texture, gains, bend_per_px2 })
    }

    /// From a ray of this camera to its texels when the tool is at `tool`.
    pub(super) fn texel_from_ray(&self, plane: &WorldPlane, tool: Pose) -> TexelFromRay {
        let [left, top] = self.texture.origin_mm;
        let k = self.texture.per_mm;
        let texel_from_mm = Matrix3::new(k, 0.0, -k * left, 0.0, k, -k * top, 0.0, 0.0, 1.0);
        let all = texel_from_mm * self.camera.plane_from_ray(plane, tool);
        let unit = if all[(2, 2)].abs() > 1e-12 { all / all[(2, 2)] } else { all };
        TexelFromRay(std::array::from_fn(|i| unit[(i / 3, i % 3)] as f32))
    }

    /// Millimetres on the target of texel coordinates.
    pub(super) fn mm_of_texel(&self, [x, y]: [f32; 2]) -> [f64; 2] {
        let [left, top] = self.texture.origin_mm;
        let k = self.texture.per_mm;
        [f64::from(x) / k + left, f64::from(y) / k + top]
    }

    /// Rays of the image's corners and its middle, to judge how far the image moves.
    pub(super) fn outermost_rays(&self) -> [[f32; 2]; 5] {
        let (width, n) = (usize::from(self.camera.size.width), self.rays.len());
        [0, width - 1, n - width, n - 1, n / 2 + width / 2].map(|i| self.rays[i.min(n - 1)])
    }
}

impl TexelFromRay {
    /// Texel coordinates of a ray; far outside for one that never meets the target.
    #[inline]
    pub(super) fn at(&self, [a, b]: [f32; 2]) -> [f32; 2] {
        let h = &self.0;
        let w = h[6] * a + h[7] * b + h[8];
        let scale = if w > 1e-6 { 1.0 / w } else { 1e9 };
        [(h[0] * a + h[1] * b + h[2]) * scale, (h[3] * a + h[4] * b + h[5]) * scale]
    }

    /// Whether two see the same.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        self.0 == other.0
    }
}
