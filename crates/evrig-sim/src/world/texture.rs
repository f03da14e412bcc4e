//! The target as one camera's optics leave it: blurred by lens and pixel aperture before it is
//! sampled, so that motion over it makes no change that the camera could not see.

use super::target::PrintedTarget;
use rayon::prelude::*;
use statrs::function::erf::erf;

/// Samples on each axis of a texel when the target is rasterised.
const SUPERSAMPLES: usize = 3;

/// Texels along the side of a cell whose range of values is known.
const CELL: usize = 8;

/// A cell whose values differ by less than this, relative to white, is flat.
const FLAT: f32 = 1e-5;

/// Reflectance on a regular grid, texel (0, 0) centred at the coordinates (0, 0).
#[derive(Debug)]
pub(super) struct TargetTexture {
    width: usize,
    height: usize,
    values: Vec<f32>,
    outside: f32,
    cells: Flatness,
    /// Texels a millimetre.
    pub(super) per_mm: f64,
    /// Millimetres on the target of texel (0, 0).
    pub(super) origin_mm: [f64; 2],
}

/// Which cells of a texture are flat.
#[derive(Debug)]
struct Flatness {
    columns: usize,
    rows: usize,
    /// How many cells that are not flat lie above and left of a cell's corner.
    rough_before: Vec<u32>,
}

/// What blurs a target: a box of the pixel's aperture and a Gaussian, both in texels.
#[derive(Debug, Clone, Copy)]
pub(super) struct TargetBlur {
    pub(super) aperture: f64,
    pub(super) sigma: f64,
}

impl TargetTexture {
    /// Number of texels the target has at this density, margins for the blur included.
    pub(super) fn count(target: &PrintedTarget, per_mm: f64, blur: TargetBlur) -> usize {
        let [left, top, right, bottom] = Self::frame(target, per_mm, blur);
        ((right - left) * per_mm) as usize * ((bottom - top) * per_mm) as usize
    }

    fn frame(target: &PrintedTarget, per_mm: f64, blur: TargetBlur) -> [f64; 4] {
        let [left, top, right, bottom] = target.bounds_mm();
        let margin = (blur.reach() as f64) / per_mm;
        [left - margin, top - margin, right + margin, bottom + margin]
    }

    pub(super) fn new(target: &PrintedTarget, per_mm: f64, blur: TargetBlur) -> Self {
        let [left, top, right, bottom] = Self::frame(target, per_mm, blur);
        let width = ((right - left) * per_mm).ceil() as usize;
        let height = ((bottom - top) * per_mm).ceil() as usize;
        let origin_mm = [left, top];
        let sharp = rasterise(target, [width, height], per_mm, origin_mm);
        let kernel = blur.kernel();
        let across = transposed(&blurred_rows(&sharp, width, &kernel), width);
        let values = transposed(&blurred_rows(&across, height, &kernel), height);
        let outside = target.white() as f32;
        let cells = Flatness::of(&values, width, height, FLAT * outside);
        Self { width, height, values, outside, cells, per_mm, origin_mm }
    }

    /// Reflectance at texel coordinates, linear between texels; bare paper outside.
    #[inline]
    pub(super) fn sample(&self, x: f32, y: f32) -> f32 {
        let inside =
            x >= 0.0 && y >= 0.0 && x < (self.width - 1) as f32 && y < (self.height - 1) as f32;
        if !inside {
            return self.outside;
        }
        let (i, j) = (x as usize, y as usize);
        let (u, v) = (x - i as f32, y - j as f32);
        let at = j * self.width + i;
        let (above, below) = (&self.values[at..at + 2], &self.values[at + self.width..]);
        let top = above[0] + u * (above[1] - above[0]);
        let bottom = below[0] + u * (below[1] - below[0]);
        top + v * (bottom - top)
    }

