//! The mean of angles.

/// Sum of unit vectors: how far angles agree, and on which.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MeanDirection {
    cos: f64,
    sin: f64,
    n: u64,
}

impl MeanDirection {
    /// Adds an angle, radians.
    pub fn add(&mut self, angle: f64) {
        let (sin, cos) = angle.sin_cos();
        (self.cos, self.sin) = (self.cos + cos, self.sin + sin);
        self.n += 1;
    }

    /// Length of the mean of the unit vectors: 1 when all angles are one, about 0.9 / sqrt(n) when
    /// n independent ones come by chance; `NaN` without any.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.cos.hypot(self.sin) / self.n as f64
    }

    /// The mean's angle, radians from -pi to pi.
    #[must_use]
    pub fn angle(&self) -> f64 {
        self.sin.atan2(self.cos)
    }

    /// Angles that were added.
    #[must_use]
    pub const fn n(&self) -> u64 {
        self.n
    }
}

impl FromIterator<f64> for MeanDirection {
    fn from_iter<I: IntoIterator<Item = f64>>(angles: I) -> Self {
        let mut mean = Self::default();
        angles.into_iter().for_each(|angle| mean.add(angle));
        mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn angles_about_one_agree_on_it_and_even_ones_on_none() {
        let near: MeanDirection = [0.9, 1.1, 1.0 + TAU].into_iter().collect();
        assert!((near.angle() - 1.0).abs() < 1e-12 && near.length() > 0.99 && near.n() == 3);
        let even: MeanDirection = (0..12).map(|i| TAU * f64::from(i) / 12.0).collect();
        assert!(even.length() < 1e-12);
        assert!(MeanDirection::default().length().is_nan());
    }
}
