//! Photometric registration of the event camera's frames to the map.

use super::blur::PointSpread;
use super::davis::DavisTie;
use super::error::SceneError;
use super::picture::{Picture, Row, SHARED, Seen};
use super::robust::clustered;
use super::survey::Survey;
use super::tag_fit::{Before, TIES, changed, listed};
use super::tone::{Sample, Tone, tone};
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
    pub tie: DavisTie,
    /// Standard errors of rotation (rad), offset (mm), log focal length, radial distortion, lag (s)
    /// and skew, clustered over neighbouring frames. The lag includes the path's own time error.
    pub tie_error: [f64; TIES],
    /// Point-spread function from the map to the frames.
    pub spread: PointSpread,
    /// Standard error of the Gaussian, pixels.
    pub sigma_error_px: f64,
    /// Width of a pixel on the target, millimetres.
    pub pixel_mm: f64,
    /// Root-mean-square residual of the frames, DN.
    pub left_dn: f64,
    /// Root-mean-square residual displacement of single frames, pixels.
    pub left_px: f64,
    /// Root-mean-square relative error of the map's radiance, without the noise of single frames.
    #[serde(default)]
    pub light_error: f64,
    /// Tone of these frames against the map; None with too few smooth samples.
    #[serde(default)]
    pub tone: Option<Tone>,
    /// Frames used.
    pub n_frames: usize,
}

/// Most and fewest frames.
const FRAMES: usize = 60;
const LEAST: usize = 3;

/// Greatest accepted residual displacement, pixels; a vibrating head leaves about one pixel.
const MOST_LEFT_PX: f64 = 5.0;

/// Prior standard deviation of the Gaussian's width, pixels.
const SIGMA_PRIOR: f64 = 0.5;

/// Number of neighbouring pixels with common errors: so many count as one against the prior.
const ALIKE: f64 = 100.0;

/// Index of the lag in the alignment's parameters.
const LAG: usize = 8;

/// Lower bound of the expected light in relative residuals, as a share of white.
const DARK: f64 = 0.1;

/// Share trimmed at either end of a mean over cells.
const TRIM: f64 = 0.15;

/// Huber threshold in standard deviations.
const HUBER: f64 = 2.5;

/// One frame's equations with its gain and offset eliminated.
struct Part {
    normal: SMatrix<f64, SHARED, SHARED>,
    right: SVector<f64, SHARED>,
    squares: f64,
    n: usize,
    /// Displacement that would still improve this frame alone, pixels.
    shift_px: [f64; 2],
}

/// Refines an alignment photometrically.
///
/// # Errors
///
/// When too few frames fall on the path and the map, or they do not fit.
pub(super) fn register(
    survey: &Survey,
    start: DavisTie,
    before: &Before,
    frames: &[Frame<Davis>],
) -> Result<Registration, SceneError> {
    let pictures: Vec<Picture> = chosen(survey, &start, frames);
    if pictures.len() < LEAST {
        let (what, found, needed) = ("frames on the path", pictures.len(), LEAST);
        return Err(SceneError::NoDavis { what, found, n: frames.len(), needed });
    }
    let mut result = refined(survey, start, before, (&pictures, frames.len()))?;
    on_the_map(result.left_px)?;
    let pixel_mm = result.pixel_mm;
    let seen = Seen::new(survey, result.spread, pixel_mm);
    result.light_error = light_error(survey, &result.tie, &seen, &pictures, pixel_mm);
    let smooth = |picture: &Picture| picture.smooth(survey, &result.tie, &seen, pixel_mm);
    let samples: Vec<Vec<Sample>> = pictures.par_iter().filter_map(smooth).collect();
    result.tone = tone(&samples);
    let lag = &mut result.tie_error[LAG];
    *lag = lag.hypot(survey.path.time_error_s().unwrap_or(0.0));
    Ok(result)
}

fn on_the_map(left_px: f64) -> Result<(), SceneError> {
    if left_px <= MOST_LEFT_PX {
        return Ok(());
    }
    Err(SceneError::OffTheMap { left_px, most_px: MOST_LEFT_PX })
}

