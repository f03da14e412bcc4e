//! The paper's objective: the earth mover's distance between the real and the generated events,
//! as points (t, x, y) with every axis scaled to 0..1 by its own range.
//!
//! It is the debiased Sinkhorn divergence with the cost |a - b|^2 / 2 (Feydy et al., AISTATS
//! 2019), as in the published search, whose blur of 0.01 is 0.05 here: points are counted on a
//! grid of 24^3 cells, on which the kernel is separable.
//!
//! # Limitations
//! Insensitive to polarity, to the number of events and to any shift or scale of time: threshold,
//! asymmetry, leak, noise rate and clock offset have little or no effect. It is kept for comparison
//! with published numbers; `score` is the better objective.

use super::BrightnessSeries;
use super::brightness::{TileSubset, part_of};
use super::search::Objective;
use evrig_core::event::{EventSlice, Events};
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use evrig_generate::voltmeter::Coefficients;
use evrig_generate::{GenerateParameters, build};
use std::num::NonZeroUsize;

/// Cells per axis.
const SIDE: usize = 24;
/// Blur, in units of the axes.
const BLUR: f64 = 0.05;
/// Factor by which the blur falls in each annealing step, as published.
const ANNEALING: f64 = 0.9;
/// Iterations at the final blur.
const N_FINAL: usize = 8;
/// Bound on the brightness values of one generation, so that a search takes seconds.
const MAX_SAMPLES: usize = 2_000_000;
/// Columns of the grid on which the chosen pixels are packed for the generator.
const SHEET: usize = 4096;

/// Real events to compare with, and the frames to generate from.
pub struct EmdObjective<'a> {
    brightness: &'a BrightnessSeries,
    seed: u64,
    subsets: [SubsetEvents; 2],
}

/// Pixels of a subset, and their real events.
struct SubsetEvents {
    slots: Vec<u32>,
    real: Option<Cloud>,
}

/// Mass on the grid, with the potential of the cloud against itself.
struct Cloud {
    shares: Vec<f64>,
    own: Vec<f64>,
}

impl<'a> EmdObjective<'a> {
    /// Compares with `events`, on a sample of tiles where all would take too long.
    #[must_use]
    pub fn new(brightness: &'a BrightnessSeries, events: EventSlice<'_>, seed: u64) -> Self {
        let subsets = [TileSubset::Train, TileSubset::HeldOut]
            .map(|part| SubsetEvents::new(brightness, events, part, seed));
        Self { brightness, seed, subsets }
    }

    fn generate(&self, k: [f64; 6], slots: &[u32]) -> Option<Events> {
        let parameters = GenerateParameters::from_k(Coefficients::new(k).ok()?, self.seed);
        let mut generator = build(&parameters, NonZeroUsize::new(1)).ok()?;
        let size = Size::new(SHEET as u16, slots.len().div_ceil(SHEET) as u16);
        let mut sheet = Events::new();
        for (i, &t_us) in self.brightness.times_us().iter().enumerate() {
            let mut values: Vec<f32> =
                slots.iter().map(|&slot| self.brightness.series(slot as usize)[i]).collect();
            values.resize(size.n_pixels(), 1.0);
            generator.push(&Luminance { t_us, size, values }, &mut sheet).ok()?;
        }
        let width = u32::from(self.brightness.size().width);
        let place = |mut event: evrig_core::event::Event| {
            let &slot = slots.get(size.index(event.x, event.y))?;
            let pixel = self.brightness.pixels()[slot as usize];
            (event.x, event.y) = ((pixel % width) as u16, (pixel / width) as u16);
            Some(event)
        };
        Some(sheet.as_slice().iter().filter_map(place).collect())
    }
}

impl Objective for EmdObjective<'_> {
    fn name(&self) -> &'static str {
        "emd"
    }

    fn depends_on(&self) -> [bool; 6] {
        [true; 6]
    }

    fn value(&self, k: [f64; 6], _: &[f64], part: TileSubset) -> f64 {
        let side = &self.subsets[usize::from(part == TileSubset::HeldOut)];
        let generated = self.generate(k, &side.slots);
        let generated = generated.and_then(|events| Cloud::new(events.as_slice()));
        match (&side.real, generated) {
            (Some(real), Some(generated)) => divergence(real, &generated),
            _ => f64::INFINITY,
        }
    }
}

impl SubsetEvents {
    fn new(
        brightness: &BrightnessSeries,
        events: EventSlice<'_>,
        part: TileSubset,
        seed: u64,
    ) -> Self {
        let most = (MAX_SAMPLES / brightness.times_us().len().max(1)).max(64);
        let mut slots = brightness.slots(part, most, seed);
        slots.sort_unstable();
        let size = brightness.size();
        let mut is_mine = vec![false; size.n_pixels()];
        slots.iter().for_each(|&slot| is_mine[brightness.pixels()[slot as usize] as usize] = true);
        let times = brightness.times_us();
        let span = [times.first(), times.last()].map(|t| t.copied().unwrap_or_default());
        let taken = |event: &evrig_core::event::Event| {
            let inside = event.t > span[0] && event.t <= span[1] && size.contains(event.x, event.y);
            inside && is_mine[size.index(event.x, event.y)]
        };
        debug_assert!(
            slots.iter().all(|&s| part_of(size, brightness.pixels()[s as usize]) == part)
        );
        let real: Events = events.iter().filter(taken).collect();
        Self { slots, real: Cloud::new(real.as_slice()) }
    }
}

