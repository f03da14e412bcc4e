//! Illumination that moves over the target, such as a passing shadow.
//!
//! The log ratio of each frame to the map is averaged on a coarse grid. Each value is modelled as a
//! term of the frame (the lamps' level), a term of the cell (the mean over time is in the map), and
//! a profile along `x cos d + y sin d - v t`. Direction and speed minimise the residual variance.

use super::coarse_grid::CoarseGrid;
use super::map::RadianceMap;
use super::path::PathKnot;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Step of the profile, millimetres.
const STEP_MM: f64 = 2.0;
/// Least root-mean-square change of the illumination beyond noise; smaller changes are below an
/// event threshold.
const MIN_RMS: f64 = 0.01;
/// Least share of the variance explained by the moving profile.
const MIN_EXPLAINED: f64 = 0.6;
/// Least distance travelled during the recording, millimetres.
const MIN_TRAVEL_MM: f64 = 10.0;
/// Search range and steps: speed (mm/s), direction, and duration of the first interval.
const MAX_SPEED_MM_PER_S: f64 = 150.0;
const SPEED_STEP_MM_PER_S: f64 = 4.0;
const DIRECTION_STEP_DEG: f64 = 6.0;
const FIRST_INTERVAL_S: f64 = 2.0;
/// Observations used to score one velocity, approximately.
const SCORED_OBSERVATIONS: usize = 30_000;
/// Least number of observations of a profile step, as a share of the maximum.
const MIN_COVERAGE: f64 = 0.05;
/// Quantile of the profile that defines the level beside a shadow, and the bound of the slope that
/// is removed (logarithm per millimetre).
const LEVEL_QUANTILE: f64 = 0.75;
const MAX_SLOPE_PER_MM: f64 = 0.1;
/// Alternating rounds of frame, cell and profile terms.
const ROUNDS: usize = 3;
/// Share of the depth lost to the resolution of grid and profile, and the number of neighbouring
/// cells with common errors.
const RESOLUTION_ERROR: f64 = 0.02;
const CORRELATED_CELLS: f64 = 10.0;

/// A one-dimensional illumination profile that moves over the target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MovingIllumination {
    /// Direction of motion, clockwise from the target's right.
    pub direction_deg: f64,
    /// Speed.
    pub speed_mm_per_s: f64,
    /// Position of the profile's first value along the direction of motion at path time zero.
    pub from_mm: f64,
    /// Log illumination along the direction of motion, every 2 mm; 0 where unattenuated.
    pub ln_light: Vec<f64>,
    /// Attenuation at the deepest point, as a share of the light, with its standard error.
    pub depth: [f64; 2],
    /// Share of the illumination variance, apart from the lamps' level, that moves with it.
    pub share: f64,
}

impl MovingIllumination {
    pub(super) fn with_power(mut self, power: f64) -> Self {
        self.ln_light.iter_mut().for_each(|ln| *ln *= power);
        let [depth, error] = self.depth;
        self.depth =
            [1.0 - (1.0 - depth).powf(power), error * power * (1.0 - depth).powf(power - 1.0)];
        self
    }

    /// Log illumination at a target position and path time.
    #[must_use]
    pub fn ln_at(&self, place_mm: [f64; 2], time_s: f64) -> f64 {
        let course =
            ProfileMotion { direction_deg: self.direction_deg, speed: self.speed_mm_per_s };
        let at = (course.position_mm(place_mm, time_s) - self.from_mm) / STEP_MM;
        let last = self.ln_light.len() as f64 - 1.0;
        let at = at.clamp(0.0, last.max(0.0));
        let i = (at as usize).min(self.ln_light.len().saturating_sub(2));
        let [a, b] = [i, i + 1].map(|i| self.ln_light.get(i).copied().unwrap_or(0.0));
        a + (b - a) * (at - i as f64)
    }
}

#[derive(Debug, Clone, Copy)]
struct ProfileMotion {
    direction_deg: f64,
    speed: f64,
}

impl ProfileMotion {
    fn position_mm(&self, [x, y]: [f64; 2], time_s: f64) -> f64 {
        let (sin, cos) = self.direction_deg.to_radians().sin_cos();
        x * cos + y * sin - self.speed * time_s
    }
}

#[derive(Debug, Clone, Copy)]
struct CellRatio {
    frame: usize,
    cell: usize,
    ln: f64,
}