/// Alignment and blur with the least residual over the images, of `n` frames.
fn refined(
    survey: &Survey,
    start: DavisTie,
    before: &Before,
    (pictures, n): (&[Picture], usize),
) -> Result<Registration, SceneError> {
    let pixel_mm = pixel_mm(survey, &start);
    let mut tie = start;
    let mut spread = PointSpread::of_sigma(0.5);
    let mut noise = 25.0;
    let mut result = None;
    for round in 0..8 {
        let seen = Seen::new(survey, spread, pixel_mm);
        let parts: Vec<Part> = pictures
            .par_iter()
            .filter_map(|picture| picture.part(survey, &tie, &seen, noise))
            .collect();
        if parts.len() < LEAST {
            let (what, found, needed) = ("frames on the map", parts.len(), LEAST);
            return Err(SceneError::NoDavis { what, found, n, needed });
        }
        let (mut normal, mut right) = prior(&tie, before, spread);
        parts.iter().for_each(|part| {
            normal += part.normal;
            right += part.right;
        });
        let inverse =
            normal.try_inverse().ok_or(SceneError::NoFit("the event camera's place by light"))?;
        let change = inverse * right;
        let values: usize = parts.iter().map(|part| part.n).sum();
        let level = parts.iter().map(|part| part.squares).sum::<f64>() / values.max(1) as f64;
        let scores: Vec<_> = parts.iter().map(|part| part.right - part.normal * change).collect();
        let together = clustered(&inverse, &scores);
        noise *= level;
        tie = changed(&tie, &change.fixed_rows::<TIES>(0).into_owned());
        spread.sigma_px = (spread.sigma_px + change[TIES]).clamp(0.05, 5.0);
        let error = |i: usize| (inverse[(i, i)] * level).max(together[(i, i)]).max(0.0).sqrt();
        let square: f64 = parts.iter().map(|p| p.shift_px[0].powi(2) + p.shift_px[1].powi(2)).sum();
        result = Some(Registration {
            tie,
            tie_error: std::array::from_fn(error),
            spread,
            sigma_error_px: error(TIES),
            pixel_mm,
            left_dn: noise.sqrt(),
            left_px: (square / (2.0 * parts.len() as f64)).sqrt(),
            light_error: 0.0,
            tone: None,
            n_frames: parts.len(),
        });
        let settled = (0..SHARED).all(|i| change[i].abs() < 0.05 * error(i));
        if settled && round > 1 {
            break;
        }
    }
    result.ok_or(SceneError::NoFit("the event camera's place by light"))
}

/// Relative error of the map's radiance: variance of the cells' mean residuals over frames, less
/// the noise variance of those means.
fn light_error(
    survey: &Survey,
    tie: &DavisTie,
    seen: &Seen,
    pictures: &[Picture],
    pixel_mm: f64,
) -> f64 {
    let mut places: BTreeMap<[i64; 2], [f64; 3]> = BTreeMap::new();
    for rows in pictures.iter().filter_map(|picture| picture.rows(survey, tie, seen)) {
        let Some((gain, offset)) = level(&rows) else { continue };
        for row in rows {
            let expected = gain * row.light;
            let left =
                (row.value - offset - expected) / expected.max(gain * DARK * survey.white_dn);
            let sums = places.entry(row.place_mm.map(|mm| (mm / pixel_mm) as i64)).or_default();
            [sums[0], sums[1], sums[2]] = [sums[0] + 1.0, sums[1] + left, sums[2] + left * left];
        }
    }
    let of_place = |[n, sum, squares]: &[f64; 3]| {
        let mean = sum / n;
        (*n >= 4.0).then(|| mean * mean - (squares / n - mean * mean) / (n - 1.0))
    };
    let mut squares: Vec<f64> = places.values().filter_map(of_place).collect();
    squares.sort_by(f64::total_cmp);
    let cut = (TRIM * squares.len() as f64) as usize;
    // Trimmed, so that a few cells at the darkest edges do not dominate.
    let usual = &squares[cut..squares.len() - cut];
    (usual.iter().sum::<f64>() / usual.len().max(1) as f64).max(0.0).sqrt()
}

/// Width of a DAVIS pixel on the target at the middle of the path.
fn pixel_mm(survey: &Survey, tie: &DavisTie) -> f64 {
    let knots = &survey.path.knots;
    let distance = knots.get(knots.len() / 2).map_or(1.0, |knot| knot.pose[2]);
    let lens = &tie.mount.lens;
    (distance - tie.mount.offset_mm[2]) / (lens.focal_px * tie.mount.ln_focal.exp())
}

