//! The model against itself: simulated events have exponential compensators, score their entropy, and
//! score less under any other parameters.

use super::*;
use evrig_core::stats::{Moments, SplitMix};

const END_US: i64 = 20_000_000;

/// A signal of a few incommensurable waves, sampled every millisecond.
fn wander(number: u64) -> Vec<f32> {
    let mut random = SplitMix::new(11, number);
    let waves: Vec<[f64; 3]> = (0..6)
        .map(|_| [0.2 + 0.5 * random.uniform(), 0.3 + 4.0 * random.uniform(), random.uniform()])
        .collect();
    (0..=20_000)
        .map(|i| {
            let t = f64::from(i) * 1e-3;
            let wave =
                |[a, f, phase]: &[f64; 3]| a * ((f * t + phase) * std::f64::consts::TAU).sin();
            (waves.iter().map(wave).sum::<f64>() * 0.5 - 1.5) as f32
        })
        .collect()
}

fn signal_of(values: &[f32]) -> PixelSignal<'_> {
    PixelSignal { start_us: 0.0, step_us: 1_000.0, signal: values, level: values, knots: None }
}

fn draw(law: &PixelLaw, values: &[Vec<f32>], seed: u64) -> Vec<Vec<Spike>> {
    let one = |(i, v): (usize, &Vec<f32>)| {
        sample(law, signal_of(v), END_US, &mut SplitMix::new(seed, i as u64))
    };
    values.iter().enumerate().map(one).collect()
}

fn total(law: &PixelLaw, values: &[Vec<f32>], spikes: &[Vec<Spike>]) -> f64 {
    let blocks = TimeBlocks::new(END_US, 7);
    let (mut sum, mut n) = (0.0, 0);
    for (values, spikes) in values.iter().zip(spikes) {
        for block in score_pixel(law, signal_of(values), spikes, &blocks) {
            sum += block.log_likelihood();
            n += block.n_events;
        }
    }
    sum / f64::from(n)
}

fn laws() -> Vec<PixelLaw> {
    let plain = PixelLaw { noise_speed_per_s: 0.0, ..PixelLaw::default() };
    vec![
        plain,
        PixelLaw { noise_speed_per_s: 0.6, noise_at_white: 0.03, ..plain },
        PixelLaw { refractory_s: 0.02, theta_off: 0.3, background_on_hz: 0.5, ..plain },
        PixelLaw { filter_refractory_s: 0.05, ..plain },
        PixelLaw { background_reset: 0.0, background_off_hz: 0.5, ..plain },
        PixelLaw { noise_carry: 0.8, noise_speed_per_s: 0.6, noise_at_white: 0.03, ..plain },
        PixelLaw { drop_fraction: 0.3, ..plain },
        PixelLaw { noise_at_rest: 0.2, noise_speed_per_s: 0.6, noise_at_white: 0.03, ..plain },
    ]
}

#[test]
fn the_compensator_of_a_silence_is_exponential_under_the_true_law() {
    let values: Vec<Vec<f32>> = (0..40).map(wander).collect();
    let blocks = TimeBlocks::new(END_US, 5);
    for (number, law) in laws().into_iter().enumerate() {
        // Mixtures of reference levels are truncated.
        let most = if number < 3 { 0.15 } else { 0.25 };
        let spikes = draw(&law, &values, 3);
        let mut spent = Vec::new();
        let (mut expected, mut seen) = (0.0, 0.0);
        for (values, spikes) in values.iter().zip(&spikes) {
            let (events, cells) = residuals(&law, signal_of(values), (0, 0), spikes, &blocks);
            spent.extend(events.iter().map(|event| event.compensator));
            expected += cells.iter().map(|c| c.expected_on + c.expected_off).sum::<f64>();
            seen += cells.iter().map(|c| f64::from(c.on + c.off)).sum::<f64>();
        }
        assert!(spent.len() > 2_000, "{} events", spent.len());
        let moments: Moments = spent.iter().copied().collect();
        let error = moments.standard_error();
        assert!((moments.mean() - 1.0).abs() < 5.0 * error, "mean {} {law:?}", moments.mean());
        let variance = moments.variance();
        assert!((variance - 1.0).abs() < most, "variance {variance} {law:?}");
        assert!((seen - expected).abs() < 5.0 * seen.sqrt(), "{seen} seen, {expected} expected");
        // Kolmogorov's 0.1 % point, widened a little for stamps of whole microseconds.
        spent.sort_by(f64::total_cmp);
        let n = spent.len() as f64;
        let distance = spent
            .iter()
            .enumerate()
            .map(|(i, s)| ((1.0 - (-s).exp()) - (i as f64 + 0.5) / n).abs())
            .fold(0.0, f64::max);
        assert!(distance < 2.1 / n.sqrt(), "{distance} of {n} for {law:?}");
    }
}

