//! The image on the target.

use super::draws::{RandomPurpose, WorldRandom};
use super::error::WorldError;
use std::f64::consts::TAU;
use std::path::Path;

/// Side of a bundled image in samples: 0.042 mm on the default print, a third of the Pi's pixel.
const SIDE: usize = 1024;

/// Largest side of an image file.
const MAX_SIDE: u32 = 8192;

/// A square image: ink from 0 (darkest) to 1 (paper), row by row.
#[derive(Debug, Clone)]
pub(super) enum TargetImage {
    /// Samples of equal spacing.
    Sampled { width: usize, height: usize, values: Vec<f32> },
    /// Bare paper.
    Plain,
    /// Sinusoidal stripes in log reflectance; for measurements.
    Stripes { period_mm: f64, angle_deg: f64 },
}

impl TargetImage {
    /// The image of this name.
    pub(super) fn named(name: &str) -> Result<Self, WorldError> {
        let unknown = || WorldError::UnknownImage { got: name.to_owned() };
        if name == "plain" {
            Ok(Self::Plain)
        } else if let Some(seed) = name.strip_prefix("leaves-") {
            Ok(leaves(seed.parse().map_err(|_| unknown())?))
        } else if let Some(path) = name.strip_prefix("file:") {
            file(Path::new(path))
        } else if let Some(numbers) = name.strip_prefix("stripes-") {
            let (period, angle) = numbers.split_once('-').ok_or_else(unknown)?;
            let period_mm: f64 = period.parse().map_err(|_| unknown())?;
            let angle_deg: f64 = angle.parse().map_err(|_| unknown())?;
            let is_sane = period_mm > 0.0 && period_mm.is_finite() && angle_deg.is_finite();
            is_sane.then_some(Self::Stripes { period_mm, angle_deg }).ok_or_else(unknown)
        } else {
            Err(unknown())
        }
    }

    /// Reflectance between `black` and 1 at a place: shares of the side from left and top.
    pub(super) fn reflectance(&self, right: f64, down: f64, side_mm: f64, black: f64) -> f64 {
        match self {
            Self::Plain => 1.0,
            Self::Stripes { period_mm, angle_deg } => {
                let (sin, cos) = angle_deg.to_radians().sin_cos();
                let phase = (right * cos + down * sin) * side_mm / period_mm;
                black.powf(0.5 - 0.5 * (TAU * phase).sin())
            }
            Self::Sampled { width, height, values } => {
                let at = |part: f64, n: usize| ((part * n as f64) as usize).min(n - 1);
                let ink = values[at(down, *height) * width + at(right, *width)];
                black + (1.0 - black) * f64::from(ink)
            }
        }
    }
}

/// Dead leaves: opaque discs and polygons of random size, turn and grey over each other. Their
/// radii's density falls as the cube, which gives the 1/f amplitude spectrum and the edges of every
/// direction that natural images have (Lee, Mumford and Huang, IJCV 41:35, 2001).
fn leaves(seed: u64) -> TargetImage {
    let mut draws = WorldRandom::new(seed, RandomPurpose::TargetImage, 0, 0);
    let mut values = vec![0.5_f32; SIDE * SIDE];
    for _ in 0..6_000 {
        let (smallest, largest) = (10.0_f64, 260.0_f64);
        let u = draws.uniform();
        let inverse = smallest.powi(-2) * (1.0 - u) + largest.powi(-2) * u;
        let leaf = LeafShape {
            centre: [draws.uniform(), draws.uniform()].map(|part| part * SIDE as f64),
            radius: inverse.powf(-0.5),
            corners: (draws.uniform() * 5.0) as u32 + 2,
            turn: draws.uniform() * TAU,
            stretch: 0.5 + draws.uniform(),
        };
        leaf.draw(&mut values, draws.uniform() as f32);
    }
    TargetImage::Sampled { width: SIDE, height: SIDE, values }
}

struct LeafShape {
    centre: [f64; 2],
    radius: f64,
    /// Below three: a disc.
    corners: u32,
    turn: f64,
    stretch: f64,
}