/// Log ratios of all frames on the coarse grid.
pub(super) struct CellRatios<'a> {
    grid: CoarseGrid,
    times_s: Vec<f64>,
    levels: Vec<&'a [f32]>,
}

struct IlluminationTerms {
    frames: Vec<f64>,
    cells: Vec<f64>,
    along: Vec<f64>,
    n_along: Vec<f64>,
    from_mm: f64,
    residual: f64,
}

/// The profile, the lamps' log level of each frame, and the log factor that removes the mean
/// profile from each cell of the map.
pub(super) struct IlluminationFit {
    pub(super) light: MovingIllumination,
    pub(super) ln_lamps: Vec<f64>,
    pub(super) grid: CoarseGrid,
    pub(super) ln_cells: Vec<f64>,
}

impl<'a> CellRatios<'a> {
    pub(super) fn new(
        grid: CoarseGrid,
        frames: impl Iterator<Item = (&'a PathKnot, &'a [f32])>,
    ) -> Self {
        let (times_s, levels) = frames.map(|(knot, levels)| (knot.time_s, levels)).unzip();
        Self { grid, times_s, levels }
    }

    pub(super) fn fit(&self) -> Option<IlluminationFit> {
        let length_s = self.times_s.last()? - self.times_s.first()?;
        let all = self.observations([f64::NEG_INFINITY, f64::INFINITY], usize::MAX);
        let still = self.terms(&all, None);
        let noise = self.noise(&all, &still);
        if (still.residual - noise).max(0.0).sqrt() < MIN_RMS {
            return None;
        }
        let course = self.local_search(self.grid_search(length_s)?, length_s);
        if course.speed.abs() * length_s < MIN_TRAVEL_MM {
            return None;
        }
        let moving = self.terms(&all, Some(course));
        let share = (still.residual - moving.residual) / (still.residual - noise);
        (share > MIN_EXPLAINED).then(|| self.assemble(course, moving, share))
    }

    /// Observations in a time interval, thinned to about `n` by leaving out frames.
    fn observations(&self, [from, to]: [f64; 2], n: usize) -> Vec<CellRatio> {
        let inside: Vec<usize> =
            (0..self.times_s.len()).filter(|&k| (from..=to).contains(&self.times_s[k])).collect();
        let each = self.levels.first().map_or(1, |levels| levels.len().max(1));
        let step = (inside.len() * each).div_ceil(n).max(1);
        let of_frame = |&frame: &usize| {
            let known = self.levels[frame].iter().enumerate().filter(|(_, ln)| ln.is_finite());
            known.map(move |(cell, &ln)| CellRatio { frame, cell, ln: f64::from(ln) })
        };
        inside.iter().step_by(step).flat_map(of_frame).collect()
    }

    /// Variance of one observation, from differences between consecutive frames.
    fn noise(&self, observations: &[CellRatio], terms: &IlluminationTerms) -> f64 {
        let mut last = vec![(usize::MAX, 0.0); terms.cells.len()];
        let (mut sum, mut n) = (0.0, 0.0);
        for &CellRatio { frame, cell, ln } in observations {
            let residual = ln - terms.frames[frame] - terms.cells[cell];
            let (before, other) = std::mem::replace(&mut last[cell], (frame, residual));
            if before.checked_add(1) == Some(frame) {
                (sum, n) = (sum + (residual - other).powi(2) / 2.0, n + 1.0);
            }
        }
        if n > 0.0 { sum / n } else { 0.0 }
    }