#[test]
fn a_steady_rise_scores_the_entropy_of_its_thresholds() {
    let law = PixelLaw {
        leak_per_s: 0.0,
        noise_exponent: 0.0,
        noise_speed_per_s: 0.0,
        background_on_hz: 0.0,
        background_off_hz: 0.0,
        ..PixelLaw::default()
    };
    let rise_per_s = 2.0;
    let values: Vec<f32> =
        (0..=20_000).map(|i| (f64::from(i) * 1e-3 * rise_per_s) as f32).collect();
    let values = vec![values; 60];
    let spikes = draw(&law, &values, 5);
    // The entropy of a log-logistic law of median a and shape b is ln(a / b) + 2.
    let entropy = (law.noise_at_white / rise_per_s).ln() + 2.0;
    let score = total(&law, &values, &spikes);
    assert!((score + entropy).abs() < 0.05, "{score} against {}", -entropy);
}

#[test]
fn every_other_law_scores_less_than_the_true_one() {
    let values: Vec<Vec<f32>> = (0..40).map(wander).collect();
    let law = laws()[2];
    let spikes = draw(&law, &values, 9);
    let best = total(&law, &values, &spikes);
    let others: [PixelLaw; 9] = [
        PixelLaw { theta_on: law.theta_on * 1.03, ..law },
        PixelLaw { theta_off: law.theta_off * 0.97, ..law },
        PixelLaw { leak_per_s: 0.08, ..law },
        PixelLaw { noise_at_white: law.noise_at_white * 1.3, ..law },
        PixelLaw { noise_exponent: 0.0, ..law },
        PixelLaw { noise_speed_per_s: 0.5, ..law },
        PixelLaw { background_on_hz: 1.0, ..law },
        PixelLaw { refractory_s: 0.0, ..law },
        PixelLaw { drop_fraction: 0.05, ..law },
    ];
    for other in others {
        let score = total(&other, &values, &spikes);
        assert!(score < best - 1e-3, "{score} against {best} for {other:?}");
    }
}

#[test]
fn constant_light_separates_pixel_noise_from_signal_error() {
    let values: Vec<Vec<f32>> = (0..40).map(wander).collect();
    let plain = laws()[0];
    // Half of the pixels see constant light and leak.
    let of =
        |i: usize| if i.is_multiple_of(2) { vec![0.0; values[i].len()] } else { values[i].clone() };
    let values: Vec<Vec<f32>> = (0..values.len()).map(of).collect();
    let law = PixelLaw { noise_at_rest: 0.2, leak_per_s: 1.0, ..plain };
    let spikes = draw(&law, &values, 9);
    let best = total(&law, &values, &spikes);
    for noise_at_rest in [0.1, 0.4, 1.0] {
        let score = total(&PixelLaw { noise_at_rest, ..law }, &values, &spikes);
        assert!(score < best - 1e-2, "{noise_at_rest}: {score} against {best}");
    }
}

#[test]
fn reset_and_refractory_parameters_are_identifiable() {
    let values: Vec<Vec<f32>> = (0..40).map(wander).collect();
    let [masked, added, carried] = [laws()[3], laws()[4], laws()[5]];
    let cases = [
        (
            masked,
            PixelLaw {
                refractory_s: masked.filter_refractory_s,
                filter_refractory_s: 0.0,
                ..masked
            },
        ),
        (masked, PixelLaw { filter_refractory_s: 0.04, ..masked }),
        (masked, PixelLaw { filter_refractory_s: 0.06, ..masked }),
        (added, PixelLaw { background_reset: 1.0, ..added }),
        (added, PixelLaw { background_reset: 0.5, ..added }),
        (carried, PixelLaw { noise_carry: 0.0, ..carried }),
        (carried, PixelLaw { noise_carry: 0.4, ..carried }),
    ];
    for (law, other) in cases {
        let spikes = draw(&law, &values, 9);
        let (best, score) = (total(&law, &values, &spikes), total(&other, &values, &spikes));
        assert!(score < best - 1e-3, "{score} against {best} for {other:?}");
    }
}

#[test]
fn the_refractory_filter_is_identifiable() {
    let values: Vec<Vec<f32>> = (0..40).map(wander).collect();
    let plain = laws()[0];
    let mut spikes = draw(&plain, &values, 4);
    for own in &mut spikes {
        let mut ready_us = i64::MIN;
        own.retain(|spike| {
            let is_kept = spike.t_us >= ready_us;
            ready_us = if is_kept { spike.t_us + 60_000 } else { ready_us };
            is_kept
        });
    }
    let at = |filter_refractory_s: f64| {
        total(&PixelLaw { filter_refractory_s, ..plain }, &values, &spikes)
    };
    let right = at(0.06);
    for wrong in [0.0, 0.05, 0.057, 0.063, 0.07] {
        assert!(at(wrong) < right - 0.003, "{wrong}: {} against {right}", at(wrong));
    }
    let whole = total(&plain, &values, &draw(&plain, &values, 4));
    assert!(right > whole - 1.0, "{right} against {whole} of all events");
}

