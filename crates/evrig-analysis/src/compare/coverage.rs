//! The errors are under test too: in repeated worlds of known truth the 90 % intervals must hold
//! the truth in about 90 %.

use super::*;
use evrig_core::event::{Event, Events};
use evrig_core::stats::Estimate;
use evrig_core::stats::SplitMix;

/// The row on which bursty light falls.
const ROW: Size = Size::new(48, 1);
/// The grid that patchy light falls on.
const SIZE: Size = Size::new(48, 48);
const N_WORLDS: u64 = 120;

fn uniform(random: &mut SplitMix) -> f64 {
    random.uniform()
}

fn sorted(events: Vec<Event>) -> Events {
    let mut events: Events = events.into_iter().collect();
    events.sort_by_time();
    events
}

/// Bursty light: in each tenth of a second both cameras see a common activity, and each
/// has luck of its own with number, polarity and place. Truths: count ratio 1.5, polarity
/// difference 0.15, transport 7.2 px.
fn bursty(seed: u64) -> [Events; 2] {
    let mut random = SplitMix::new(seed, 7);
    let mut streams = [Vec::new(), Vec::new()];
    for block in 0..40_i64 {
        let activity = 0.2 + 1.6 * uniform(&mut random);
        for (stream, n, share_on, share_right) in [(0, 80.0, 0.45, 0.3), (1, 120.0, 0.60, 0.5)] {
            let luck = 0.5 + uniform(&mut random);
            let share_on = share_on + 0.4 * (uniform(&mut random) - 0.5);
            let share_right = share_right + 0.5 * (uniform(&mut random) - 0.5);
            for _ in 0..(n * activity * luck).round() as usize {
                let t = block * 100_000 + random.below(100_000) as i64;
                let x = if uniform(&mut random) < share_right { 40 } else { 4 };
                streams[stream].push(Event { t, x, y: 0, on: uniform(&mut random) < share_on });
            }
        }
    }
    streams.map(sorted)
}

/// Patches of pixels that share how many of them are active and how often a short
/// interval (100 us) comes instead of a long one (1000 us). Truths: active pixels 0.35 and
/// 0.49 of all, short intervals 0.7 (real) and 0.5 (simulated) of all.
fn patchy(seed: u64) -> [Events; 2] {
    let mut random = SplitMix::new(seed, 8);
    let mut streams = [Vec::new(), Vec::new()];
    for tile in 0..36_u16 {
        let texture = 0.4 + 0.6 * uniform(&mut random);
        for (stream, active, short) in [(0, 0.5, 0.7), (1, 0.7, 0.5)] {
            let short = short + 0.5 * (uniform(&mut random) - 0.5);
            for pixel in 0..64_u16 {
                if uniform(&mut random) >= active * texture {
                    continue;
                }
                let (x, y) = (tile % 6 * 8 + pixel % 8, tile / 6 * 8 + pixel / 8);
                let mut t = random.below(1_000_000) as i64;
                for i in 0..6 {
                    streams[stream].push(Event { t, x, y, on: i % 2 == 0 });
                    t += if uniform(&mut random) < short { 100 } else { 1_000 };
                }
            }
        }
    }
    streams.map(sorted)
}