    /// Fits the terms for a velocity; frame and cell terms alone without one.
    fn terms(
        &self,
        observations: &[CellRatio],
        course: Option<ProfileMotion>,
    ) -> IlluminationTerms {
        let position_mm = |one: &CellRatio| {
            course.map_or(0.0, |course| {
                course.position_mm(self.grid.middle_mm(one.cell), self.times_s[one.frame])
            })
        };
        let positions: Vec<f64> = observations.iter().map(position_mm).collect();
        let from_mm = positions.iter().copied().fold(f64::INFINITY, f64::min);
        let at: Vec<usize> = positions
            .iter()
            .map(|position_mm| ((position_mm - from_mm) / STEP_MM) as usize)
            .collect();
        let mut along = vec![0.0; at.iter().max().map_or(1, |most| most + 1)];
        let mut frames = vec![0.0; self.times_s.len()];
        let mut cells = vec![0.0; self.grid.width * self.grid.height];
        let all = || observations.iter().zip(at.iter().copied());
        let mut counts = Vec::new();
        for _ in 0..ROUNDS {
            means(all().map(|(s, at)| (s.frame, s.ln - cells[s.cell] - along[at])), &mut frames);
            means(all().map(|(s, at)| (s.cell, s.ln - frames[s.frame] - along[at])), &mut cells);
            if course.is_some() {
                let rest =
                    |(s, at): (&CellRatio, usize)| (at, s.ln - frames[s.frame] - cells[s.cell]);
                counts = means(all().map(rest), &mut along);
            }
        }
        let residual =
            |(s, at): (&CellRatio, usize)| s.ln - frames[s.frame] - cells[s.cell] - along[at];
        let residual =
            all().map(|one| residual(one).powi(2)).sum::<f64>() / observations.len().max(1) as f64;
        IlluminationTerms { frames, cells, along, n_along: counts, from_mm, residual }
    }

    fn residual(&self, observations: &[CellRatio], course: ProfileMotion) -> f64 {
        self.terms(observations, Some(course)).residual
    }

    /// Best velocity on a grid over the first interval.
    fn grid_search(&self, length_s: f64) -> Option<ProfileMotion> {
        let from = *self.times_s.first()?;
        let observations =
            self.observations([from, from + length_s.min(FIRST_INTERVAL_S)], SCORED_OBSERVATIONS);
        let n_speeds = (MAX_SPEED_MM_PER_S / SPEED_STEP_MM_PER_S) as i32;
        let directions =
            (0..(180.0 / DIRECTION_STEP_DEG) as i32).map(|i| f64::from(i) * DIRECTION_STEP_DEG);
        let courses: Vec<ProfileMotion> = directions
            .flat_map(|direction_deg| {
                let speeds = (-n_speeds..=n_speeds).filter(|i| *i != 0);
                speeds.map(move |i| ProfileMotion {
                    direction_deg,
                    speed: f64::from(i) * SPEED_STEP_MM_PER_S,
                })
            })
            .collect();
        let residuals: Vec<f64> =
            courses.par_iter().map(|course| self.residual(&observations, *course)).collect();
        let best = (0..courses.len()).min_by(|&a, &b| residuals[a].total_cmp(&residuals[b]))?;
        Some(courses[best])
    }

    /// Local search over intervals of doubling length.
    fn local_search(&self, mut course: ProfileMotion, length_s: f64) -> ProfileMotion {
        let Some(&from) = self.times_s.first() else { return course };
        let mut stretch_s = FIRST_INTERVAL_S;
        let mut steps = [DIRECTION_STEP_DEG / 2.0, SPEED_STEP_MM_PER_S / 2.0];
        loop {
            let observations = self.observations([from, from + stretch_s], SCORED_OBSERVATIONS);
            for _ in 0..5 {
                let [turn, faster] = steps;
                let near: Vec<ProfileMotion> = (0..9)
                    .map(|i| ProfileMotion {
                        direction_deg: course.direction_deg + turn * f64::from(i % 3 - 1),
                        speed: course.speed + faster * f64::from(i / 3 - 1),
                    })
                    .collect();
                let residuals: Vec<f64> =
                    near.par_iter().map(|near| self.residual(&observations, *near)).collect();
                let best = (0..near.len()).min_by(|&a, &b| residuals[a].total_cmp(&residuals[b]));
                match best.filter(|best| residuals[*best] < residuals[4]) {
                    Some(best) => course = near[best],
                    None => steps = steps.map(|step| step / 2.0),
                }
            }
            if stretch_s >= length_s {
                return course;
            }
            stretch_s *= 2.0;
        }
    }