#[test]
fn lost_events_are_distinguished_from_a_larger_threshold() {
    let values: Vec<Vec<f32>> = (0..40).map(wander).collect();
    let plain = laws()[0];
    let mut random = SplitMix::new(1, 1);
    let mut spikes = draw(&plain, &values, 4);
    for own in &mut spikes {
        own.retain(|_| random.uniform() > 0.2);
    }
    let at = |drop_fraction: f64, theta: f64| {
        let law = PixelLaw { drop_fraction, theta_on: theta, theta_off: theta, ..plain };
        total(&law, &values, &spikes)
    };
    let right = at(0.2, 0.25);
    for (wrong, by) in [(0.0, 0.1), (0.1, 0.01), (0.15, 1e-3), (0.3, 1e-3), (0.4, 0.01)] {
        assert!(at(wrong, 0.25) < right - by, "{wrong}: {} against {right}", at(wrong, 0.25));
    }
    assert!(right > at(0.0, 0.3) + 0.1);
    let whole = total(&plain, &values, &draw(&plain, &values, 4));
    assert!(right > whole - 0.9, "{right} against {whole} of all events");
}

#[test]
fn stamp_jitter_is_identifiable() {
    let true_s = 0.01;
    let plain = PixelLaw { noise_speed_per_s: 0.0, noise_at_white: 0.005, ..PixelLaw::default() };
    let values: Vec<_> = (0..12).map(wander).collect();
    let mut random = SplitMix::new(23, 0);
    let mut scattered = draw(&plain, &values, 29);
    for spikes in &mut scattered {
        for spike in &mut *spikes {
            spike.t_us += (1e6 * true_s * random.normal()).round() as i64;
        }
        spikes.retain(|spike| (0..END_US).contains(&spike.t_us));
        spikes.sort_by_key(|spike| spike.t_us);
        spikes.dedup_by_key(|spike| spike.t_us);
    }
    let shares = [0.6, 0.8, 1.0, 1.25, 1.6];
    let scores = shares.map(|share| {
        total(
            &PixelLaw { jitter_s: share * true_s, corrects_stamps: true, ..plain },
            &values,
            &scattered,
        )
    });
    let best = (0..shares.len()).max_by(|&a, &b| scores[a].total_cmp(&scores[b])).unwrap();
    assert!((1..=3).contains(&best), "{shares:?} of the true one score {scores:?}");
    // Threshold scatter does not replace stamp jitter.
    let wide = [0.02, 0.04, 0.08].map(|noise_at_white| PixelLaw { noise_at_white, ..plain });
    for law in wide {
        assert!(total(&law, &values, &scattered) < scores[best] - 0.02, "{law:?}");
    }
}

#[test]
fn silent_pixels_favour_a_large_threshold() {
    let values: Vec<Vec<f32>> = (0..20).map(wander).collect();
    let silent = vec![Vec::new(); values.len()];
    let blocks = TimeBlocks::new(END_US, 1);
    let at = |theta: f64| {
        let law = PixelLaw { theta_on: theta, theta_off: theta, ..laws()[0] };
        let one = |values: &Vec<f32>| score_pixel(&law, signal_of(values), &silent[0], &blocks);
        values.iter().map(|v| one(v)[0].log_likelihood()).sum::<f64>()
    };
    assert!(at(4.0) > at(2.0) && at(2.0) > at(0.5));
}

#[test]
fn a_gap_in_the_signal_is_left_out_with_the_reference_level() {
    let mut values = wander(1);
    let law = laws()[0];
    let spikes = draw(&law, &[values.clone()], 2).remove(0);
    let blocks = TimeBlocks::new(END_US, 1);
    let whole = score_pixel(&law, signal_of(&values), &spikes, &blocks)[0];
    values[8_000..9_000].fill(f32::NAN);
    let parted = score_pixel(&law, signal_of(&values), &spikes, &blocks)[0];
    let gap = spikes.iter().filter(|s| s.t_us > 7_999_000 && s.t_us < 9_000_000).count();
    assert!(gap > 0, "the gap takes events away");
    assert_eq!(parted.n_events as usize + gap, whole.n_events as usize);
    assert!(parted.log_likelihood().is_finite());
}
