//! Subpixel corners: a blurred black square is fitted to the grey image.
//!
//! The square is black ink on white paper. Under a Gaussian blur of standard deviation `s` its
//! coverage is `f = product over the four edges of Phi(-d/s)`, with `d` the signed distance from an
//! edge's line; a pixel reads `white - (white - black) f`. Eight corner coordinates, both levels
//! and the blur are fitted jointly by least squares to the pixels of a band along the outline. The
//! band ends half a cell inside, before the tag's pattern begins. The noise is estimated from the
//! residuals, the covariance from the normal equations.

use super::grey_image::GreyImage;
use nalgebra::{SMatrix, SVector};
use statrs::function::erf::erfc;

/// Corner coordinates, two levels and the logarithm of the blur.
const PARAMETERS: usize = 11;
/// Cells along the side of the black border of tag36h11.
const TAG_CELLS: f64 = 8.0;
const MAX_STEPS: usize = 25;
/// Convergence threshold of a step, pixels.
const CONVERGED_PX: f64 = 1e-4;

/// Corners of a tag in the frame's pixels with their error.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FittedCorners {
    /// Bottom left, bottom right, top right, top left.
    pub(super) points: [[f64; 2]; 4],
    /// Covariance of x and y of each corner in turn.
    pub(super) covariance: SMatrix<f64, 8, 8>,
    /// Standard deviation of the blur, pixels; it includes the pixel's own area.
    pub(super) blur_px: f64,
}

#[derive(Debug, Clone, Copy)]
struct SquareModel {
    points: [[f64; 2]; 4],
    white: f64,
    black: f64,
    log_blur: f64,
}

#[derive(Debug, Clone, Copy)]
struct SquareEdge {
    start: [f64; 2],
    along: [f64; 2],
    length: f64,
}

struct CornerEquations {
    information: SMatrix<f64, PARAMETERS, PARAMETERS>,
    gradient: SVector<f64, PARAMETERS>,
    square_sum: f64,
    n_pixels: usize,
}

impl SquareEdge {
    fn between(start: [f64; 2], end: [f64; 2]) -> Self {
        let [dx, dy] = [end[0] - start[0], end[1] - start[1]];
        let length = dx.hypot(dy);
        Self { start, along: [dx / length, dy / length], length }
    }

    /// Outward normal; the corners run counter-clockwise as seen on screen.
    fn normal(&self) -> [f64; 2] {
        [-self.along[1], self.along[0]]
    }

    /// Signed distance outwards, and the position along the edge as a share of its length.
    fn place(&self, [x, y]: [f64; 2]) -> (f64, f64) {
        let [dx, dy] = [x - self.start[0], y - self.start[1]];
        let normal = self.normal();
        let share = (dx * self.along[0] + dy * self.along[1]) / self.length;
        (dx * normal[0] + dy * normal[1], share)
    }
}

