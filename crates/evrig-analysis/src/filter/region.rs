//! Keeps the events of a moving region: a plane square, mapped by a homography at each event's
//! time. Optionally transforms the events to a crop in the square's coordinates.
//!
//! A [`RegionPath`] holds the homography at regular time steps with linear interpolation in
//! between. At steps of 1 ms the error is below 1e-4 px for an arm (acceleration times step squared
//! over eight). A pixel is represented by its middle.

use super::{CHUNK, DropReason, DropTally, FilterError, Filtered, check};
use evrig_core::event::{EventSlice, Events};
use evrig_core::geometry::{Homography, Size};
use pixel_bounds::{IdealRanges, PixelBounds};
use std::collections::BTreeMap;

mod pixel_bounds;

/// Margin and output coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionSetting {
    /// Margin around the square in which events are kept, as a share of its side.
    pub margin: f64,
    /// Side of the crop that contains square and margin, pixels; none to keep sensor coordinates.
    pub crop_px: Option<u16>,
}

impl Default for RegionSetting {
    /// The published margin of 3 %, in sensor coordinates.
    fn default() -> Self {
        Self { margin: 0.03, crop_px: None }
    }
}

/// The moving square at regular time steps.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionPath {
    size: Size,
    from_us: i64,
    step_us: i64,
    /// Homography at each step, from pixels relative to the middle of the frame to the square with
    /// edges at -1/2 and 1/2; none where the square's position is unknown.
    knots: Vec<Option<[f32; 9]>>,
    /// Undistorted pixels; none for a lens without distortion.
    undistorted: Option<UndistortedPixels>,
}

/// Undistorted pixels relative to the middle of the frame, row-major.
#[derive(Debug, Clone, PartialEq)]
struct UndistortedPixels {
    coordinates: Vec<[f32; 2]>,
    ranges: IdealRanges,
}

impl RegionPath {
    /// A path from time `from_us` on with a step of `step_us`, for a grid of `size`.
    ///
    /// `square_from_pixel(t_us)` maps undistorted pixels (pixel `i` covers `i..i + 1`) to the
    /// square 0..1 x 0..1, left to right and top to bottom; none when unknown. `ideal` undistorts a
    /// sensor pixel; none where the lens model has no solution.
    ///
    /// # Errors
    /// A step that is not positive; an interval that ends before it begins or has more than ten
    /// million steps.
    pub fn new(
        size: Size,
        [from_us, to_us]: [i64; 2],
        step_us: i64,
        mut square_from_pixel: impl FnMut(i64) -> Option<Homography>,
        ideal: Option<&dyn Fn([f64; 2]) -> Option<[f64; 2]>>,
    ) -> Result<Self, FilterError> {
        let bad = |name, found, expected| Err(FilterError::BadSetting { name, found, expected });
        if step_us <= 0 {
            return bad("step_us", step_us as f64, "a number above 0");
        }
        let n_steps = to_us.saturating_sub(from_us).div_euclid(step_us).saturating_add(2);
        if !(2..=MAX_STEPS).contains(&n_steps) {
            return bad(
                "n_steps",
                n_steps as f64,
                "a time that does not fall, 10 000 000 steps at most",
            );
        }
        let middle = [f64::from(size.width) / 2.0, f64::from(size.height) / 2.0];
        let knots = (0..n_steps)
            .map(|k| {
                square_from_pixel(from_us.saturating_add(k * step_us))
                    .and_then(|h| numbers(h, middle))
            })
            .collect();
        let undistorted = ideal.map(|ideal| {
            let pixels = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
            // NaN lies in no square.
            let place = |(x, y): (u16, u16)| {
                let sensor = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                ideal(sensor).map_or([f32::NAN; 2], |[u, v]| {
                    [(u - middle[0]) as f32, (v - middle[1]) as f32]
                })
            };
            let coordinates: Vec<[f32; 2]> = pixels.map(place).collect();
            UndistortedPixels { ranges: IdealRanges::new(size, &coordinates), coordinates }
        });
        Ok(Self { size, from_us, step_us, knots, undistorted })
    }

    /// The homography at the begin of the step of `t_us`, its change over the step, and the end of
    /// the step; no homography where the position is unknown.
    fn step(&self, t_us: i64) -> (Option<[[f32; 9]; 2]>, i64) {
        let number = t_us.saturating_sub(self.from_us).div_euclid(self.step_us);
        let end = number.saturating_add(1).saturating_mul(self.step_us);
        let end_us = self.from_us.saturating_add(end);
        let knot = |n: i64| self.knots.get(usize::try_from(n).ok()?).copied().flatten();
        let both = knot(number).zip(knot(number + 1));
        let change = |(a, b): ([f32; 9], [f32; 9])| [a, std::array::from_fn(|i| b[i] - a[i])];
        (both.map(change), end_us)
    }
}