impl LeafShape {
    fn draw(&self, values: &mut [f32], ink: f32) {
        let reach = self.radius * self.stretch.max(1.0 / self.stretch);
        let range = |centre: f64| {
            let low = (centre - reach).floor().max(0.0) as usize;
            low..((centre + reach).ceil().max(0.0) as usize).min(SIDE)
        };
        let (sin, cos) = self.turn.sin_cos();
        for y in range(self.centre[1]) {
            for x in range(self.centre[0]) {
                let (dx, dy) = (x as f64 + 0.5 - self.centre[0], y as f64 + 0.5 - self.centre[1]);
                let along = (dx * cos + dy * sin) / self.stretch;
                let across = (dy * cos - dx * sin) * self.stretch;
                if self.contains(along, across) {
                    values[y * SIDE + x] = ink;
                }
            }
        }
    }

    fn contains(&self, x: f64, y: f64) -> bool {
        let distance = x.hypot(y);
        if distance > self.radius || self.corners < 3 {
            return distance <= self.radius;
        }
        let sector = TAU / f64::from(self.corners);
        let angle = y.atan2(x).rem_euclid(sector) - sector / 2.0;
        distance * angle.cos() <= self.radius * (sector / 2.0).cos()
    }
}

fn file(path: &Path) -> Result<TargetImage, WorldError> {
    let failed =
        |reason: String| WorldError::ImageFile { path: path.display().to_string(), reason };
    let mut reader = image::ImageReader::open(path)
        .and_then(image::ImageReader::with_guessed_format)
        .map_err(|error| failed(error.to_string()))?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    reader.limits(limits);
    let image = reader.decode().map_err(|error| failed(error.to_string()))?.to_luma16();
    let (width, height) = (image.width() as usize, image.height() as usize);
    if width == 0 || height == 0 {
        return Err(failed("it has no pixels".to_owned()));
    }
    // Files hold sRGB values; reflectance is linear.
    let linear = |value: u16| {
        let v = f32::from(value) / 65535.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
    let values = image.as_raw().iter().map(|value| linear(*value)).collect();
    Ok(TargetImage::Sampled { width, height, values })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_is_no_image_is_refused() {
        for name in ["", "leaves", "leaves-x", "stripes-3", "stripes-0-10", "cat.png"] {
            let error = TargetImage::named(name).unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        }
        let error = TargetImage::named("file:/no/such/image.png").unwrap_err().to_string();
        assert!(error.contains("/no/such/image.png"), "{error}");
    }

    #[test]
    fn seeds_give_different_leaves_with_edges_in_every_direction() {
        let gradients = |seed| {
            let TargetImage::Sampled { values, .. } = leaves(seed) else {
                panic!("leaves are sampled")
            };
            // Means of blocks: the edge of a single sample has only eight directions.
            const BLOCK: usize = 8;
            const N: usize = SIDE / BLOCK;
            let mean = |x: usize, y: usize| -> f64 {
                let samples = (0..BLOCK * BLOCK)
                    .map(|i| values[(y * BLOCK + i / BLOCK) * SIDE + x * BLOCK + i % BLOCK]);
                samples.map(f64::from).sum::<f64>() / (BLOCK * BLOCK) as f64
            };
            let mut histogram = [0.0_f64; 8];
            for (x, y) in (0..(N - 1) * (N - 1)).map(|i| (i % (N - 1), i / (N - 1))) {
                let (dx, dy) = (mean(x + 1, y) - mean(x, y), mean(x, y + 1) - mean(x, y));
                let bin = (dy.atan2(dx).rem_euclid(TAU) / TAU * 8.0) as usize;
                histogram[bin.min(7)] += dx.hypot(dy);
            }
            histogram
        };
        let (first, second) = (gradients(1), gradients(2));
        assert_ne!(first, second);
        let total: f64 = first.iter().sum();
        assert!(first.iter().all(|part| *part > 0.06 * total), "{first:?}");
    }
}