/// Fits the outline from a start at `guess`. None when the square is not wholly in the image, the
/// fit does not converge near the guess, or there is no contrast.
pub(super) fn fit_corners(grey: &GreyImage, guess: [[f64; 2]; 4]) -> Option<FittedCorners> {
    let scale = grey.scale as f64;
    let guess = guess.map(|point| point.map(|part| part / scale));
    let pixels = band(grey, &guess)?;
    let mut square = initial_square(guess, &pixels)?;
    let mut step = CornerEquations::at(&square, &pixels);
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let mut damped = step.information;
        for i in 0..PARAMETERS {
            damped[(i, i)] *= 1.0 + damping;
        }
        let change = damped.cholesky()?.solve(&step.gradient);
        let moved = square.updated(&change);
        let next = CornerEquations::at(&moved, &pixels);
        if next.square_sum <= step.square_sum {
            let is_settled = change.rows(0, 8).amax() < CONVERGED_PX;
            (square, step, damping) = (moved, next, damping * 0.2);
            if is_settled {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    square.accepted(&guess, &step, scale)
}

/// Pixels of the band around the outline: centre and value. None when it leaves the image.
fn band(grey: &GreyImage, guess: &[[f64; 2]; 4]) -> Option<Vec<([f64; 2], f64)>> {
    let edges = edges(guess);
    let side = edges.iter().map(|edge| edge.length).sum::<f64>() / 4.0;
    let cell = side / TAG_CELLS;
    if !(cell >= 1.0 && side.is_finite()) {
        return None;
    }
    // Half a cell on each side, and at least the width of a blurred edge.
    let (inside, outside) = (0.5 * cell, (0.85 * cell).max(1.5));
    let bounds = |axis: usize| {
        let parts = guess.iter().map(|point| point[axis]);
        let low = parts.clone().fold(f64::INFINITY, f64::min) - outside;
        let high = parts.fold(f64::NEG_INFINITY, f64::max) + outside;
        (low.floor(), high.ceil())
    };
    let ((x0, x1), (y0, y1)) = (bounds(0), bounds(1));
    let is_inside = x0 >= 0.0 && y0 >= 0.0 && x1 <= grey.width as f64 && y1 <= grey.height as f64;
    if !is_inside {
        return None;
    }
    let mut pixels = Vec::new();
    for row in y0 as usize..y1 as usize {
        for column in x0 as usize..x1 as usize {
            let centre = [column as f64 + 0.5, row as f64 + 0.5];
            let distance =
                edges.iter().map(|edge| edge.place(centre).0).fold(f64::NEG_INFINITY, f64::max);
            if (-inside..=outside).contains(&distance) {
                pixels.push((centre, f64::from(grey.values[row * grey.width + column])));
            }
        }
    }
    (pixels.len() > 4 * PARAMETERS).then_some(pixels)
}

fn edges(points: &[[f64; 2]; 4]) -> [SquareEdge; 4] {
    [0, 1, 2, 3].map(|i| SquareEdge::between(points[i], points[(i + 1) % 4]))
}

/// The guess with levels from quantiles of the band.
fn initial_square(points: [[f64; 2]; 4], pixels: &[([f64; 2], f64)]) -> Option<SquareModel> {
    let mut sorted: Vec<f64> = pixels.iter().map(|pixel| pixel.1).collect();
    sorted.sort_by(f64::total_cmp);
    let black = evrig_core::stats::quantile_sorted(&sorted, 0.1);
    let white = evrig_core::stats::quantile_sorted(&sorted, 0.9);
    (white > black).then_some(SquareModel { points, white, black, log_blur: 0.0 })
}

impl SquareModel {
    fn updated(&self, change: &SVector<f64, PARAMETERS>) -> Self {
        let mut square = *self;
        for (i, point) in square.points.iter_mut().enumerate() {
            point[0] += change[2 * i];
            point[1] += change[2 * i + 1];
        }
        square.white += change[8];
        square.black += change[9];
        // Larger steps of the blur leave the range in which the edge is linear.
        square.log_blur = (square.log_blur + change[10].clamp(-0.5, 0.5)).clamp(-1.6, 1.6);
        square
    }

    /// The result, if it is near the guess and the contrast exceeds the noise.
    fn accepted(
        &self,
        guess: &[[f64; 2]; 4],
        step: &CornerEquations,
        scale: f64,
    ) -> Option<FittedCorners> {
        let side = SquareEdge::between(guess[0], guess[1]).length;
        let allowed = (0.5 * side / TAG_CELLS).max(1.0);
        let moved =
            |i: usize| (self.points[i][0] - guess[i][0]).hypot(self.points[i][1] - guess[i][1]);
        let variance = step.square_sum / (step.n_pixels - PARAMETERS) as f64;
        let stands_out = self.white - self.black > 3.0 * variance.sqrt();
        if !stands_out || !(0..4).all(|i| moved(i) <= allowed) {
            return None;
        }
        let inverse = step.information.cholesky()?.inverse() * variance;
        let covariance = inverse.fixed_view::<8, 8>(0, 0).into_owned() * (scale * scale);
        Some(FittedCorners {
            points: self.points.map(|point| point.map(|part| part * scale)),
            covariance,
            blur_px: self.log_blur.exp() * scale,
        })
    }
}

impl CornerEquations {
    fn at(square: &SquareModel, pixels: &[([f64; 2], f64)]) -> Self {
        let edges = edges(&square.points);
        let blur = square.log_blur.exp();
        let mut step = Self {
            information: SMatrix::zeros(),
            gradient: SVector::zeros(),
            square_sum: 0.0,
            n_pixels: pixels.len(),
        };
        for &(centre, value) in pixels {
            let (expected, slope) = expectation(square, &edges, blur, centre);
            let residual = value - expected;
            step.square_sum += residual * residual;
            step.gradient += slope * residual;
            step.information.ger(1.0, &slope, &slope, 1.0);
        }
        step
    }
}

/// Expected value of a pixel and its derivatives by the parameters.
fn expectation(
    square: &SquareModel,
    edges: &[SquareEdge; 4],
    blur: f64,
    centre: [f64; 2],
) -> (f64, SVector<f64, PARAMETERS>) {
    let places = edges.map(|edge| edge.place(centre));
    let shares = places.map(|(distance, _)| normal_cdf(-distance / blur));
    let inside = shares.iter().product::<f64>();
    let contrast = square.white - square.black;
    let mut slope = SVector::zeros();
    for (i, &(distance, along)) in places.iter().enumerate() {
        let others: f64 = (0..4).filter(|&j| j != i).map(|j| shares[j]).product();
        let z = distance / blur;
        let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt() / blur;
        // Change of the value per pixel of outward motion.
        let steepness = contrast * density * others;
        let normal = edges[i].normal();
        let next = (i + 1) % 4;
        for axis in 0..2 {
            slope[2 * i + axis] -= steepness * (1.0 - along) * normal[axis];
            slope[2 * next + axis] -= steepness * along * normal[axis];
        }
        slope[10] -= steepness * distance;
    }
    slope[8] = 1.0 - inside;
    slope[9] = inside;
    (square.white - contrast * inside, slope)
}

fn normal_cdf(z: f64) -> f64 {
    0.5 * erfc(-z * std::f64::consts::FRAC_1_SQRT_2)
}