/// More than ten thousand seconds at 1 ms.
const MAX_STEPS: i64 = 10_000_000;

/// The homography for pixels about `middle` and a square about 0, normalised to 1 in the last
/// entry; none where the horizon runs through the middle.
fn numbers(square_from_pixel: Homography, middle: [f64; 2]) -> Option<[f32; 9]> {
    let m: [[f64; 3]; 3] = square_from_pixel.into();
    let shifted = m.map(|[a, b, c]| [a, b, a * middle[0] + b * middle[1] + c]);
    let [u, v, w] = shifted;
    if w[2].abs() < 1e-12 {
        return None;
    }
    let rows = [
        std::array::from_fn::<f64, 3, _>(|i| (u[i] - 0.5 * w[i]) / w[2]),
        std::array::from_fn(|i| (v[i] - 0.5 * w[i]) / w[2]),
        w.map(|part| part / w[2]),
    ];
    let numbers: [f32; 9] = std::array::from_fn(|i| rows[i / 3][i % 3] as f32);
    numbers.iter().all(|n| n.is_finite()).then_some(numbers)
}

/// Events of a chunk near the square, with their coordinates on it.
struct LocatedEvents {
    /// Their indices in the chunk; the first `n` count.
    near: Vec<u16>,
    n: usize,
    /// Time as a share of the path's step, and coordinates in the frame.
    part: Vec<f32>,
    x: Vec<f32>,
    y: Vec<f32>,
    /// Coordinates on the square, edges at -1/2 and 1/2.
    u: Vec<f32>,
    v: Vec<f32>,
    is_kept: Vec<bool>,
}

impl LocatedEvents {
    fn new() -> Self {
        let column = || vec![0.0; CHUNK];
        Self {
            near: vec![0; CHUNK],
            n: 0,
            part: column(),
            x: column(),
            y: column(),
            u: column(),
            v: column(),
            is_kept: vec![false; CHUNK],
        }
    }
}

/// Keeps the events in the square and its margin.
///
/// # Errors
/// Events out of order or off the grid; a margin or crop that makes no sense.
pub fn filter(
    events: EventSlice<'_>,
    path: &RegionPath,
    setting: RegionSetting,
) -> Result<Filtered, FilterError> {
    if !(0.0..=10.0).contains(&setting.margin) {
        let found = setting.margin;
        return Err(FilterError::BadSetting { name: "margin", found, expected: "0 to 10" });
    }
    if setting.crop_px == Some(0) {
        return Err(FilterError::BadSetting { name: "crop_px", found: 0.0, expected: "1 or more" });
    }
    let half = (0.5 + setting.margin) as f32;
    let mut located = LocatedEvents::new();
    let mut kept = KeptEvents::new(events.len(), half, setting.crop_px);
    let mut n_pathless = 0;
    let mut previous_us = i64::MIN;
    for start in (0..events.len()).step_by(CHUNK) {
        let chunk = events.range(start, (start + CHUNK).min(events.len()));
        check(chunk, path.size, start, previous_us)?;
        previous_us = chunk.t[chunk.len() - 1];
        n_pathless += locate_chunk(chunk, path, half, &mut located);
        kept.take(chunk, &located);
    }
    let (n_seen, n_kept) = (events.len() as u64, kept.events.len() as u64);
    let dropped = [
        (DropReason::NoPath, n_pathless),
        (DropReason::OutsideRegion, n_seen - n_kept - n_pathless),
    ];
    let dropped: BTreeMap<_, _> = dropped.into_iter().filter(|(_, n)| *n > 0).collect();
    Ok(Filtered { events: kept.events, tally: DropTally { seen: n_seen, kept: n_kept, dropped } })
}

/// Locates the events of a chunk; returns the number of those at times without a path.
fn locate_chunk(
    chunk: EventSlice<'_>,
    path: &RegionPath,
    half: f32,
    located: &mut LocatedEvents,
) -> u64 {
    let mut n_pathless = 0;
    let mut begin = 0;
    located.n = 0;
    while begin < chunk.len() {
        let (numbers, end_us) = path.step(chunk.t[begin]);
        let end = begin + run_before(&chunk.t[begin..], end_us);
        match numbers {
            None => n_pathless += (end - begin) as u64,
            Some(numbers) => {
                let ranges = path.undistorted.as_ref().map(|undistorted| &undistorted.ranges);
                let near = PixelBounds::new(path.size, numbers, half, ranges);
                let first = located.n;
                located.n = gather(chunk, [begin, end], near, located);
                locate(chunk, path, end_us, first, located);
                test(numbers, half, first, located);
            }
        }
        begin = end;
    }
    n_pathless
}

