//! The tracker's errors on rendered frames with known truth, as a table:
//! `cargo run --release --example track_table`.

#![allow(clippy::print_stdout)]

#[allow(dead_code)]
#[path = "../crates/evrig-reconstruct/src/roi/render.rs"]
mod render;

use evrig::frame::{Frame, FrameTiming, Samples};
use evrig::geometry::{Homography, Size};
use evrig::rig::Rig;
use evrig::roi::{SampleFormat, TrackOptions, Tracker};
use evrig::time::{Davis, Stamp};
use render::{TagCells, Taking, TestRandom, random_corners, to_8_bits};
use std::error::Error;
use std::time::{Duration, Instant};

const UNIT: [[f64; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

/// Corner errors of one method.
#[derive(Default)]
struct CornerErrors {
    n_found: u32,
    square_px2: f64,
    bias_px: [f64; 2],
}

impl CornerErrors {
    fn take(&mut self, found: &[[f64; 2]; 4], truth: &[[f64; 2]; 4]) {
        self.n_found += 1;
        for (a, b) in found.iter().zip(truth) {
            for axis in 0..2 {
                self.square_px2 += (a[axis] - b[axis]).powi(2) / 4.0;
                self.bias_px[axis] += (a[axis] - b[axis]) / 4.0;
            }
        }
    }

    fn print(&self, name: &str, n: u32) {
        let found = f64::from(self.n_found.max(1));
        let [x, y] = self.bias_px.map(|sum| sum / found);
        println!(
            "  {name:22} found {:5.1} %  corner rms {:.3} px  mean {x:+.3} {y:+.3}",
            100.0 * f64::from(self.n_found) / f64::from(n),
            (self.square_px2 / found).sqrt(),
        );
    }
}

/// The AprilTag library alone.
fn detect_by_library(
    bytes: &[u8],
    decimation: f32,
) -> Result<Option<[[f64; 2]; 4]>, Box<dyn Error>> {
    let family = apriltag::families::Tag36h11::default();
    let mut detector = apriltag::Detector::builder().add_family_bits(family, 1).build()?;
    detector.set_decimation(decimation);
    let mut image = apriltag::Image::zeros_with_alignment(346, 260, 96)?;
    let stride = image.stride();
    for (to, from) in image.as_slice_mut().chunks_mut(stride).zip(bytes.chunks(346)) {
        to[..346].copy_from_slice(from);
    }
    let found = detector.detect(&image);
    Ok(found.iter().find(|tag| tag.id() == 0).map(apriltag::Detection::corners))
}

fn frame(t_us: i64, bytes: Vec<u8>) -> Frame<Davis> {
    Frame::gray(
        FrameTiming::from_stamp(Stamp::from_micros(t_us)),
        Size::DAVIS346,
        Samples::U8(bytes),
    )
}

fn main() -> Result<(), Box<dyn Error>> {
    let rig = Rig::simulated()?;
    let options = TrackOptions::new(SampleFormat::Brightness);
    let n = 300;
    for (blur, noise) in [(1.0, 6.0), (1.5, 10.0)] {
        println!("346 x 260, tag 28..30 px, blur {blur} px, noise {noise} of 255, {n} frames");
        let (mut dice, taking) = (TestRandom(1), Taking::davis346(blur));
        let [mut ours, mut whole, mut half] =
            [CornerErrors::default(), CornerErrors::default(), CornerErrors::default()];
        let (mut whole_frame, mut window) = (Duration::ZERO, Duration::ZERO);
        let mut n_timed = 0_u32;
        for _ in 0..n {
            let corners = random_corners(dice.between(28.0, 30.0), &taking, &mut dice);
            let map = Homography::fit(&[0, 1, 2, 3].map(|i| (corners[i], UNIT[i])))?;
            let image = taking.render(&TagCells::tag36h11(0), &corners, |p| map.apply(p));
            let bytes = to_8_bits(&image, noise, &mut dice);
            if let Some(found) = detect_by_library(&bytes, 1.0)? {
                whole.take(&found, &corners);
            }
            if let Some(found) = detect_by_library(&bytes, 2.0)? {
                half.take(&found, &corners);
            }
            let mut tracker = Tracker::new(&rig.target, &rig.davis.camera, options)?;
            let first = Instant::now();
            let detection = tracker.see(&frame(0, bytes.clone()));
            let first = first.elapsed();
            let Ok(detection) = detection else { continue };
            ours.take(&detection.corners_px, &corners);
            // The same image again is found in the predicted window.
            let again = frame(20_000, bytes);
            let second = Instant::now();
            if tracker.see(&again).is_ok() {
                whole_frame += first;
                window += second.elapsed();
                n_timed += 1;
            }
        }
        ours.print("tracker", n);
        whole.print("library, full size", n);
        half.print("library, half size", n);
        let ms = |total: Duration| total.as_secs_f64() * 1e3 / f64::from(n_timed.max(1));
        println!("  whole frame {:.2} ms, window {:.2} ms", ms(whole_frame), ms(window));
    }
    Ok(())
}