    /// Whether all that a way through these texels can meet has one value. Between two of the
    /// places the way must bend by less than a quarter of what it spans.
    pub(super) fn is_flat_along(&self, places: impl IntoIterator<Item = [f32; 2]>) -> bool {
        let mut low = [f32::INFINITY; 2];
        let mut high = [f32::NEG_INFINITY; 2];
        for place in places {
            for axis in 0..2 {
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
        }
        let spare = [0, 1].map(|axis| 1.0 + 0.25 * (high[axis] - low[axis]));
        self.is_flat([low[0] - spare[0], low[1] - spare[1], high[0] + spare[0], high[1] + spare[1]])
    }

    /// Whether all of this rectangle of texel coordinates has one value.
    pub(super) fn is_flat(&self, [left, top, right, bottom]: [f32; 4]) -> bool {
        self.cells.is_flat([left, top], [right + 1.0, bottom + 1.0])
    }
}

impl Flatness {
    fn of(values: &[f32], width: usize, height: usize, tolerance: f32) -> Self {
        let (columns, rows) = (width.div_ceil(CELL), height.div_ceil(CELL));
        let is_rough = |column: usize, row: usize| {
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for y in row * CELL..((row + 1) * CELL + 1).min(height) {
                for x in column * CELL..((column + 1) * CELL + 1).min(width) {
                    low = low.min(values[y * width + x]);
                    high = high.max(values[y * width + x]);
                }
            }
            high - low > tolerance
        };
        let stride = columns + 1;
        let mut rough_before = vec![0_u32; stride * (rows + 1)];
        for row in 0..rows {
            for column in 0..columns {
                let at = (row + 1) * stride + column + 1;
                rough_before[at] = u32::from(is_rough(column, row))
                    + rough_before[at - 1]
                    + rough_before[at - stride]
                    - rough_before[at - stride - 1];
            }
        }
        Self { columns, rows, rough_before }
    }

    fn is_flat(&self, low: [f32; 2], high: [f32; 2]) -> bool {
        if !(low[0].is_finite() && low[1].is_finite() && high[0].is_finite() && high[1].is_finite())
        {
            return false;
        }
        let cell = |texel: f32, n: usize| ((texel.max(0.0) / CELL as f32) as usize).min(n);
        let (left, top) = (cell(low[0], self.columns), cell(low[1], self.rows));
        let right = cell(high[0] + CELL as f32, self.columns);
        let bottom = cell(high[1] + CELL as f32, self.rows);
        let before =
            |column: usize, row: usize| self.rough_before[row * (self.columns + 1) + column];
        before(right, bottom) + before(left, top) == before(left, bottom) + before(right, top)
    }
}

impl TargetBlur {
    /// Texels on either side that count.
    fn reach(self) -> usize {
        (self.aperture / 2.0 + 4.0 * self.sigma).ceil() as usize + 1
    }

    /// The box convolved with the Gaussian, integrated over each texel's place, of sum one.
    fn kernel(self) -> Vec<f32> {
        let reach = self.reach() as i64;
        let sigma = self.sigma.max(1e-3) * std::f64::consts::SQRT_2;
        let half = self.aperture.max(1e-3) / 2.0;
        let weight = |i: i64| erf((i as f64 + half) / sigma) - erf((i as f64 - half) / sigma);
        let weights: Vec<f64> = (-reach..=reach).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|weight| (weight / sum) as f32).collect()
    }
}

fn rasterise(
    target: &PrintedTarget,
    [width, height]: [usize; 2],
    per_mm: f64,
    origin_mm: [f64; 2],
) -> Vec<f32> {
    let mut values = vec![0.0_f32; width * height];
    let n = SUPERSAMPLES;
    let offset = |k: usize| (k as f64 + 0.5) / n as f64 - 0.5;
    values.par_chunks_mut(width).enumerate().for_each(|(j, row)| {
        for (i, value) in row.iter_mut().enumerate() {
            let mut sum = 0.0;
            for k in 0..n * n {
                let x = (i as f64 + offset(k % n)) / per_mm + origin_mm[0];
                let y = (j as f64 + offset(k / n)) / per_mm + origin_mm[1];
                sum += target.reflectance(x, y);
            }
            *value = (sum / (n * n) as f64) as f32;
        }
    });
    values
}