impl Cloud {
    /// Counts events on the grid; `None` without events.
    fn new(events: EventSlice<'_>) -> Option<Self> {
        let n = events.len();
        let cells = |value: &dyn Fn(usize) -> f64| -> Vec<usize> {
            let ends = (0..n)
                .map(value)
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
            let width = (ends[1] - ends[0]).max(f64::MIN_POSITIVE);
            let cell = |i| ((value(i) - ends[0]) / width * SIDE as f64) as usize;
            (0..n).map(|i| cell(i).min(SIDE - 1)).collect()
        };
        let first = *events.t.first()?;
        let t = cells(&|i| (events.t[i] - first) as f64);
        let x = cells(&|i| f64::from(events.x[i]));
        let y = cells(&|i| f64::from(events.y[i]));
        let mut shares = vec![0.0; SIDE * SIDE * SIDE];
        for i in 0..n {
            shares[(t[i] * SIDE + y[i]) * SIDE + x[i]] += 1.0 / n as f64;
        }
        let own = own_potential(&shares);
        Some(Self { shares, own })
    }
}

/// Annealing from the whole cube down to the final blur; entropies are their squares.
fn blurs() -> impl Iterator<Item = f64> {
    let falling = std::iter::successors(Some(3_f64.sqrt()), |blur| Some(blur * ANNEALING));
    falling.take_while(|&blur| blur > BLUR).chain(std::iter::repeat_n(BLUR, N_FINAL))
}

/// -e log of the sum over all cells b of share(b) exp((potential(b) - cost(a, b)) / e), for every
/// a.
fn soft_minimum(shares: &[f64], potential: &[f64], blur: f64) -> Vec<f64> {
    let entropy = blur * blur;
    let kernel: Vec<f64> = (0..SIDE)
        .map(|d| {
            let distance = d as f64 / SIDE as f64;
            (-0.5 * distance * distance / entropy).exp()
        })
        .collect();
    let mut values: Vec<f64> =
        shares.iter().zip(potential).map(|(share, p)| share * (p / entropy).exp()).collect();
    // Each pass sums along the last axis and rotates the axes.
    for _ in 0..3 {
        let mut next = vec![0.0; values.len()];
        for (row, line) in values.chunks_exact(SIDE).enumerate() {
            for a in 0..SIDE {
                let sum: f64 = (0..SIDE).map(|b| line[b] * kernel[a.abs_diff(b)]).sum();
                next[a * SIDE * SIDE + row] = sum;
            }
        }
        values = next;
    }
    values.iter().map(|sum| -entropy * sum.max(f64::MIN_POSITIVE).ln()).collect()
}

/// The potential of a cloud against itself, by averaged steps.
fn own_potential(shares: &[f64]) -> Vec<f64> {
    let mut potential = vec![0.0; shares.len()];
    for blur in blurs() {
        let next = soft_minimum(shares, &potential, blur);
        potential.iter_mut().zip(next).for_each(|(p, next)| *p = 0.5 * (*p + next));
    }
    potential
}

fn divergence(one: &Cloud, other: &Cloud) -> f64 {
    let mut f = vec![0.0; one.shares.len()];
    let mut g = f.clone();
    for blur in blurs() {
        let next_f = soft_minimum(&other.shares, &g, blur);
        let next_g = soft_minimum(&one.shares, &f, blur);
        f.iter_mut().zip(next_f).for_each(|(p, next)| *p = 0.5 * (*p + next));
        g.iter_mut().zip(next_g).for_each(|(p, next)| *p = 0.5 * (*p + next));
    }
    let gain = |shares: &[f64], potential: &[f64], own: &[f64]| -> f64 {
        let differences = potential.iter().zip(own).map(|(p, own)| p - own);
        shares.iter().zip(differences).map(|(share, d)| share * d).sum()
    };
    gain(&one.shares, &f, &one.own) + gain(&other.shares, &g, &other.own)
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::Event;
    use evrig_core::stats::SplitMix;

    fn cloud(shift: f64, on: bool) -> Cloud {
        // Corner events fix the scale of the axes; the rest lies about one place.
        let corners = [(0, 0, 0), (10_000, 100, 100)].map(|(t, x, y)| Event { t, x, y, on });
        let mut random = SplitMix::new(1, 0);
        let rest = (0..4_000).map(|_| {
            let mut place = |low: f64| random.between(low, low + 0.3);
            let (x, y) = ((100.0 * (place(0.1) + shift)) as u16, (100.0 * place(0.3)) as u16);
            Event { t: (1e4 * place(0.2)) as i64, x, y, on }
        });
        let mut events: Events = corners.into_iter().chain(rest).collect();
        events.sort_by_time();
        Cloud::new(events.as_slice()).unwrap()
    }

    #[test]
    fn a_shifted_cloud_is_half_the_squared_shift_away() {
        // With the cost |a - b|^2 / 2 a pure shift by d costs d^2 / 2 at any blur.
        let value = divergence(&cloud(0.0, true), &cloud(0.25, true));
        assert!((value - 0.5 * 0.25 * 0.25).abs() < 0.004, "{value}");
    }

    #[test]
    fn it_sees_neither_itself_nor_polarity() {
        assert!(divergence(&cloud(0.1, true), &cloud(0.1, true)).abs() < 1e-6);
        assert!(divergence(&cloud(0.1, true), &cloud(0.1, false)).abs() < 1e-6);
        assert!(Cloud::new(Events::new().as_slice()).is_none());
    }
}