/// Collects the indices of events between `begin` and `end` near the square by branch-free
/// compaction; returns their number so far.
fn gather(
    chunk: EventSlice<'_>,
    [begin, end]: [usize; 2],
    near: PixelBounds,
    located: &mut LocatedEvents,
) -> usize {
    let mut n = located.n;
    let pixels = chunk.x[begin..end].iter().zip(&chunk.y[begin..end]);
    for ((x, y), number) in pixels.zip(begin as u16..) {
        located.near[n] = number;
        n += usize::from(near.holds(*x, *y));
    }
    n
}

/// Time in the step and coordinates in the frame of the events near the square, from the `first`
/// on.
fn locate(
    chunk: EventSlice<'_>,
    path: &RegionPath,
    end_us: i64,
    first: usize,
    located: &mut LocatedEvents,
) {
    let begin_us = end_us - path.step_us;
    let per_step = 1.0 / path.step_us as f32;
    let middle = [f32::from(path.size.width) / 2.0, f32::from(path.size.height) / 2.0];
    for k in first..located.n {
        let i = usize::from(located.near[k]);
        let (x, y) = (chunk.x[i], chunk.y[i]);
        located.part[k] = (chunk.t[i] - begin_us) as f32 * per_step;
        [located.x[k], located.y[k]] = match &path.undistorted {
            None => [f32::from(x) + 0.5 - middle[0], f32::from(y) + 0.5 - middle[1]],
            Some(undistorted) => undistorted.coordinates[path.size.index(x, y)],
        };
    }
}

/// Number of leading times before `end_us`, at least 1.
fn run_before(t: &[i64], end_us: i64) -> usize {
    match t.last() {
        Some(&last) if last < end_us => t.len(),
        _ => t.partition_point(|&t| t < end_us).max(1),
    }
}

/// The exact test, branch-free so that it vectorises.
fn test([a, d]: [[f32; 9]; 2], half: f32, first: usize, located: &mut LocatedEvents) {
    let range = first..located.n;
    let places = located.part[range.clone()].iter().zip(&located.x[range.clone()]);
    let places = places.zip(&located.y[range.clone()]);
    let out = located.u[range.clone()].iter_mut().zip(&mut located.v[range.clone()]);
    for (((s, px), py), ((u, v), is_kept)) in places.zip(out.zip(&mut located.is_kept[range])) {
        let row = |i: usize| {
            let [p, q, r] = [a[i] + s * d[i], a[i + 1] + s * d[i + 1], a[i + 2] + s * d[i + 2]];
            p * px + q * py + r
        };
        let w = row(6);
        let (on_u, on_v) = (row(0), row(3));
        // No comparison holds for NaN.
        *is_kept = (w > 0.0) & (on_u.abs() <= half * w) & (on_v.abs() <= half * w);
        let inverse = 1.0 / w;
        *u = on_u * inverse;
        *v = on_v * inverse;
    }
}

/// Collects the kept events.
struct KeptEvents {
    events: Events,
    t: Vec<i64>,
    x: Vec<u16>,
    y: Vec<u16>,
    on: Vec<bool>,
    half: f32,
    crop_px: Option<u16>,
}

impl KeptEvents {
    fn new(n_events: usize, half: f32, crop_px: Option<u16>) -> Self {
        Self {
            // Reserves address space only.
            events: Events::with_capacity(n_events),
            t: vec![0; CHUNK],
            x: vec![0; CHUNK],
            y: vec![0; CHUNK],
            on: vec![false; CHUNK],
            half,
            crop_px,
        }
    }

    /// Adds the kept events of a chunk by branch-free compaction.
    fn take(&mut self, chunk: EventSlice<'_>, located: &LocatedEvents) {
        let scale = self.crop_px.map_or(0.0, |px| f32::from(px) / (2.0 * self.half));
        let last = self.crop_px.map_or(0, |px| px - 1);
        let pixel = |place: f32| (((place + self.half) * scale) as u16).min(last);
        let mut end = 0;
        for (k, number) in located.near[..located.n].iter().enumerate() {
            let i = usize::from(*number);
            self.t[end] = chunk.t[i];
            self.on[end] = chunk.on[i];
            (self.x[end], self.y[end]) = match self.crop_px {
                None => (chunk.x[i], chunk.y[i]),
                Some(_) => (pixel(located.u[k]), pixel(located.v[k])),
            };
            end += usize::from(located.is_kept[k]);
        }
        self.events.extend_from_slice(EventSlice {
            t: &self.t[..end],
            x: &self.x[..end],
            y: &self.y[..end],
            on: &self.on[..end],
        });
    }
}

#[cfg(test)]
mod tests;
