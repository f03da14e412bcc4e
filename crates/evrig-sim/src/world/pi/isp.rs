//! The Pi's image processing: demosaic, white balance, tone curve, eight bits.

use crate::world::scene::World;
use evrig_core::geometry::Size;
use rayon::prelude::*;

/// White paper comes out at this share of the full range.
const WHITE: f64 = 0.85;

/// Turns a raw frame into an RGB one.
#[derive(Debug)]
pub(super) struct Isp {
    /// Eight-bit value for each raw value of red, green and blue: pedestal, balance and curve in
    /// one, in [`STEPS`] of a DN so that averages keep their fraction.
    curves: [Vec<u8>; 3],
}

/// Steps of the curve a DN.
const STEPS: u32 = 4;

impl Isp {
    pub(super) fn new(world: &World) -> Self {
        let sensor = &world.description.pi;
        let black = world.rig.pi.camera.black_level_dn;
        let n = (1_u32 << world.rig.pi.raw_bits) * STEPS;
        let curves = sensor.colour_response.map(|response| {
            let white = response * sensor.white_dn;
            let value = |step: u32| {
                let linear = (f64::from(step) / f64::from(STEPS) - black) / white * WHITE;
                (linear.clamp(0.0, 1.0).powf(sensor.rgb_gamma) * 255.0).round() as u8
            };
            (0..n).map(value).collect()
        });
        Self { curves }
    }

    /// Blue, green, red of each pixel of a mosaic RGGB, colours that a pixel lacks averaged from
    /// its neighbours.
    pub(super) fn develop(&self, raw: &[u16], size: Size) -> Vec<u8> {
        let (width, height) = (usize::from(size.width), usize::from(size.height));
        let mut bgr = vec![0_u8; raw.len() * 3];
        if width < 2 || height < 2 {
            return bgr;
        }
        bgr.par_chunks_mut(width * 3).enumerate().for_each(|(y, line)| {
            // Mirrored at the border, which keeps each colour on its places.
            let above = if y == 0 { 1 } else { y - 1 };
            let below = if y + 1 == height { height - 2 } else { y + 1 };
            let rows = [above, y, below].map(|row| &raw[row * width..(row + 1) * width]);
            for (x, bgr) in line.chunks_exact_mut(3).enumerate() {
                let left = if x == 0 { 1 } else { x - 1 };
                let right = if x + 1 == width { width - 2 } else { x + 1 };
                let colours = colours(&rows, [left, x, right], [x % 2 == 1, y % 2 == 1]);
                for (channel, sum) in colours.into_iter().enumerate() {
                    let curve = &self.curves[channel];
                    bgr[2 - channel] = curve[(sum as usize).min(curve.len() - 1)];
                }
            }
        });
        bgr
    }
}

/// Red, green and blue at a pixel, in [`STEPS`] of a DN.
fn colours(rows: &[&[u16]; 3], [left, x, right]: [usize; 3], odd: [bool; 2]) -> [u32; 3] {
    let at = |row: usize, column: usize| u32::from(rows[row][column]);
    let own = 4 * at(1, x);
    let across = 2 * (at(1, left) + at(1, right));
    let along = 2 * (at(0, x) + at(2, x));
    let cross = (across + along) / 2;
    let corners = at(0, left) + at(0, right) + at(2, left) + at(2, right);
    match odd {
        [false, false] => [own, cross, corners],
        [true, false] => [across, own, along],
        [false, true] => [along, own, across],
        [true, true] => [corners, cross, own],
    }
}
