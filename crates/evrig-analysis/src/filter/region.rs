//! Keeps the events of a region that moves: a plane square, seen through a homography at each
//! event's own time, and, if wanted, moved into the square's own coordinates.
//!
//! A [`RegionPath`] holds the way from pixels to the square at even steps of time; between them its
//! nine numbers change evenly. At 1 ms a step that is off by less than 1e-4 px for what an arm does
//! (acceleration times the step's square over eight). A pixel stands for its middle.

use super::{CHUNK, FilterError, Filtered, Reason, Tally, check};
use evrig_core::event::{EventSlice, Events};
use evrig_core::geometry::{Homography, Size};
use near::{Near, Reaches};
use std::collections::BTreeMap;

mod near;

/// What is kept, and in which coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// How far beyond the square events are kept, as a share of its side: 0.03 for 3 %.
    pub margin: f64,
    /// Columns and rows of the square crop that takes square and margin; none to leave events at
    /// their pixels.
    pub crop_px: Option<u16>,
}

impl Default for Setting {
    /// The published margin of 3 %, at the sensor's own pixels.
    fn default() -> Self {
        Self { margin: 0.03, crop_px: None }
    }
}

/// The moving square at even steps of time.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionPath {
    size: Size,
    from_us: i64,
    step_us: i64,
    /// At each step: from pixels about the middle of the frame to the square, its left edge at -1/2
    /// and its right edge at 1/2, top at -1/2; none where nobody knows where the square is.
    knots: Vec<Option<[f32; 9]>>,
    /// Pixels as a perfect lens would have them, about the middle of the frame; none for a lens
    /// without distortion.
    straight: Option<Straight>,
}

/// The pixels of a bent picture as a perfect lens would have them, row-major.
#[derive(Debug, Clone, PartialEq)]
struct Straight {
    places: Vec<[f32; 2]>,
    reaches: Reaches,
}

impl RegionPath {
    /// A path from time `from_us` on, a knot every `step_us`, for a grid of `size`.
    ///
    /// `square_from_pixel(t_us)` leads from ideal pixels (pixel `i` covers `i..i + 1`) to the square
    /// 0..1 x 0..1, left to right and top to bottom; none when it is not known. `ideal` makes an
    /// ideal pixel of a sensor pixel, none for those that the lens cannot have; leave it out for a
    /// lens without distortion.
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
        let straight = ideal.map(|ideal| {
            let pixels = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
            // What the lens cannot have lies nowhere, and so not in the square.
            let place = |(x, y): (u16, u16)| {
                let sensor = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                ideal(sensor).map_or([f32::NAN; 2], |[u, v]| {
                    [(u - middle[0]) as f32, (v - middle[1]) as f32]
                })
            };
            let places: Vec<[f32; 2]> = pixels.map(place).collect();
            Straight { reaches: Reaches::new(size, &places), places }
        });
        Ok(Self { size, from_us, step_us, knots, straight })
    }

    /// The numbers at the begin of the step that `t_us` lies in and their change until its end, and
    /// when that is; none numbers where the path leads nowhere.
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

/// The nine numbers for pixels about `middle` and a square about zero, the last one 1 so that those
/// of neighbouring knots are alike; none where the horizon runs through the middle.
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

/// Events of a chunk that lie near the square, and where it sees them.
struct Seen {
    /// Their numbers in the chunk, and how many they are.
    near: Vec<u16>,
    n: usize,
    /// How far into the path's step they come, and their places in the frame.
    part: Vec<f32>,
    x: Vec<f32>,
    y: Vec<f32>,
    /// Places on the square, edges at -1/2 and 1/2.
    u: Vec<f32>,
    v: Vec<f32>,
    is_kept: Vec<bool>,
}

impl Seen {
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
    setting: Setting,
) -> Result<Filtered, FilterError> {
    if !(0.0..=10.0).contains(&setting.margin) {
        let found = setting.margin;
        return Err(FilterError::BadSetting { name: "margin", found, expected: "0 to 10" });
    }
    if setting.crop_px == Some(0) {
        return Err(FilterError::BadSetting { name: "crop_px", found: 0.0, expected: "1 or more" });
    }
    let half = (0.5 + setting.margin) as f32;
    let mut seen = Seen::new();
    let mut kept = Kept::new(events.len(), half, setting.crop_px);
    let mut n_pathless = 0;
    let mut previous_us = i64::MIN;
    for start in (0..events.len()).step_by(CHUNK) {
        let chunk = events.range(start, (start + CHUNK).min(events.len()));
        check(chunk, path.size, start, previous_us)?;
        previous_us = chunk.t[chunk.len() - 1];
        n_pathless += look(chunk, path, half, &mut seen);
        kept.take(chunk, &seen);
    }
    let (n_seen, n_kept) = (events.len() as u64, kept.events.len() as u64);
    let dropped =
        [(Reason::NoPath, n_pathless), (Reason::OutsideRegion, n_seen - n_kept - n_pathless)];
    let dropped: BTreeMap<_, _> = dropped.into_iter().filter(|(_, n)| *n > 0).collect();
    Ok(Filtered { events: kept.events, tally: Tally { seen: n_seen, kept: n_kept, dropped } })
}

