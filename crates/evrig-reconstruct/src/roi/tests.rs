//! The tracker on rendered frames with known truth.

use super::render::{TagCells, Taking, TestRandom, random_corners, to_8_bits};
use super::*;
use evrig_core::frame::{Frame, FrameTiming, Samples};
use evrig_core::geometry::{Homography, Size};
use evrig_core::time::{Davis, PiSensor, Span, Stamp};
use evrig_session::rig::{CameraDescription, Rig, TargetDescription};
use nalgebra::{Matrix3, Rotation3, Vector3};

const UNIT: [[f64; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

fn rig() -> Rig {
    Rig::simulated().unwrap()
}

fn options() -> TrackOptions {
    TrackOptions::new(SampleFormat::Brightness)
}

fn gray(t_us: i64, bytes: Vec<u8>) -> Frame<Davis> {
    Frame::gray(
        FrameTiming::from_stamp(Stamp::from_micros(t_us)),
        Size::DAVIS346,
        Samples::U8(bytes),
    )
}

fn tracker(rig: &Rig) -> Tracker<Davis> {
    Tracker::new(&rig.target, &rig.davis.camera, options()).unwrap()
}

/// A camera that circles over the target while its wrist turns; a mild, constant tilt.
struct Flight {
    camera: CameraDescription,
    target: TargetDescription,
    row_time: Span,
}

impl Flight {
    fn new(rig: &Rig) -> Self {
        let (mut camera, target) = (rig.davis.camera.clone(), rig.target.clone());
        camera.row_time = Span::from_micros(40);
        Self { row_time: camera.row_time, camera, target }
    }

    /// From millimetres on the print to ideal pixels.
    fn homography(&self, t_s: f64) -> Homography {
        let lens = Lens::of(&self.camera);
        let tag = TargetPlane::of(&self.target).tag_centre_mm();
        let phase = 4.0 * t_s;
        let wrist = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.5 * (3.0 * t_s).sin());
        let tilt = Rotation3::from_euler_angles(0.06, -0.04, 0.0);
        let turned = (tilt * wrist).into_inner();
        let distance = self.target.stand_off.0 * 0.85;
        let eye = Vector3::new(tag[0] + 8.0 * phase.cos(), tag[1] + 8.0 * phase.sin(), -distance);
        let shift = -(turned * eye);
        let view =
            Matrix3::from_columns(&[turned.column(0).into(), turned.column(1).into(), shift]);
        let [cx, cy] = lens.centre_px;
        let f = lens.focal_px;
        Homography::from_matrix(Matrix3::new(f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0) * view)
    }

    /// A frame whose row 0 sees light at `t_s`, row after row.
    fn frame(&self, cells: &TagCells, t_s: f64, noise: f64, dice: &mut TestRandom) -> Frame<Davis> {
        let taking = Taking::davis346(1.0);
        let lens = Lens::of(&self.camera);
        let plane = TargetPlane::of(&self.target);
        let here = self.homography(t_s);
        let corners = plane.tag_corners_mm().map(|corner| lens.distort(here.apply(corner)));
        let row_s = self.row_time.as_secs_f64();
        let maps: Vec<_> = (-40..320)
            .map(|row| self.homography(t_s + f64::from(row) * row_s).inverse().unwrap())
            .collect();
        let top_left = plane.tag_corners_mm()[3];
        let tag_from_pixel = |pixel: [f64; 2]| {
            let row = (pixel[1].floor() as i64 + 40).clamp(0, 359) as usize;
            let ideal = lens.undistort(pixel).unwrap_or(pixel);
            let [x, y] = maps[row].apply(ideal);
            [(x - top_left[0]) / plane.tag_side_mm, (y - top_left[1]) / plane.tag_side_mm]
        };
        let image = taking.render(cells, &corners, tag_from_pixel);
        let mut frame = gray((t_s * 1e6).round() as i64, to_8_bits(&image, noise, dice));
        frame.timing.row_time = self.row_time;
        frame
    }
}

fn seconds(t_s: f64) -> Stamp<Davis> {
    Stamp::from_nanos((t_s * 1e9).round() as i64)
}

#[test]
fn the_tag_is_found_and_its_corners_are_within_a_tenth_of_a_pixel() {
    let (rig, mut dice, taking) = (rig(), TestRandom(7), Taking::davis346(1.0));
    let (mut n_found, mut square, mut chi_square) = (0, 0.0, 0.0);
    let n = 40;
    for _ in 0..n {
        let corners = random_corners(dice.between(28.0, 30.0), &taking, &mut dice);
        let map = Homography::fit(&[0, 1, 2, 3].map(|i| (corners[i], UNIT[i]))).unwrap();
        let frame = taking.render(&TagCells::tag36h11(0), &corners, |p| map.apply(p));
        let frame = gray(0, to_8_bits(&frame, 6.0, &mut dice));
        let mut tracker = tracker(&rig);
        let Ok(detection) = tracker.see(&frame) else { continue };
        n_found += 1;
        let error = nalgebra::SVector::<f64, 8>::from_fn(|i, _| {
            detection.corners_px[i / 2][i % 2] - corners[i / 2][i % 2]
        });
        let stated = nalgebra::SMatrix::<f64, 8, 8>::from_fn(|i, j| detection.covariance_px2[i][j]);
        square += error.norm_squared() / 4.0;
        chi_square += error.dot(&(stated.try_inverse().unwrap() * error)) / 8.0;
    }
    assert_eq!(n_found, n);
    let rms = (square / f64::from(n_found)).sqrt();
    assert!(rms < 0.1, "corner error {rms} px");
    let ratio = chi_square / f64::from(n_found);
    assert!((0.5..2.0).contains(&ratio), "stated variance is off by {ratio}");
}

#[test]
fn a_camera_that_circles_and_turns_is_followed_through_lens_and_rolling_shutter() {
    let mut rig = rig();
    rig.davis.camera.distortion = [-0.12, 0.05, 0.001, -0.001, 0.0];
    let flight = Flight::new(&rig);
    let (mut dice, mut tracker) = (TestRandom(3), tracker(&rig));
    let n = 40;
    for i in 0..n {
        let frame = flight.frame(&TagCells::tag36h11(0), 0.02 * f64::from(i), 6.0, &mut dice);
        tracker.see(&frame).unwrap();
    }
    let track = tracker.finish().unwrap();
    assert_eq!((track.tally.seen, track.tally.used), (40, 40));
    // Searching where the tag was takes a fraction of the frame.
    let searched = track.tally.searched;
    assert_eq!((searched.whole_frames, searched.windows), (1, 39));
    assert!(searched.window_pixels < 39 * 346 * 260 / 4);
    // The path is the truth at any time, not only where a frame was.
    let (mut tag, mut image, mut covered, mut asked) = (0.0_f64, 0.0_f64, 0, 0);
    let plane = track.plane;
    for i in 0..300 {
        let t_s = 0.03 + 0.0024 * f64::from(i);
        let (view, truth) = (track.at(seconds(t_s)).unwrap(), flight.homography(t_s));
        let miss = |place: [f64; 2]| {
            let (seen, stated) = view.ideal_pixel(place);
            let real = truth.apply(place);
            let miss = nalgebra::Vector2::new(seen[0] - real[0], seen[1] - real[1]);
            (miss.norm_squared(), miss.dot(&(stated.try_inverse().unwrap() * miss)))
        };
        tag += miss(plane.tag_centre_mm()).0 / 300.0;
        let (square, chi_square) = miss(plane.picture_centre_mm());
        image += square / 300.0;
        asked += 1;
        // 90 % of the law of chi-square with two degrees of freedom lie below 4.605.
        covered += i32::from(chi_square < 4.605);
    }
    assert!(tag.sqrt() < 0.05, "tag's middle {} px", tag.sqrt());
    assert!(image.sqrt() < 0.3, "image's middle {} px", image.sqrt());
    assert!(covered * 10 >= asked * 5, "{covered} of {asked} within the 90 % region");
    // The region is where the lens shows the image.
    let view = track.at(seconds(0.4)).unwrap();
    let (roi, truth) = (view.roi(), flight.homography(0.4));
    let lens = Lens::of(&rig.davis.camera);
    for (seen, place) in roi.polygon.into_iter().zip(plane.picture_corners_mm()) {
        let real = lens.distort(truth.apply(place));
        assert!((seen[0] - real[0]).hypot(seen[1] - real[1]) < 1.0, "{seen:?} {real:?}");
    }
    let turn = (0.5 * 1.2_f64.sin()).to_degrees();
    assert!((roi.angle.0 - turn).abs() < 3.0, "{} {turn}", roi.angle);
    assert!(roi.angle_error.0 < 0.3 && roi.angle_error.0 > 0.0);
    let back = view.place_mm(view.pixel([3.0, -4.0])).unwrap();
    assert!((back[0] - 3.0).hypot(back[1] + 4.0) < 1e-3);
    // Stored tracks are read back, also those with the former key of the detections.
    let json = serde_json::to_string(&track).unwrap();
    let former = json.replace("\"detections\":", "\"sightings\":");
    let again: Track<Davis> = serde_json::from_str(&json).unwrap();
    assert_eq!(serde_json::from_str::<Track<Davis>>(&former).unwrap(), again);
    assert_eq!((&again.tally, again.knots.len()), (&track.tally, 40));
    let [one, other] = [&track, &again].map(|t| t.at(seconds(0.391)).unwrap().roi().polygon[3]);
    assert!((one[0] - other[0]).hypot(one[1] - other[1]) < 1e-9);
}

#[test]
fn a_second_without_the_tag_is_a_gap_and_a_short_loss_is_bridged() {
    let rig = rig();
    let flight = Flight::new(&rig);
    let (mut dice, mut tracker) = (TestRandom(5), tracker(&rig));
    let empty = vec![210; 346 * 260];
    for i in 0..76 {
        let t_s = 0.02 * f64::from(i);
        let is_hidden = (5..7).contains(&i) || (14..64).contains(&i);
        let frame = if is_hidden {
            let mut frame = gray((t_s * 1e6).round() as i64, empty.clone());
            // Something to see, but no tag.
            if let Samples::U8(bytes) = &mut frame.samples {
                bytes[..20_000].fill(60);
            }
            frame
        } else {
            flight.frame(&TagCells::tag36h11(0), t_s, 3.0, &mut dice)
        };
        assert_eq!(tracker.see(&frame).is_err(), is_hidden, "frame {i}");
    }
    let track = tracker.finish().unwrap();
    assert!(track.tally.balances());
    assert_eq!(track.tally.lost, [(LossReason::NotFound, 52)].into());
    assert_eq!(track.losses.len(), 52);
    assert_eq!(track.gaps.len(), 1);
    assert!(track.at(seconds(0.115)).is_ok(), "40 ms are bridged");
    let refused = track.at(seconds(0.8)).unwrap_err();
    assert!(matches!(refused, TrackTimeError::TrackGap { .. }));
    assert!(refused.to_string().contains("150.000 ms"), "{refused}");
    assert!(matches!(track.at(seconds(9.0)), Err(TrackTimeError::Outside { .. })));
    let before = track.at(seconds(0.25)).unwrap().ideal_pixel(track.plane.tag_centre_mm()).1;
    assert!(before.trace().sqrt() < 0.2);
}

#[test]
fn sightings_off_the_path_are_named_and_left_out() {
    let rig = rig();
    let flight = Flight::new(&rig);
    let (mut dice, mut tracker) = (TestRandom(11), tracker(&rig));
    for i in 0..24 {
        // Frame 12 is a stale one: it shows the scene of 60 ms before under a new stamp.
        let shown = if i == 12 { 9 } else { i };
        let cells = TagCells::tag36h11(0);
        let mut frame = flight.frame(&cells, 0.02 * f64::from(shown), 3.0, &mut dice);
        frame.timing.stamp = Stamp::from_micros(20_000 * i64::from(i));
        let _ = tracker.see(&frame);
        if i == 20 {
            assert_eq!(tracker.see(&frame).unwrap_err(), LossReason::OutOfOrder, "a duplicate");
        }
    }
    let track = tracker.finish().unwrap();
    let named: Vec<_> = track.losses.iter().map(|loss| (loss.frame, loss.reason)).collect();
    assert_eq!(named, [(12, LossReason::Outlier), (21, LossReason::OutOfOrder)]);
    assert_eq!((track.tally.seen, track.tally.used), (25, 23));
    assert!(track.tally.balances());
    let truth = flight.homography(0.24).apply(track.plane.tag_centre_mm());
    let view = track.at(seconds(0.24)).unwrap();
    let seen = view.ideal_pixel(track.plane.tag_centre_mm()).0;
    assert!((seen[0] - truth[0]).hypot(seen[1] - truth[1]) < 0.1);
}

/// Five frames with one and the same image.
fn show(rig: &Rig, bytes: &[u8]) -> (Vec<Option<LossReason>>, Result<Track<Davis>, TrackError>) {
    let mut tracker = tracker(rig);
    let fates = (0..5).map(|i| tracker.see(&gray(20_000 * i, bytes.to_vec())).err()).collect();
    (fates, tracker.finish())
}

fn still(cells: &TagCells, centre: [f64; 2]) -> Vec<u8> {
    let side = 29.0;
    let [left, top] = centre.map(|part| part - side / 2.0);
    let corners = UNIT.map(|[x, y]| [left + side * x, top + side * y]);
    let map = |[x, y]: [f64; 2]| [(x - left) / side, (y - top) / side];
    let frame = Taking::davis346(1.0).render(cells, &corners, map);
    to_8_bits(&frame, 3.0, &mut TestRandom(1))
}

#[test]
fn a_rig_that_names_the_wrong_tag_is_reported_with_the_one_found() {
    let (fates, result) = show(&rig(), &still(&TagCells::tag36h11(1), [170.3, 120.8]));
    assert_eq!(fates, [Some(LossReason::OtherId); 5]);
    let message = result.unwrap_err().to_string();
    assert!(message.contains("tag36h11 id 0 cannot be tracked in 5 frames"), "{message}");
    assert!(message.contains("detected instead: tag36h11 id 1 in 5"), "{message}");
    let (fates, result) = show(&rig(), &still(&TagCells::tag25h9(), [170.3, 120.8]));
    assert_eq!(fates, [Some(LossReason::NotFound); 5]);
    let message = result.unwrap_err().to_string();
    assert!(message.contains("detected instead: tag25h9 id 0 in 5"), "{message}");
    let mut unknown = rig();
    unknown.target.tag_family = "tag99h9".into();
    let error = Tracker::<Davis>::new(&unknown.target, &unknown.davis.camera, options());
    assert!(matches!(error.err(), Some(TrackError::UnknownFamily(_))));
}

#[test]
fn frames_that_show_nothing_are_counted_by_what_is_wrong_with_them() {
    let (fates, result) = show(&rig(), &vec![90; 346 * 260]);
    assert_eq!(fates, [Some(LossReason::NoContrast); 5]);
    assert!(result.unwrap_err().to_string().contains("5 no contrast"));
    let (fates, _) = show(&rig(), &still(&TagCells::tag36h11(0), [20.0, 120.0]));
    assert_eq!(fates, [Some(LossReason::AtBorder); 5], "its quiet zone is cut off");
    let (fates, _) = show(&rig(), &[0; 100]);
    assert_eq!(fates, [Some(LossReason::Unreadable); 5]);
    let empty = tracker(&rig()).finish();
    assert_eq!(empty, Err(TrackError::NoFrames));
}

#[test]
fn a_mirrored_image_and_a_repeated_tag_are_named_with_what_to_do() {
    let plain = still(&TagCells::tag36h11(0), [90.3, 120.8]);
    let mirrored: Vec<u8> = plain.chunks(346).flat_map(|row| row.iter().rev().copied()).collect();
    let (fates, result) = show(&rig(), &mirrored);
    assert_eq!(fates, [Some(LossReason::Mirrored); 5]);
    let message = result.unwrap_err().to_string();
    assert!(message.contains("mirrored: flip them"), "{message}");
    // The other half of the image shows the tag once more.
    let other = still(&TagCells::tag36h11(0), [255.3, 120.8]);
    let rows = plain.chunks(346).zip(other.chunks(346));
    let twice: Vec<u8> =
        rows.flat_map(|(left, right)| [&left[..173], &right[173..]].concat()).collect();
    let (fates, result) = show(&rig(), &twice);
    assert_eq!(fates, [Some(LossReason::Repeated); 5]);
    assert!(result.unwrap_err().to_string().contains("with another id"));
}

#[test]
fn a_raw_mosaic_gives_its_corners_at_full_resolution() {
    let rig = rig();
    let mut dice = TestRandom(21);
    let options = TrackOptions::new(SampleFormat::Mosaic { black_level_dn: 64.0 });
    let mut square = 0.0;
    let n = 6;
    for _ in 0..n {
        let levels = [40.0, 700.0];
        let taking = Taking { width: 692, height: 520, blur_px: 1.6, levels };
        let corners = random_corners(dice.between(50.0, 58.0), &taking, &mut dice);
        let map = Homography::fit(&[0, 1, 2, 3].map(|i| (corners[i], UNIT[i]))).unwrap();
        let image = taking.render(&TagCells::tag36h11(0), &corners, |p| map.apply(p));
        let gains = [[0.55, 1.0], [1.0, 0.7]];
        let sample = |(i, value): (usize, &f64)| {
            let gain = gains[i / 692 % 2][i % 2];
            (64.0 + gain * value + 4.0 * dice.normal()).round().clamp(0.0, 1023.0) as u16
        };
        let samples = image.iter().enumerate().map(sample).collect();
        let frame = Frame::<PiSensor>::gray(
            FrameTiming::from_stamp(Stamp::from_nanos(0)),
            Size::new(692, 520),
            Samples::U16(samples),
        );
        let mut tracker = Tracker::new(&rig.target, &rig.pi.camera, options).unwrap();
        let detection = tracker.see(&frame).unwrap();
        for (seen, real) in detection.corners_px.iter().zip(corners) {
            square += (seen[0] - real[0]).powi(2) + (seen[1] - real[1]).powi(2);
        }
    }
    let rms = (square / f64::from(4 * n)).sqrt();
    assert!(rms < 0.1, "corner error {rms} px");
}
