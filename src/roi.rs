//! The tag found, its corners, the track over time, and the picture's region.

mod corners;
mod detect;
mod grey;
mod lens;
mod target;

#[cfg(test)]
mod render;

pub use grey::Light;
pub use lens::Lens;
pub use target::TargetPlane;

#[cfg(test)]
mod tests {
    use super::corners::refine;
    use super::detect::TagDetector;
    use super::grey::Grey;
    use super::render::*;
    use crate::geometry::Homography;

    const UNIT: [[f64; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

    #[test]
    fn table() {
        for (blur, noise) in [(1.0, 6.0), (1.5, 10.0)] {
            let mut dice = Dice(7);
            let mut detector = TagDetector::new("tag36h11", 0).unwrap();
            let taking = Taking::davis346(blur);
            let (mut n, mut bare, mut fine, mut found, mut refined) = (0, 0.0, 0.0, 0, 0);
            let mut chi = 0.0;
            let mut blur_sum = 0.0;
            for _ in 0..60 {
                n += 1;
                let side = dice.between(28.0, 30.0);
                let corners = random_corners(side, &taking, &mut dice);
                let pairs = [0, 1, 2, 3].map(|i| (corners[i], UNIT[i]));
                let h = Homography::fit(&pairs).unwrap();
                let frame = taking.render(&Cells::tag36h11(0), &corners, |p| h.apply(p));
                let bytes = to_8_bits(&frame, noise, &mut dice);
                let grey = Grey { width: 346, height: 260, values: bytes.iter().map(|&b| f32::from(b)).collect(), scale: 1 };
                let look = detector.look(&grey, grey.whole(), 1.0);
                let Some(guess) = look.corners else { continue };
                found += 1;
                let e = |a: [[f64; 2]; 4]| (0..4).map(|i| (a[i][0] - corners[i][0]).powi(2) + (a[i][1] - corners[i][1]).powi(2)).sum::<f64>();
                bare += e(guess);
                let Some(c) = refine(&grey, guess) else { println!("not refined {guess:?} {corners:?}"); continue };
                refined += 1;
                blur_sum += c.blur_px;
                fine += e(c.points);
                let d = nalgebra::SVector::<f64, 8>::from_fn(|i, _| c.points[i / 2][i % 2] - corners[i / 2][i % 2]);
                chi += d.dot(&(c.covariance.try_inverse().unwrap() * d));
            }
            println!("{blur} {noise}: {n} {found} {refined} bare {} fine {} chi {} blur {}", (bare / 4.0 / found as f64).sqrt(), (fine / 4.0 / refined as f64).sqrt(), chi / refined as f64, blur_sum / refined as f64);
        }
    }
}
