//! Sinkhorn divergence on a line with the cost |x - y|, debiased.
//!
//! OT_e(a, b) = min over plans P of <P, C> + e KL(P | a x b). The potentials follow from
//! alternating soft minima, f(x) = -e log sum_y b(y) exp((g(y) - |x - y|) / e). On a line the
//! kernel exp(-|x - y| / e) factorises over steps, so that a soft minimum over all y takes one
//! sweep from each side: linear instead of quadratic time, without cut-off. The blur is annealed
//! from the width of the line to e, then held until the potentials converge. Definition and
//! derivative: Feydy et al., AISTATS 2019.

/// The divergence of two histograms.
#[derive(Debug, Clone)]
pub(super) struct Divergence {
    /// Its value, in units of `step`'s axis; NaN when a histogram is empty.
    pub(super) value: f64,
    /// Derivative with respect to the shares of the first and the second histogram;
    /// the shares' dot products with them add up to the value.
    pub(super) potentials: [Vec<f64>; 2],
    /// Last change of a potential when the iteration stopped.
    pub(super) last_change: f64,
}

/// Bound on the iterations at the final blur.
const MAX_ITERATIONS: usize = 1_000;
/// Factor by which the blur falls in each annealing step.
const ANNEALING: f64 = 0.8;
/// A change of the potentials below this share of the blur ends the iteration.
const SETTLED_CHANGE: f64 = 1e-4;

/// Divergence of two histograms on the same equidistant bins.
#[must_use]
pub(super) fn divergence(one: &[f64], other: &[f64], step: f64, blur: f64) -> Divergence {
    let is_filled = |&i: &usize| one[i] + other[i] > 0.0;
    let first = (0..one.len()).find(is_filled).unwrap_or(0);
    let end = (first..one.len()).rev().find(is_filled).map_or(first, |last| last + 1);
    let mut result = of_filled(&one[first..end], &other[first..end], step, blur);
    for potential in &mut result.potentials {
        let mut whole = vec![0.0; one.len()];
        whole[first..end].copy_from_slice(potential);
        *potential = whole;
    }
    result
}

fn of_filled(one: &[f64], other: &[f64], step: f64, blur: f64) -> Divergence {
    let (Some(log_one), Some(log_other)) = (log_shares(one), log_shares(other)) else {
        let nothing = vec![f64::NAN; one.len()];
        return Divergence {
            value: f64::NAN,
            potentials: [nothing.clone(), nothing],
            last_change: f64::NAN,
        };
    };
    if log_one == log_other {
        let zeros = vec![0.0; one.len()];
        return Divergence { value: 0.0, potentials: [zeros.clone(), zeros], last_change: 0.0 };
    }
    let line = SinkhornLine { step, blur };
    let (f, g, last_change) = line.potentials(&log_one, &log_other);
    let (own_one, unsettled_one) = line.own_potential(&log_one);
    let (own_other, unsettled_other) = line.own_potential(&log_other);
    let minus =
        |a: Vec<f64>, b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
    let (f, g) = (minus(f, &own_one), minus(g, &own_other));
    let mean = |log_shares: &[f64], potential: &[f64]| -> f64 {
        log_shares.iter().zip(potential).map(|(share, p)| share.exp() * p).sum()
    };
    let value = mean(&log_one, &f) + mean(&log_other, &g);
    let last_change = last_change + unsettled_one + unsettled_other;
    Divergence { value, potentials: [f, g], last_change }
}

fn log_shares(counts: &[f64]) -> Option<Vec<f64>> {
    let sum: f64 = counts.iter().sum();
    (sum > 0.0).then(|| counts.iter().map(|count| (count / sum).ln()).collect())
}

struct SinkhornLine {
    step: f64,
    blur: f64,
}

impl SinkhornLine {
    fn annealing(&self, n: usize) -> Vec<f64> {
        let width = self.step * n as f64;
        std::iter::successors(Some(width), |blur| Some(blur * ANNEALING))
            .take_while(|&blur| blur > self.blur)
            .collect()
    }

    fn potentials(&self, log_a: &[f64], log_b: &[f64]) -> (Vec<f64>, Vec<f64>, f64) {
        let mut f = vec![0.0; log_a.len()];
        let mut g = vec![0.0; log_b.len()];
        for blur in self.annealing(log_a.len()) {
            f = self.soft_minimum(log_b, &g, blur);
            g = self.soft_minimum(log_a, &f, blur);
        }
        let mut change = f64::INFINITY;
        for _ in 0..MAX_ITERATIONS {
            let next = self.soft_minimum(log_b, &g, self.blur);
            change = largest_change(&f, &next, log_a);
            f = next;
            g = self.soft_minimum(log_a, &f, self.blur);
            if change < SETTLED_CHANGE * self.blur {
                break;
            }
        }
        (f, g, change)
    }

