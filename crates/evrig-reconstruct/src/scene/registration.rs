//! Photometric registration of the event camera's frames to the map.

use super::clustered_covariance::clustered_covariance;
use super::davis_alignment::DavisAlignment;
use super::davis_image::{DavisImage, PixelEquation, PredictedMap, REGISTRATION_UNKNOWNS};
use super::error::SceneError;
use super::point_spread::PointSpread;
use super::reconstruction::Reconstruction;
use super::tag_alignment::{ALIGNMENT_DOF, AlignmentPrior, parameters_of, updated};
use super::tone::{ToneFit, ToneSample, fit_tone};
use evrig_core::frame::Frame;
use evrig_core::time::Davis;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Registration of the event camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Registration {
    /// Alignment to the path of the head.
    #[serde(alias = "tie")]
    pub alignment: DavisAlignment,
    /// Standard errors of rotation (rad), offset (mm), log focal length, radial distortion, lag (s)
    /// and skew, clustered over neighbouring frames. The lag includes the path's own time error.
    #[serde(alias = "tie_error")]
    pub alignment_error: [f64; ALIGNMENT_DOF],
    /// Point-spread function from the map to the frames.
    pub spread: PointSpread,
    /// Standard error of the Gaussian, pixels.
    pub sigma_error_px: f64,
    /// Width of a pixel on the target, millimetres.
    pub pixel_mm: f64,
    /// Root-mean-square residual of the frames, DN.
    #[serde(alias = "left_dn")]
    pub residual_dn: f64,
    /// Root-mean-square residual displacement of single frames, pixels.
    #[serde(alias = "left_px")]
    pub residual_px: f64,
    /// Root-mean-square relative error of the map's radiance, without the noise of single frames.
    #[serde(default)]
    pub light_error: f64,
    /// Tone of these frames against the map; None with too few smooth samples.
    #[serde(default)]
    pub tone: Option<ToneFit>,
    /// Frames used.
    pub n_frames: usize,
}

/// Most and fewest frames.
const MAX_FRAMES: usize = 60;
const MIN_FRAMES: usize = 3;
/// Greatest accepted residual displacement, pixels; a vibrating head leaves about one pixel.
const MAX_RESIDUAL_PX: f64 = 5.0;
/// Prior standard deviation of the Gaussian's width, pixels.
const SIGMA_PRIOR_PX: f64 = 0.5;
/// Number of neighbouring pixels with common errors: so many count as one against the prior.
const CORRELATED_PIXELS: f64 = 100.0;
/// Index of the lag in the alignment's parameters.
const LAG: usize = 8;
/// Lower bound of the expected light in relative residuals, as a share of white.
const MIN_WHITE_SHARE: f64 = 0.1;
/// Share trimmed at either end of a mean over cells.
const TRIM_SHARE: f64 = 0.15;
/// Huber threshold in standard deviations.
const HUBER_SIGMAS: f64 = 2.5;

/// One frame's equations with its gain and offset eliminated.
struct ReducedFrame {
    normal: SMatrix<f64, REGISTRATION_UNKNOWNS, REGISTRATION_UNKNOWNS>,
    right: SVector<f64, REGISTRATION_UNKNOWNS>,
    squares: f64,
    n: usize,
    /// Displacement that would still improve this frame alone, pixels.
    shift_px: [f64; 2],
}

/// Refines an alignment photometrically.
///
/// # Errors
/// When too few frames fall on the path and the map, or they do not fit.
pub(super) fn register(
    target: &Reconstruction,
    start: DavisAlignment,
    prior: &AlignmentPrior,
    frames: &[Frame<Davis>],
) -> Result<Registration, SceneError> {
    let images: Vec<DavisImage> = select_frames(target, &start, frames);
    if images.len() < MIN_FRAMES {
        let (what, found, needed) = ("frames on the path", images.len(), MIN_FRAMES);
        return Err(SceneError::NoDavis { what, found, n: frames.len(), needed });
    }
    let mut result = refine(target, start, prior, (&images, frames.len()))?;
    check_residual(result.residual_px)?;
    let pixel_mm = result.pixel_mm;
    let predicted = PredictedMap::new(target, result.spread, pixel_mm);
    result.light_error = light_error(target, &result.alignment, &predicted, &images, pixel_mm);
    let smooth_samples =
        |image: &DavisImage| image.smooth_samples(target, &result.alignment, &predicted, pixel_mm);
    let samples: Vec<Vec<ToneSample>> = images.par_iter().filter_map(smooth_samples).collect();
    result.tone = fit_tone(&samples);
    let lag = &mut result.alignment_error[LAG];
    *lag = lag.hypot(target.path.time_error_s().unwrap_or(0.0));
    Ok(result)
}

fn check_residual(residual_px: f64) -> Result<(), SceneError> {
    if residual_px <= MAX_RESIDUAL_PX {
        return Ok(());
    }
    Err(SceneError::OffTheMap { residual_px, max_px: MAX_RESIDUAL_PX })
}