    fn assemble(
        &self,
        course: ProfileMotion,
        terms: IlluminationTerms,
        share: f64,
    ) -> IlluminationFit {
        let IlluminationTerms { frames, mut cells, mut along, n_along, from_mm, residual } = terms;
        let most = n_along.iter().copied().fold(0.0, f64::max);
        let is_known = |i: usize| n_along[i] >= MIN_COVERAGE * most;
        // A linear slope of the profile is not identifiable: slopes of the cells and a trend of the
        // frames can replace it. The profile is made level beside a shadow.
        let position_mm = |i: usize| from_mm + (i as f64 + 0.5) * STEP_MM;
        let points: Vec<[f64; 2]> =
            (0..along.len()).filter(|&i| is_known(i)).map(|i| [position_mm(i), along[i]]).collect();
        let slope = level_slope(&points);
        along.iter_mut().enumerate().for_each(|(i, ln)| *ln -= slope * position_mm(i));
        for (cell, ln) in cells.iter_mut().enumerate() {
            *ln += slope * course.position_mm(self.grid.middle_mm(cell), 0.0);
        }
        let trend = |time_s: f64| -slope * course.speed * time_s;
        let frames: Vec<f64> =
            frames.iter().zip(&self.times_s).map(|(ln, time_s)| ln + trend(*time_s)).collect();
        let mut known: Vec<f64> =
            (0..along.len()).filter(|&i| is_known(i)).map(|i| along[i]).collect();
        known.sort_by(f64::total_cmp);
        // The 90 % quantile counts as unattenuated.
        let top = known[known.len() * 9 / 10];
        let deepest = (0..along.len())
            .filter(|&i| is_known(i))
            .min_by(|&a, &b| along[a].total_cmp(&along[b]));
        let deepest = deepest.unwrap_or(0);
        let bottom = parabola_minimum(&along, deepest);
        for i in 0..along.len() {
            // Steps with too few observations take their neighbour's value.
            if !is_known(i) {
                along[i] = if i > 0 { along[i - 1] } else { top };
            }
        }
        let depth = 1.0 - (bottom - top).exp();
        let of_mean = (residual * CORRELATED_CELLS / n_along[deepest].max(1.0)).sqrt();
        let error = ((1.0 - depth) * of_mean).hypot(RESOLUTION_ERROR * depth);
        let light = MovingIllumination {
            direction_deg: course.direction_deg,
            speed_mm_per_s: course.speed,
            from_mm: from_mm + STEP_MM / 2.0,
            ln_light: along.iter().map(|ln| ln - top).collect(),
            depth: [depth, error],
            share,
        };
        let ln_lamps = frames.iter().map(|ln| ln + top).collect();
        IlluminationFit { light, ln_lamps, grid: self.grid, ln_cells: cells }
    }
}

impl IlluminationFit {
    /// Divides the time-averaged profile out of a map.
    pub(super) fn remove_from(&self, map: &mut RadianceMap) {
        let grid = map.grid;
        for (i, value) in map.radiance.values.iter_mut().enumerate() {
            let place = grid.place_mm(i % grid.width, i / grid.width);
            *value *= self.grid.interpolate(&self.ln_cells, place).exp() as f32;
        }
    }
}