/// Looks where each event of a chunk lies; gives the number of those at times without a path.
fn look(chunk: EventSlice<'_>, path: &RegionPath, half: f32, seen: &mut Seen) -> u64 {
    let mut n_pathless = 0;
    let mut begin = 0;
    seen.n = 0;
    while begin < chunk.len() {
        let (numbers, end_us) = path.step(chunk.t[begin]);
        let end = begin + run_before(&chunk.t[begin..], end_us);
        match numbers {
            None => n_pathless += (end - begin) as u64,
            Some(numbers) => {
                let reaches = path.straight.as_ref().map(|straight| &straight.reaches);
                let near = Near::new(path.size, numbers, half, reaches);
                let first = seen.n;
                seen.n = gather(chunk, [begin, end], near, seen);
                locate(chunk, path, end_us, first, seen);
                test(numbers, half, first, seen);
            }
        }
        begin = end;
    }
    n_pathless
}

/// Numbers of the events from `begin` to `end` that are near the square; each is written at the place
/// of the next, and the place moves on only if it is near. Gives the number of all so far.
fn gather(chunk: EventSlice<'_>, [begin, end]: [usize; 2], near: Near, seen: &mut Seen) -> usize {
    let mut n = seen.n;
    let pixels = chunk.x[begin..end].iter().zip(&chunk.y[begin..end]);
    for ((x, y), number) in pixels.zip(begin as u16..) {
        seen.near[n] = number;
        n += usize::from(near.holds(*x, *y));
    }
    n
}

/// When in the step and where in the frame the events near the square lie, from the `first` on.
fn locate(chunk: EventSlice<'_>, path: &RegionPath, end_us: i64, first: usize, seen: &mut Seen) {
    let begin_us = end_us - path.step_us;
    let per_step = 1.0 / path.step_us as f32;
    let middle = [f32::from(path.size.width) / 2.0, f32::from(path.size.height) / 2.0];
    for k in first..seen.n {
        let i = usize::from(seen.near[k]);
        let (x, y) = (chunk.x[i], chunk.y[i]);
        seen.part[k] = (chunk.t[i] - begin_us) as f32 * per_step;
        [seen.x[k], seen.y[k]] = match &path.straight {
            None => [f32::from(x) + 0.5 - middle[0], f32::from(y) + 0.5 - middle[1]],
            Some(straight) => straight.places[path.size.index(x, y)],
        };
    }
}

/// Number of leading times before `end_us`: near ones by looking, far ones by halving.
fn run_before(t: &[i64], end_us: i64) -> usize {
    match t.last() {
        Some(&last) if last < end_us => t.len(),
        _ => t.partition_point(|&t| t < end_us).max(1),
    }
}

/// The test itself: no branch and no call, so that the compiler takes several events at once.
fn test([a, d]: [[f32; 9]; 2], half: f32, first: usize, seen: &mut Seen) {
    let range = first..seen.n;
    let places = seen.part[range.clone()].iter().zip(&seen.x[range.clone()]);
    let places = places.zip(&seen.y[range.clone()]);
    let out = seen.u[range.clone()].iter_mut().zip(&mut seen.v[range.clone()]);
    for (((s, px), py), ((u, v), is_kept)) in places.zip(out.zip(&mut seen.is_kept[range])) {
        let row = |i: usize| {
            let [p, q, r] = [a[i] + s * d[i], a[i + 1] + s * d[i + 1], a[i + 2] + s * d[i + 2]];
            p * px + q * py + r
        };
        let w = row(6);
        let (on_u, on_v) = (row(0), row(3));
        // A place that the lens cannot have is no number, and no comparison holds for it.
        *is_kept = (w > 0.0) & (on_u.abs() <= half * w) & (on_v.abs() <= half * w);
        let inverse = 1.0 / w;
        *u = on_u * inverse;
        *v = on_v * inverse;
    }
}

/// Gathers what is kept.
struct Kept {
    events: Events,
    t: Vec<i64>,
    x: Vec<u16>,
    y: Vec<u16>,
    on: Vec<bool>,
    half: f32,
    crop_px: Option<u16>,
}

impl Kept {
    fn new(n_events: usize, half: f32, crop_px: Option<u16>) -> Self {
        Self {
            // Address space only: pages are taken when kept events fill them.
            events: Events::with_capacity(n_events),
            t: vec![0; CHUNK],
            x: vec![0; CHUNK],
            y: vec![0; CHUNK],
            on: vec![false; CHUNK],
            half,
            crop_px,
        }
    }

    /// Each event is stored at the place of the next kept one, and the place moves on only if it stays.
    fn take(&mut self, chunk: EventSlice<'_>, seen: &Seen) {
        let scale = self.crop_px.map_or(0.0, |px| f32::from(px) / (2.0 * self.half));
        let last = self.crop_px.map_or(0, |px| px - 1);
        let pixel = |place: f32| (((place + self.half) * scale) as u16).min(last);
        let mut end = 0;
        for (k, number) in seen.near[..seen.n].iter().enumerate() {
            let i = usize::from(*number);
            self.t[end] = chunk.t[i];
            self.on[end] = chunk.on[i];
            (self.x[end], self.y[end]) = match self.crop_px {
                None => (chunk.x[i], chunk.y[i]),
                Some(_) => (pixel(seen.u[k]), pixel(seen.v[k])),
            };
            end += usize::from(seen.is_kept[k]);
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
