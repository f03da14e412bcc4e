//! Discrete Fourier transform of a power of two of samples.

use std::f64::consts::PI;

/// Transforms complex samples in place (Cooley and Tukey 1965): `re` and `im` have the same length,
/// a power of two; others are left as they are.
pub(super) fn transform(re: &mut [f64], im: &mut [f64]) {
    let n = re.len();
    if n != im.len() || !n.is_power_of_two() || n < 2 {
        return;
    }
    let shift = usize::BITS - n.trailing_zeros();
    for i in 0..n {
        let j = i.reverse_bits() >> shift;
        if i < j {
            re.swap(i, j);
            im.swap(i, j);
        }
    }
    let mut half = 1;
    while half < n {
        let turns: Vec<[f64; 2]> = (0..half)
            .map(|k| {
                let angle = -PI * k as f64 / half as f64;
                [angle.cos(), angle.sin()]
            })
            .collect();
        for start in (0..n).step_by(2 * half) {
            for (k, [c, s]) in turns.iter().enumerate() {
                let (a, b) = (start + k, start + k + half);
                let [x, y] = [re[b] * c - im[b] * s, re[b] * s + im[b] * c];
                (re[b], im[b]) = (re[a] - x, im[a] - y);
                (re[a], im[a]) = (re[a] + x, im[a] + y);
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn a_sine_has_its_power_at_its_own_frequency() {
        let n = 64;
        let mut re: Vec<f64> = (0..n).map(|i| (TAU * 5.0 * i as f64 / n as f64).sin()).collect();
        let mut im = vec![0.0; n];
        transform(&mut re, &mut im);
        for k in 0..n {
            let length = re[k].hypot(im[k]);
            let expected = if k == 5 || k == n - 5 { 32.0 } else { 0.0 };
            assert!((length - expected).abs() < 1e-9, "{k}: {length}");
        }
    }
}