/// A name, the planted truth and the index of its estimate.
type PlantedTruth = (&'static str, f64, fn(&Comparison) -> Estimate);

/// Compares many worlds and demands that each named estimate covers its truth as often as
/// its interval claims: 90 %, with three binomial errors of the 120 worlds and two points for
/// the bootstrap's own shortness with 40 clusters.
fn demand_coverage(size: Size, world: fn(u64) -> [Events; 2], truths: &[PlantedTruth]) {
    let mut n_covered = vec![0_u32; truths.len()];
    for seed in 0..N_WORLDS {
        let [real, simulated] = world(seed);
        let setup = Setup {
            size,
            window: [0, 4_000_000],
            region: None,
            seed,
            n_bootstrap: 200,
            frames: None,
        };
        let comparison = compare(real.as_slice(), simulated.as_slice(), &setup).unwrap();
        for (n, (_, truth, estimate)) in n_covered.iter_mut().zip(truths) {
            *n += u32::from(estimate(&comparison).covers(*truth));
        }
    }
    for (n, (name, _, _)) in n_covered.into_iter().zip(truths) {
        let share = f64::from(n) / N_WORLDS as f64;
        assert!((0.80..=0.97).contains(&share), "{name}: covered in {share} of the worlds");
    }
}

fn of(comparison: &Comparison, id: MeasureId) -> Estimate {
    comparison.measure(id).unwrap().estimate
}

#[test]
fn intervals_over_time_blocks_hold_the_truth_as_often_as_they_claim() {
    demand_coverage(
        ROW,
        bursty,
        &[
            ("count_ratio", 1.5, |c| of(c, MeasureId::CountRatio)),
            ("polarity_delta", 0.15, |c| of(c, MeasureId::PolarityDelta)),
            ("spatial_emd", 0.2 * 36.0, |c| of(c, MeasureId::SpatialEmd)),
        ],
    );
}

/// Bursty light of constant expectation on one camera and of a rate that grows linearly from 0.5
/// to 1.5 of its mean on the other. The area between u and u/2 + u^2/2 is 1/12 of the window.
fn ramped(seed: u64) -> [Events; 2] {
    let mut random = SplitMix::new(seed, 9);
    let mut streams = [Vec::new(), Vec::new()];
    for block in 0..40_i64 {
        let activity = 0.2 + 1.6 * uniform(&mut random);
        for (stream, share) in [(0, 1.0), (1, 0.5 + (block as f64 + 0.5) / 40.0)] {
            let luck = 0.5 + uniform(&mut random);
            for _ in 0..(100.0 * activity * luck * share).round() as usize {
                let t = block * 100_000 + random.below(100_000) as i64;
                streams[stream].push(Event { t, x: random.below(48) as u16, y: 0, on: true });
            }
        }
    }
    streams.map(sorted)
}

#[test]
fn intervals_of_a_distance_in_time_hold_the_truth_as_often_as_they_claim() {
    demand_coverage(
        ROW,
        ramped,
        &[("temporal_emd", 4_000.0 / 12.0, |c| of(c, MeasureId::TemporalEmd))],
    );
}

#[test]
fn intervals_over_tiles_hold_the_truth_as_often_as_they_claim() {
    // Of the two-point laws a = (0.7, 0.3) and b = (0.5, 0.5) one decade apart the plan is
    // P = (0.5, 0.2; 0, 0.3), so S = 0.2 + 0.05 [KL(P | a b) - H(a)/2 - H(b)/2] = 0.1811.
    fn entropy(shares: &[f64]) -> f64 {
        shares.iter().map(|q| -q * q.ln()).sum()
    }
    let plan =
        0.5 * (0.5_f64 / 0.35).ln() + 0.2 * (0.2_f64 / 0.35).ln() + 0.3 * (0.3_f64 / 0.15).ln();
    let own = (entropy(&[0.7, 0.3]) + entropy(&[0.5, 0.5])) / 2.0;
    let sinkhorn = 0.2 + interval_emd::BLUR_DECADES * (plan - own);
    let n_active = [0.35, 0.49].map(|share| share * SIZE.n_pixels() as f64);
    demand_coverage(
        SIZE,
        patchy,
        &[
            ("active_pixel_ratio", 1.4, |c| of(c, MeasureId::ActivePixelRatio)),
            ("spatial_entropy_ratio", n_active[1].ln() / n_active[0].ln(), |c| {
                of(c, MeasureId::SpatialEntropyRatio)
            }),
            ("interval_tv", 0.2, |c| of(c, MeasureId::IntervalTv)),
            ("interval_emd", sinkhorn, |c| of(c, MeasureId::IntervalEmd)),
            ("interval_ks", 0.2, |c| of(c, MeasureId::IntervalKs)),
            ("interval distance", 0.2, |c| c.curves.intervals.distance_decades),
            ("mean interval", 370.0, |c| c.curves.intervals.real.fit.as_ref().unwrap().mean_us),
            ("shape", 1.0 / (0.7 / 100.0 + 0.3 / 1_000.0 - 1.0 / 370.0), |c| {
                c.curves.intervals.real.fit.as_ref().unwrap().shape_us
            }),
        ],
    );
}