/// Each row convolved with the kernel; beyond its ends a row goes on as it ends.
fn blurred_rows(values: &[f32], width: usize, kernel: &[f32]) -> Vec<f32> {
    let reach = kernel.len() / 2;
    let mut blurred = vec![0.0_f32; values.len()];
    let rows = blurred.par_chunks_mut(width).zip(values.par_chunks(width));
    rows.for_each(|(to, from)| {
        let mut padded = vec![from[0]; reach];
        padded.extend_from_slice(from);
        padded.extend(std::iter::repeat_n(from[width - 1], reach));
        for (i, value) in to.iter_mut().enumerate() {
            let under = &padded[i..i + kernel.len()];
            *value = under.iter().zip(kernel).map(|(value, weight)| value * weight).sum();
        }
    });
    blurred
}

fn transposed(values: &[f32], width: usize) -> Vec<f32> {
    let height = values.len() / width;
    let mut turned = vec![0.0_f32; values.len()];
    turned.par_chunks_mut(height).enumerate().for_each(|(x, column)| {
        for (y, value) in column.iter_mut().enumerate() {
            *value = values[y * width + x];
        }
    });
    turned
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::description::PrintedTargetDescription;
    use evrig_session::rig::Rig;

    fn texture(image: &str, per_mm: f64, blur: TargetBlur) -> (PrintedTarget, TargetTexture) {
        let description = PrintedTargetDescription {
            image: image.to_owned(),
            ..PrintedTargetDescription::default()
        };
        let target = PrintedTarget::new(&description, &Rig::simulated().unwrap().target).unwrap();
        let texture = TargetTexture::new(&target, per_mm, blur);
        (target, texture)
    }

    fn at(texture: &TargetTexture, x_mm: f64, y_mm: f64) -> f32 {
        let [left, top] = texture.origin_mm;
        let place = [(x_mm - left) * texture.per_mm, (y_mm - top) * texture.per_mm];
        texture.sample(place[0] as f32, place[1] as f32)
    }

    #[test]
    fn a_straight_edge_becomes_the_integral_of_aperture_and_point_spread() {
        let blur = TargetBlur { aperture: 4.0, sigma: 3.0 };
        let (target, texture) = texture("plain", 6.0, blur);
        // The left edge of the tag's border: white to the left, 0.04 to the right.
        let [[left, top], _, [_, bottom], _] = target.tag_corners_mm();
        for tenth in -15..=15 {
            let from_edge = f64::from(tenth) / 10.0;
            let got = at(&texture, left + from_edge, top + 0.03 * (bottom - top) + 2.5);
            let primitive = |x: f64| {
                let z = x / 3.0;
                let gauss = (-z * z / 2.0).exp() / std::f64::consts::TAU.sqrt();
                x * 0.5 * (1.0 + erf(z / std::f64::consts::SQRT_2)) + 3.0 * gauss
            };
            let texels = from_edge * 6.0;
            let passed = (primitive(texels + 2.0) - primitive(texels - 2.0)) / 4.0;
            let expected = 1.0 - 0.96 * passed;
            // One cell of border is 1.8 mm wide: its other edge is 10 texels off, over 3 sigma.
            if from_edge < 0.2 {
                // Nine samples a texel place the edge within a sixth of a texel.
                assert!((f64::from(got) - expected).abs() < 0.02, "{from_edge}: {got} {expected}");
            }
        }
    }

    #[test]
    fn paper_is_flat_and_the_image_is_not() {
        let (target, texture) = texture("leaves-1", 6.0, TargetBlur { aperture: 4.0, sigma: 2.0 });
        let [left, top, ..] = target.bounds_mm();
        let texel = |mm: f64, from: f64| ((mm - from) * texture.per_mm) as f32;
        let [x0, y0] = texture.origin_mm;
        let rough = [texel(-20.0, x0), texel(0.0, y0), texel(-10.0, x0), texel(5.0, y0)];
        assert!(!texture.is_flat(rough));
        let corner = texel(left + 1.0, x0);
        assert!(texture.is_flat([
            corner,
            texel(top + 1.0, y0),
            corner + 2.0,
            texel(top + 1.3, y0)
        ]));
        assert!(texture.is_flat([-500.0, -500.0, -400.0, -400.0]));
        assert!(texture.is_flat([1e6, 0.0, 1e6 + 3.0, 10.0]));
        assert!(!texture.is_flat([-1e6, -1e6, 1e6, 1e6]));
    }
}