/// Alignment and blur with the least residual over the images, of `n` frames.
fn refine(
    target: &Reconstruction,
    start: DavisAlignment,
    prior: &AlignmentPrior,
    (images, n): (&[DavisImage], usize),
) -> Result<Registration, SceneError> {
    let pixel_mm = pixel_mm(target, &start);
    let mut alignment = start;
    let mut spread = PointSpread::of_sigma(0.5);
    let mut noise = 25.0;
    let mut result = None;
    for round in 0..8 {
        let predicted = PredictedMap::new(target, spread, pixel_mm);
        let parts: Vec<ReducedFrame> = images
            .par_iter()
            .filter_map(|image| image.part(target, &alignment, &predicted, noise))
            .collect();
        if parts.len() < MIN_FRAMES {
            let (what, found, needed) = ("frames on the map", parts.len(), MIN_FRAMES);
            return Err(SceneError::NoDavis { what, found, n, needed });
        }
        let (mut normal, mut right) = prior_equations(&alignment, prior, spread);
        parts.iter().for_each(|part| {
            normal += part.normal;
            right += part.right;
        });
        let inverse = normal
            .try_inverse()
            .ok_or(SceneError::NoFit("the photometric registration of the event camera"))?;
        let change = inverse * right;
        let values: usize = parts.iter().map(|part| part.n).sum();
        let gain_and_offset =
            parts.iter().map(|part| part.squares).sum::<f64>() / values.max(1) as f64;
        let scores: Vec<_> = parts.iter().map(|part| part.right - part.normal * change).collect();
        let together = clustered_covariance(&inverse, &scores);
        noise *= gain_and_offset;
        alignment = updated(&alignment, &change.fixed_rows::<ALIGNMENT_DOF>(0).into_owned());
        spread.sigma_px = (spread.sigma_px + change[ALIGNMENT_DOF]).clamp(0.05, 5.0);
        let error =
            |i: usize| (inverse[(i, i)] * gain_and_offset).max(together[(i, i)]).max(0.0).sqrt();
        let square: f64 = parts.iter().map(|p| p.shift_px[0].powi(2) + p.shift_px[1].powi(2)).sum();
        result = Some(Registration {
            alignment,
            alignment_error: std::array::from_fn(error),
            spread,
            sigma_error_px: error(ALIGNMENT_DOF),
            pixel_mm,
            residual_dn: noise.sqrt(),
            residual_px: (square / (2.0 * parts.len() as f64)).sqrt(),
            light_error: 0.0,
            tone: None,
            n_frames: parts.len(),
        });
        let settled = (0..REGISTRATION_UNKNOWNS).all(|i| change[i].abs() < 0.05 * error(i));
        if settled && round > 1 {
            break;
        }
    }
    result.ok_or(SceneError::NoFit("the photometric registration of the event camera"))
}

/// Relative error of the map's radiance: variance of the cells' mean residuals over frames, less
/// the noise variance of those means.
fn light_error(
    target: &Reconstruction,
    alignment: &DavisAlignment,
    predicted: &PredictedMap,
    images: &[DavisImage],
    pixel_mm: f64,
) -> f64 {
    let mut places: BTreeMap<[i64; 2], [f64; 3]> = BTreeMap::new();
    for equations in images.iter().filter_map(|image| image.equations(target, alignment, predicted))
    {
        let Some((gain, offset)) = gain_and_offset(&equations) else { continue };
        for equation in equations {
            let expected = gain * equation.light;
            let residual = (equation.value - offset - expected)
                / expected.max(gain * MIN_WHITE_SHARE * target.white_dn);
            let sums =
                places.entry(equation.place_mm.map(|mm| (mm / pixel_mm) as i64)).or_default();
            [sums[0], sums[1], sums[2]] =
                [sums[0] + 1.0, sums[1] + residual, sums[2] + residual * residual];
        }
    }
    let of_place = |[n, sum, squares]: &[f64; 3]| {
        let mean = sum / n;
        (*n >= 4.0).then(|| mean * mean - (squares / n - mean * mean) / (n - 1.0))
    };
    let mut squares: Vec<f64> = places.values().filter_map(of_place).collect();
    squares.sort_by(f64::total_cmp);
    let cut = (TRIM_SHARE * squares.len() as f64) as usize;
    // Trimmed, so that a few cells at the darkest edges do not dominate.
    let usual = &squares[cut..squares.len() - cut];
    (usual.iter().sum::<f64>() / usual.len().max(1) as f64).max(0.0).sqrt()
}

/// Width of a DAVIS pixel on the target at the middle of the path.
fn pixel_mm(target: &Reconstruction, alignment: &DavisAlignment) -> f64 {
    let knots = &target.path.knots;
    let distance = knots.get(knots.len() / 2).map_or(1.0, |knot| knot.pose[2]);
    let lens = &alignment.mount.lens;
    (distance - alignment.mount.offset_mm[2]) / (lens.focal_px * alignment.mount.ln_focal.exp())
}