    /// The potential of a histogram against itself, by averaged steps.
    fn own_potential(&self, log_a: &[f64]) -> (Vec<f64>, f64) {
        let mut f = vec![0.0; log_a.len()];
        let mut change = f64::INFINITY;
        let held = std::iter::repeat_n(self.blur, MAX_ITERATIONS);
        for blur in self.annealing(log_a.len()).into_iter().chain(held) {
            let next = self.soft_minimum(log_a, &f, blur);
            change = largest_change(&f, &next, log_a);
            f.iter_mut().zip(&next).for_each(|(f, next)| *f = 0.5 * (*f + next));
            if blur <= self.blur && change < SETTLED_CHANGE * self.blur {
                break;
            }
        }
        (self.soft_minimum(log_a, &f, self.blur), change)
    }

    /// -blur log sum_y exp(log_shares(y) + (potential(y) - |x - y|) / blur) for every x.
    fn soft_minimum(&self, log_shares: &[f64], potential: &[f64], blur: f64) -> Vec<f64> {
        let decay = self.step / blur;
        let term = |i: usize| log_shares[i] + potential[i] / blur;
        let mut from_left = vec![f64::NEG_INFINITY; log_shares.len()];
        let mut sum = f64::NEG_INFINITY;
        for (i, left) in from_left.iter_mut().enumerate() {
            sum = log_add(sum - decay, term(i));
            *left = sum;
        }
        let mut result = from_left;
        let mut from_right = f64::NEG_INFINITY;
        for (i, left) in result.iter_mut().enumerate().rev() {
            from_right -= decay;
            *left = -blur * log_add(*left, from_right);
            from_right = log_add(from_right, term(i));
        }
        result
    }
}

/// log(exp(a) + exp(b)), with -infinity for log 0.
fn log_add(a: f64, b: f64) -> f64 {
    let (large, small) = if a >= b { (a, b) } else { (b, a) };
    if small == f64::NEG_INFINITY { large } else { large + (small - large).exp().ln_1p() }
}

/// Largest change where the histogram has mass, apart from a common shift: potentials are
/// determined up to a constant.
fn largest_change(old: &[f64], new: &[f64], log_shares: &[f64]) -> f64 {
    let changes = old.iter().zip(new).zip(log_shares).filter(|(_, s)| s.is_finite());
    let (low, high) = changes
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), ((o, n), _)| {
            (low.min(n - o), high.max(n - o))
        });
    (high - low).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 0.01;

    fn bell(mean: f64, spread: f64) -> Vec<f64> {
        (0..900)
            .map(|i| (-0.5 * (((f64::from(i) + 0.5) * STEP - mean) / spread).powi(2)).exp())
            .collect()
    }

    /// Area between the distribution functions.
    fn exact(one: &[f64], other: &[f64]) -> f64 {
        let (sum_one, sum_other): (f64, f64) = (one.iter().sum(), other.iter().sum());
        let mut excess = 0.0;
        let mut area = 0.0;
        for (a, b) in one.iter().zip(other) {
            excess += a / sum_one - b / sum_other;
            area += f64::abs(excess) * STEP;
        }
        area
    }

    #[test]
    fn a_vanishing_blur_gives_the_exact_distance_on_the_line() {
        let (one, other) = (bell(2.5, 0.6), bell(3.1, 0.4));
        // numpy: abs(cumsum(a - b)).sum() * 0.01 of the two normed bells = 0.6001121894613595
        assert!((exact(&one, &other) - 0.600_112_189).abs() < 1e-8);
        let error = |blur| (divergence(&one, &other, STEP, blur).value - exact(&one, &other)).abs();
        // Many plans share the least cost on a line; the blur prefers the widest of them and
        // so lowers the divergence by about blur x ln(spread / blur).
        for (blur, expected) in [(0.05, 0.128), (0.02, 0.069), (0.005, 0.023)] {
            assert!((error(blur) - expected).abs() < 0.002, "{blur}: {}", error(blur));
        }
    }

    #[test]
    fn point_masses_are_as_far_apart_as_they_lie() {
        let point = |i: usize| {
            let mut line = vec![0.0; 900];
            line[i] = 3.0;
            line
        };
        for (a, b) in [(100, 101), (20, 320), (0, 899)] {
            let result = divergence(&point(a), &point(b), STEP, 0.05);
            assert!((result.value - (b - a) as f64 * STEP).abs() < 1e-9, "{}", result.value);
        }
    }

    #[test]
    fn the_potentials_are_the_derivative() {
        let (one, other) = (bell(2.5, 0.6), bell(2.7, 0.4));
        let normed = |line: &[f64]| -> Vec<f64> {
            let sum: f64 = line.iter().sum();
            line.iter().map(|n| n / sum).collect()
        };
        let (one, other) = (normed(&one), normed(&other));
        let result = divergence(&one, &other, STEP, 0.05);
        let moved: Vec<f64> =
            one.iter().zip(normed(&bell(2.6, 0.6))).map(|(a, b)| a + 1e-3 * (b - a)).collect();
        let predicted: f64 =
            moved.iter().zip(&one).zip(&result.potentials[0]).map(|((m, o), p)| (m - o) * p).sum();
        let found = divergence(&moved, &other, STEP, 0.05).value - result.value;
        assert!((found / predicted - 1.0).abs() < 0.02, "{found} and {predicted}");
    }

    #[test]
    fn an_empty_histogram_has_no_distance() {
        assert!(divergence(&[0.0; 9], &[1.0; 9], STEP, 0.05).value.is_nan());
    }
}