/// Frames evenly spread over the path.
fn chosen(survey: &Survey, tie: &DavisTie, frames: &[Frame<Davis>]) -> Vec<Picture> {
    let path = &survey.path;
    let on_path: Vec<&Frame<Davis>> = frames
        .iter()
        .filter(|frame| {
            let at = tie.path_s(tie.mapped_s(path, frame.timing.mid_exposure(0)));
            path.pose(at - 0.02).is_some() && path.pose(at + 0.02).is_some()
        })
        .collect();
    let step = (on_path.len() as f64 / FRAMES as f64).max(1.0);
    let n = (on_path.len() as f64 / step) as usize;
    (0..n).map(|i| Picture::new(survey, tie, on_path[(i as f64 * step) as usize])).collect()
}

fn prior(
    tie: &DavisTie,
    before: &Before,
    spread: PointSpread,
) -> (SMatrix<f64, SHARED, SHARED>, SVector<f64, SHARED>) {
    let list = listed(tie, &before.stated);
    let (mut normal, mut right) = (SMatrix::zeros(), SVector::zeros());
    for i in 0..TIES {
        normal[(i, i)] = ALIKE * before.sigma[i].powi(-2);
        right[i] = -list[i] * ALIKE * before.sigma[i].powi(-2);
    }
    normal[(TIES, TIES)] = SIGMA_PRIOR.powi(-2);
    right[TIES] = (0.5 - spread.sigma_px) * SIGMA_PRIOR.powi(-2);
    (normal, right)
}

impl Picture {
    fn part(&self, survey: &Survey, tie: &DavisTie, seen: &Seen, noise: f64) -> Option<Part> {
        let rows = self.rows(survey, tie, seen)?;
        if rows.len() < 200 {
            return None;
        }
        let (gain, offset) = level(&rows)?;
        let mut normal = SMatrix::<f64, SHARED, SHARED>::zeros();
        let mut right = SVector::<f64, SHARED>::zeros();
        let mut across = SMatrix::<f64, 2, SHARED>::zeros();
        let (mut own, mut own_right) = (Matrix2::<f64>::zeros(), Vector2::<f64>::zeros());
        let (mut shift, mut shift_right) = (Matrix2::<f64>::zeros(), Vector2::<f64>::zeros());
        let mut squares = 0.0;
        for row in &rows {
            let left = row.value - gain * row.light - offset;
            let sigmas = left.abs() / noise.sqrt();
            let weight = if sigmas > HUBER { HUBER / sigmas } else { 1.0 } / noise;
            let slopes = SVector::from(row.slopes) * gain;
            let level = Vector2::new(row.light, 1.0);
            let place = Vector2::from(row.by_place) * gain;
            normal.syger(weight, &slopes, &slopes, 1.0);
            right += weight * left * slopes;
            across += weight * level * slopes.transpose();
            own += weight * level * level.transpose();
            own_right += weight * left * level;
            shift += weight * place * place.transpose();
            shift_right += weight * left * place;
            squares += weight * left * left;
        }
        normal.fill_upper_triangle_with_lower_triangle();
        let own = own.try_inverse()?;
        let moved = shift.try_inverse()? * shift_right;
        Some(Part {
            normal: normal - across.transpose() * own * across,
            right: right - across.transpose() * (own * own_right),
            squares,
            n: rows.len(),
            shift_px: moved.into(),
        })
    }
}

/// Gain and offset by least squares.
fn level(rows: &[Row]) -> Option<(f64, f64)> {
    let n = rows.len() as f64;
    let mean = |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).sum::<f64>() / n;
    let (light, value) = (mean(&|row| row.light), mean(&|row| row.value));
    let across = mean(&|row| (row.light - light) * (row.value - value));
    let square = mean(&|row| (row.light - light).powi(2));
    (square > 0.0 && across > 0.0).then(|| (across / square, value - across / square * light))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_far_off_the_map_are_refused_and_those_of_a_head_that_shakes_are_not() {
        assert!(on_the_map(1.2).is_ok());
        let refused = on_the_map(23.549).unwrap_err().to_string();
        assert!(
            refused.contains("23.5 px off the map") && refused.contains("evrig sync"),
            "{refused}"
        );
        assert!(on_the_map(f64::NAN).is_err());
    }
}