/// Slope of the 75 % quantile regression line: of the level beside troughs.
fn level_slope(points: &[[f64; 2]]) -> f64 {
    let loss = |slope: f64| {
        let mut rest: Vec<f64> =
            points.iter().map(|[position_mm, ln]| ln - slope * position_mm).collect();
        rest.sort_by(f64::total_cmp);
        let line = evrig_core::stats::quantile_sorted(&rest, LEVEL_QUANTILE);
        let pinball = |r: &f64| {
            if *r > line {
                LEVEL_QUANTILE * (r - line)
            } else {
                (1.0 - LEVEL_QUANTILE) * (line - r)
            }
        };
        rest.iter().map(pinball).sum::<f64>()
    };
    // The loss is convex: ternary search.
    let (mut low, mut high) = (-MAX_SLOPE_PER_MM, MAX_SLOPE_PER_MM);
    for _ in 0..60 {
        let [a, b] = [(2.0 * low + high) / 3.0, (low + 2.0 * high) / 3.0];
        if loss(a) < loss(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

/// Group means in place; returns the group sizes.
fn means(values: impl Iterator<Item = (usize, f64)>, means: &mut [f64]) -> Vec<f64> {
    let mut counts = vec![0.0; means.len()];
    means.fill(0.0);
    for (number, value) in values {
        means[number] += value;
        counts[number] += 1.0;
    }
    means.iter_mut().zip(&counts).filter(|(_, n)| **n > 0.0).for_each(|(sum, n)| *sum /= n);
    counts
}

/// Minimum of the parabola through five values about the lowest one.
fn parabola_minimum(along: &[f64], lowest: usize) -> f64 {
    let at = lowest.clamp(2, along.len().saturating_sub(3).max(2));
    let Some(five) = along.get(at - 2..at + 3) else { return along[lowest] };
    let [a, b, c, d, e] = [five[0], five[1], five[2], five[3], five[4]];
    let bend = (2.0 * a - b - 2.0 * c - d + 2.0 * e) / 14.0;
    let slope = (-2.0 * a - b + d + 2.0 * e) / 10.0;
    let middle = (a + b + c + d + e) / 5.0 - 2.0 * bend;
    if bend > 0.0 && (slope / (2.0 * bend)).abs() <= 2.0 {
        middle - slope * slope / (4.0 * bend)
    } else {
        along[lowest]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::stats::SplitMix;

    const SQUARES: CoarseGrid = CoarseGrid { origin_mm: [-50.0, -40.0], width: 34, height: 27 };

    /// Log ratios of a band of shadow, 8 mm wide, every 100 mm; the map has its mean.
    fn levels(depth: f64, direction_deg: f64, speed: f64, noise: f64) -> (Vec<f64>, Vec<Vec<f32>>) {
        let course = ProfileMotion { direction_deg, speed };
        let mut random = SplitMix::new(3, 3);
        let shade = |place, t: f64| {
            let position_mm: f64 = course.position_mm(place, t);
            let from_middle = (position_mm + 50.0).rem_euclid(100.0) - 50.0;
            (1.0 - depth * (-(from_middle / 8.0_f64).powi(2) / 2.0).exp()).ln()
        };
        let times: Vec<f64> = (0..240).map(|k| f64::from(k) / 120.0).collect();
        let n = SQUARES.width * SQUARES.height;
        let mean: Vec<f64> = (0..n)
            .map(|i| times.iter().map(|t| shade(SQUARES.middle_mm(i), *t)).sum::<f64>() / 240.0)
            .collect();
        let of = |t: &f64| {
            (0..n)
                .map(|i| {
                    let lamps = 0.01 * (t * 9.0).sin();
                    let ln = lamps + shade(SQUARES.middle_mm(i), *t) - mean[i];
                    (ln + noise * random.normal()) as f32
                })
                .collect()
        };
        let all = times.iter().map(of).collect();
        (times, all)
    }

    fn moving((times_s, all): &(Vec<f64>, Vec<Vec<f32>>)) -> Option<IlluminationFit> {
        let levels = all.iter().map(Vec::as_slice).collect();
        CellRatios { grid: SQUARES, times_s: times_s.clone(), levels }.fit()
    }

    #[test]
    fn a_shadow_is_found_with_its_way_and_depth() {
        for (depth, direction, speed) in [(0.1, 0.0, 25.0), (0.4, 130.0, -40.0)] {
            let found = moving(&levels(depth, direction, speed, 0.01)).unwrap();
            let MovingIllumination { depth: [value, error], speed_mm_per_s, .. } = found.light;
            assert!((value - depth).abs() < 3.0 * error, "{value} {error} for {depth}");
            assert!(error < 0.1 * depth, "{error}");
            assert!((speed_mm_per_s - speed).abs() < 1.5, "{speed_mm_per_s} for {speed}");
            let turned = (found.light.direction_deg - direction).rem_euclid(360.0);
            assert!(turned.min(360.0 - turned) < 3.0, "{} deg", found.light.direction_deg);
            // In the middle of the shadow and beside it.
            let course = ProfileMotion { direction_deg: direction, speed };
            let at = |position_mm: f64| {
                let (sin, cos) = direction.to_radians().sin_cos();
                let along = position_mm + course.speed;
                found.light.ln_at([along * cos, along * sin], 1.0)
            };
            assert!((at(0.0) - (1.0 - depth).ln()).abs() < 0.03, "{}", at(0.0));
            assert!(at(35.0).abs() < 0.02, "{}", at(35.0));
        }
    }

    #[test]
    fn noise_and_lamps_are_no_shadow() {
        assert!(moving(&levels(0.0, 0.0, 25.0, 0.01)).is_none());
        assert!(moving(&levels(0.0, 0.0, 25.0, 0.03)).is_none());
    }
}