fn select_frames(
    target: &Reconstruction,
    alignment: &DavisAlignment,
    frames: &[Frame<Davis>],
) -> Vec<DavisImage> {
    let path = &target.path;
    let on_path: Vec<&Frame<Davis>> = frames
        .iter()
        .filter(|frame| {
            let at = alignment.path_s(alignment.mapped_s(path, frame.timing.mid_exposure(0)));
            path.pose(at - 0.02).is_some() && path.pose(at + 0.02).is_some()
        })
        .collect();
    let step = (on_path.len() as f64 / MAX_FRAMES as f64).max(1.0);
    let n = (on_path.len() as f64 / step) as usize;
    (0..n)
        .map(|i| DavisImage::new(target, alignment, on_path[(i as f64 * step) as usize]))
        .collect()
}

fn prior_equations(
    alignment: &DavisAlignment,
    prior: &AlignmentPrior,
    spread: PointSpread,
) -> (SMatrix<f64, REGISTRATION_UNKNOWNS, REGISTRATION_UNKNOWNS>, SVector<f64, REGISTRATION_UNKNOWNS>)
{
    let list = parameters_of(alignment, &prior.stated);
    let (mut normal, mut right) = (SMatrix::zeros(), SVector::zeros());
    for i in 0..ALIGNMENT_DOF {
        normal[(i, i)] = CORRELATED_PIXELS * prior.sigma[i].powi(-2);
        right[i] = -list[i] * CORRELATED_PIXELS * prior.sigma[i].powi(-2);
    }
    normal[(ALIGNMENT_DOF, ALIGNMENT_DOF)] = SIGMA_PRIOR_PX.powi(-2);
    right[ALIGNMENT_DOF] = (0.5 - spread.sigma_px) * SIGMA_PRIOR_PX.powi(-2);
    (normal, right)
}

impl DavisImage {
    fn part(
        &self,
        target: &Reconstruction,
        alignment: &DavisAlignment,
        predicted: &PredictedMap,
        noise: f64,
    ) -> Option<ReducedFrame> {
        let equations = self.equations(target, alignment, predicted)?;
        if equations.len() < 200 {
            return None;
        }
        let (gain, offset) = gain_and_offset(&equations)?;
        let mut normal = SMatrix::<f64, REGISTRATION_UNKNOWNS, REGISTRATION_UNKNOWNS>::zeros();
        let mut right = SVector::<f64, REGISTRATION_UNKNOWNS>::zeros();
        let mut across = SMatrix::<f64, 2, REGISTRATION_UNKNOWNS>::zeros();
        let (mut own, mut own_right) = (Matrix2::<f64>::zeros(), Vector2::<f64>::zeros());
        let (mut shift, mut shift_right) = (Matrix2::<f64>::zeros(), Vector2::<f64>::zeros());
        let mut squares = 0.0;
        for equation in &equations {
            let residual = equation.value - gain * equation.light - offset;
            let sigmas = residual.abs() / noise.sqrt();
            let weight = if sigmas > HUBER_SIGMAS { HUBER_SIGMAS / sigmas } else { 1.0 } / noise;
            let slopes = SVector::from(equation.slopes) * gain;
            let gain_and_offset = Vector2::new(equation.light, 1.0);
            let place = Vector2::from(equation.by_place) * gain;
            normal.syger(weight, &slopes, &slopes, 1.0);
            right += weight * residual * slopes;
            across += weight * gain_and_offset * slopes.transpose();
            own += weight * gain_and_offset * gain_and_offset.transpose();
            own_right += weight * residual * gain_and_offset;
            shift += weight * place * place.transpose();
            shift_right += weight * residual * place;
            squares += weight * residual * residual;
        }
        normal.fill_upper_triangle_with_lower_triangle();
        let own = own.try_inverse()?;
        let moved = shift.try_inverse()? * shift_right;
        Some(ReducedFrame {
            normal: normal - across.transpose() * own * across,
            right: right - across.transpose() * (own * own_right),
            squares,
            n: equations.len(),
            shift_px: moved.into(),
        })
    }
}

fn gain_and_offset(equations: &[PixelEquation]) -> Option<(f64, f64)> {
    let n = equations.len() as f64;
    let mean = |of: &dyn Fn(&PixelEquation) -> f64| equations.iter().map(of).sum::<f64>() / n;
    let (light, value) = (mean(&|equation| equation.light), mean(&|equation| equation.value));
    let across = mean(&|equation| (equation.light - light) * (equation.value - value));
    let square = mean(&|equation| (equation.light - light).powi(2));
    (square > 0.0 && across > 0.0).then(|| (across / square, value - across / square * light))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_far_off_the_map_are_refused_and_those_of_a_head_that_shakes_are_not() {
        assert!(check_residual(1.2).is_ok());
        let refused = check_residual(23.549).unwrap_err().to_string();
        assert!(
            refused.contains("23.5 px from the map") && refused.contains("evrig sync"),
            "{refused}"
        );
        assert!(check_residual(f64::NAN).is_err());
    }
}
