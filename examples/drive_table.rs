//! The light signal's errors against the truth of the simulated world, as a table:
//! `cargo run --release --example drive_table -- [CASE ...]`.
//!
//! Cases: `short` (the five-second protocol), `tilted` (the same, the target tilted by 15 mrad that
//! the rig does not state), `circle` (the published circle, one way), `wrist` (the wrist turns),
//! `close` (a nearer target).

#![allow(clippy::print_stdout)]

use evrig::drive::{Drive, TimeGrid};
use evrig::frame::Frame;
use evrig::geometry::Homography;
use evrig::rig::{Pose, Rig};
use evrig::roi::{Lens, SampleFormat, Track, TrackOptions, Tracker};
use evrig::scene::{
    DavisInputs, PiInputs, RawLevels, Reconstruction, Registration, SceneDrive, align_davis,
    reconstruct_target,
};
use evrig::sim::world::{
    CameraName, DavisTwin, PiTwin, RunSetting, SettingSchedule, ToolMotion, World, WorldDescription,
};
use evrig::time::{Clock, ClockMap, Davis, PiSensor, Span};
use evrig::trajectory::{OptionalSegments, Trajectory};
use nalgebra::Vector3;
use std::error::Error;
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Instant;

/// A circle with a wrist that swings.
#[derive(Debug)]
struct Swinging {
    centre: [f64; 3],
    radius_mm: f64,
    period_s: f64,
    turn_deg: f64,
    heave_mm: f64,
}

impl ToolMotion for Swinging {
    fn pose_at(&self, time: Span) -> Pose {
        let phase = TAU * time.as_secs_f64() / self.period_s;
        let [x, y, z] = self.centre;
        Pose::from_mm_deg([
            x - self.radius_mm * phase.cos(),
            y + self.radius_mm * phase.sin(),
            z + self.heave_mm * (0.7 * phase).sin(),
            90.0 + self.turn_deg * (1.3 * phase).sin(),
        ])
    }
}

struct Case {
    name: String,
    rig: Rig,
    world: Arc<World>,
    seconds: f64,
}

fn case(name: &str) -> Result<Case, Box<dyn Error>> {
    let text = include_str!("../rig/sim.toml");
    let description = WorldDescription::default();
    let trajectory = if name == "circle" { "circle" } else { "protocol-short" };
    let (name, text, motion) = match name {
        "wrist" => {
            let motion = Swinging {
                centre: [252.0, 0.0, 100.0],
                radius_mm: 12.0,
                period_s: 2.5,
                turn_deg: 8.0,
                heave_mm: 3.0,
            };
            ("wrist", text.to_owned(), Some(motion))
        }
        "close" => {
            let text = text
                .replace("stand_off_mm = 225.0", "stand_off_mm = 150.0")
                .replace("[270.0, 0.0, -138.0]", "[276.0, 0.0, -63.0]");
            let motion = Swinging {
                centre: [258.0, 0.0, 100.0],
                radius_mm: 10.0,
                period_s: 3.0,
                turn_deg: 4.0,
                heave_mm: 0.0,
            };
            ("close", text, Some(motion))
        }
        "short" | "tilted" | "circle" => (name, text.to_owned(), None),
        other => return Err(format!("`{other}` is no case").into()),
    };
    let rig = Rig::parse("rig/sim.toml", &text)?;
    let axis = format!("axis = [{0}, {0}, -1.0]", 0.015 * std::f64::consts::FRAC_1_SQRT_2);
    let tilted = text.replace("axis = [0.0, 0.0, -1.0]", &axis);
    let true_rig = if name == "tilted" { Rig::parse("tilted rig", &tilted)? } else { rig.clone() };
    let (world, seconds) = match motion {
        Some(motion) => {
            let schedule = SettingSchedule::new(vec![RunSetting::nominal(Span::ZERO, true)]);
            (World::new(&rig, Arc::new(motion), schedule, &description, 1)?, 5.0)
        }
        None => {
            let path = Trajectory::find(trajectory)?.path(&rig, OptionalSegments::LeftOut)?;
            (World::along(&true_rig, &path, &description, 1)?, path.duration().as_secs_f64())
        }
    };
    Ok(Case { name: name.to_owned(), rig, world: Arc::new(world), seconds })
}

/// Tracks the tag in frames.
fn tracked<C: Clock>(
    mut tracker: Tracker<C>,
    frames: &[Frame<C>],
) -> Result<Track<C>, Box<dyn Error>> {
    for frame in frames {
        // A frame without the tag is counted by the tracker.
        let _ = tracker.see(frame);
    }
    Ok(tracker.finish()?)
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0_u32), |(sum, n), value| (sum + value * value, n + 1));
    (sum / f64::from(n.max(1))).sqrt()
}

fn quantile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((part * values.len() as f64) as usize).copied().unwrap_or(f64::NAN)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let names = if arguments.is_empty() {
        ["short", "tilted", "circle", "wrist", "close"].map(str::to_owned).to_vec()
    } else {
        arguments
    };
    for name in names {
        run(&case(&name)?)?;
    }
    Ok(())
}

fn run(case: &Case) -> Result<(), Box<dyn Error>> {
    let Case { rig, world, seconds, .. } = case;
    let begun = Instant::now();
    let mut twin = PiTwin::new(Arc::clone(world), Span::from_micros(5_000));
    let shown = twin.frames_until(Span::from_secs_f64(*seconds));
    let raw: Vec<Frame<PiSensor>> = shown.into_iter().filter_map(|frame| frame.raw).collect();
    let aps = DavisTwin::new(Arc::clone(world), Span::ZERO)
        .advance_to(Span::from_secs_f64(*seconds))
        .frames;
    println!(
        "{}: {seconds:.2} s, {} Pi and {} DAVIS frames in {:.1} s",
        case.name,
        raw.len(),
        aps.len(),
        begun.elapsed().as_secs_f64()
    );

    let begun = Instant::now();
    let mosaic = SampleFormat::Mosaic { black_level_dn: rig.pi.camera.black_level_dn };
    let pi_tracker = Tracker::new(&rig.target, &rig.pi.camera, TrackOptions::new(mosaic))?;
    let pi_track = tracked(pi_tracker, &raw)?;
    let options = TrackOptions::new(SampleFormat::Brightness);
    let davis_tracker = Tracker::new(&rig.target, &rig.davis.camera, options)?;
    let davis_track = tracked(davis_tracker, &aps)?;
    println!(
        "  tags in {} and {} frames, {:.1} s",
        pi_track.knots.len(),
        davis_track.knots.len(),
        begun.elapsed().as_secs_f64()
    );

    let begun = Instant::now();
    let known = PiInputs {
        size: rig.pi.camera.size,
        lens: Lens::of(&rig.pi.camera),
        raw: RawLevels { black_dn: rig.pi.camera.black_level_dn, full_dn: 1023 },
        row_time: rig.pi.camera.row_time,
        mount: rig.mount,
        track: &pi_track,
    };
    let mut reconstruction = reconstruct_target(&known, &mut raw.as_slice())?;
    let surveyed = begun.elapsed().as_secs_f64();
    // The clocks as one would know them before: wrong by 17 ms.
    let middle = Span::from_secs_f64(seconds / 2.0);
    let pi_from_davis = ClockMap::<PiSensor, Davis>::from_anchor(
        world.clocks().pi_sensor(middle) + Span::from_micros(17_000),
        world.clocks().davis(middle),
    );
    let known = DavisInputs {
        lens: Lens::of(&rig.davis.camera),
        mount: rig.mount,
        track: &davis_track,
        pi_from_davis,
        is_measured: true,
    };
    let begun = Instant::now();
    let registration = align_davis(&mut reconstruction, &known, &aps)?;
    println!("  reconstruction {surveyed:.2} s, tie {:.2} s", begun.elapsed().as_secs_f64());
    print_case(case, &reconstruction, &registration);
    Ok(())
}

fn print_case(case: &Case, reconstruction: &Reconstruction, registration: &Registration) {
    let Case { rig, .. } = case;
    let [seen, lost] = reconstruction.n_frames;
    println!(
        "  {} cells of {:.3} mm, {} of {seen} frames lost, row {:.3} +- {:.3} us, white {:.1} DN",
        reconstruction.map.grid.n_cells(),
        reconstruction.map.grid.cell_mm,
        lost,
        reconstruction.row_s[0] * 1e6,
        reconstruction.row_s[1] * 1e6,
        reconstruction.white_dn
    );
    let drive = SceneDrive::new(rig.davis.camera.size, reconstruction, registration);

    // Where the map lies to the true print, by the Pi's own looks.
    let gauge = gauge(case, reconstruction);
    let per_mm = rig.davis.camera.pixels_per_mm(rig.target.stand_off);
    let pi_error = pi_path(case, reconstruction, &gauge).into_iter().flatten().map(|e| e * per_mm);
    println!("  path: Pi against truth {:.4} DAVIS px rms", rms(pi_error));

    tell_places(case, &drive, &gauge);
    tell_offset(case, reconstruction, registration);
    println!(
        "  sigma over the map {:.4} +- {:.4} px, left {:.2} DN, {:.4} px a frame, {} frames",
        registration.spread.sigma_px,
        registration.sigma_error_px,
        registration.residual_dn,
        registration.residual_px,
        registration.n_frames
    );
    drive_errors(case, &drive);
}

/// Places of the image in the DAVIS against the truth, over time.
fn tell_places(case: &Case, drive: &SceneDrive, gauge: &Homography) {
    let Case { rig, world, seconds, .. } = case;
    let per_mm = rig.davis.camera.pixels_per_mm(rig.target.stand_off);
    let times: Vec<f64> = (0..200).map(|i| 0.1 + (seconds - 0.2) * f64::from(i) / 200.0).collect();
    let [cx, cy] = [-4.1 - 7.175, 0.0];
    let places: Vec<[f64; 2]> = (0..25)
        .map(|i| [cx + 9.0 * f64::from(i % 5 - 2), cy + 9.0 * f64::from(i / 5 - 2)])
        .collect();
    let (mut constant, mut moving) = (Vec::new(), Vec::new());
    for place in places {
        let mut errors = Vec::new();
        for &t in &times {
            let time = Span::from_secs_f64(t);
            let Some(pixel) = world.pixel_of_place(CameraName::Davis, place, time) else {
                continue;
            };
            let t_us = world.clocks().davis(time).as_nanos() as f64 * 1e-3;
            let Some(found) = drive.place_mm(pixel, t_us) else { continue };
            let found = gauge.apply(found);
            errors.push([(found[0] - place[0]) * per_mm, (found[1] - place[1]) * per_mm]);
        }
        let n = errors.len() as f64;
        let mean = [0, 1].map(|axis| errors.iter().map(|e| e[axis]).sum::<f64>() / n);
        constant.push(mean[0].hypot(mean[1]));
        moving.extend(errors.iter().map(|e| (e[0] - mean[0]).hypot(e[1] - mean[1])));
    }
    println!(
        "  DAVIS: at the image {:.4} px rms constant, {:.4} px rms moving",
        rms(constant.into_iter()),
        rms(moving.into_iter())
    );
}

/// The time between the cameras against the truth.
fn tell_offset(case: &Case, reconstruction: &Reconstruction, registration: &Registration) {
    let Case { world, seconds, .. } = case;
    let lag = |t: f64| {
        let time = Span::from_secs_f64(t);
        let tie = &registration.alignment;
        let mapped = (tie.pi_from_davis.map(world.clocks().davis(time)) - reconstruction.path.zero)
            .as_secs_f64();
        let found = mapped + tie.lag_s + tie.skew * (mapped - tie.lag_at_s);
        (found - (world.clocks().pi_sensor(time) - reconstruction.path.zero).as_secs_f64()) * 1e6
    };
    println!(
        "  offset wrong by {:.1} .. {:.1} us (stated error {:.1}), skew {:.2} +- {:.2} ppm",
        lag(0.2),
        lag(seconds - 0.2),
        registration.alignment_error[8] * 1e6,
        registration.alignment.skew * 1e6,
        registration.alignment_error[9] * 1e6
    );
}

/// The homography from the map's millimetres to the target's, from the frames of the Pi.
fn gauge(case: &Case, reconstruction: &Reconstruction) -> Homography {
    let pairs: Vec<_> = looks(case, reconstruction).into_iter().flatten().collect();
    Homography::fit(&pairs)
        .unwrap_or_else(|_| Homography::from_matrix(nalgebra::Matrix3::identity()))
}

/// Points of the map and of the target on the same ray of the Pi, over time.
fn looks(case: &Case, reconstruction: &Reconstruction) -> Vec<Vec<([f64; 2], [f64; 2])>> {
    let world = &case.world;
    let n = reconstruction.path.knots.len();
    let boot = world.clocks().pi_sensor(Span::ZERO);
    (0..n)
        .step_by((n / 200).max(1))
        .map(|k| {
            let time_s = reconstruction.path.knots[k].time_s;
            let time = (reconstruction.path.zero + Span::from_secs_f64(time_s)) - boot;
            let truth = world.plane_from_ray(CameraName::Pi, time);
            let rays = (0..9).map(|i| [0.17 * f64::from(i % 3 - 1), 0.12 * f64::from(i / 3 - 1)]);
            rays.filter_map(|ray| {
                let q = truth * Vector3::new(ray[0], ray[1], 1.0);
                Some((reconstruction.place_mm(ray, time_s)?, [q.x / q.z, q.y / q.z]))
            })
            .collect()
        })
        .collect()
}

/// Millimetres by which the Pi's path is wrong, time after time.
fn pi_path(case: &Case, reconstruction: &Reconstruction, gauge: &Homography) -> Vec<Vec<f64>> {
    let wrong = |(map, print): ([f64; 2], [f64; 2])| {
        let found = gauge.apply(map);
        (found[0] - print[0]).hypot(found[1] - print[1])
    };
    looks(case, reconstruction)
        .into_iter()
        .map(|pairs| pairs.into_iter().map(wrong).collect())
        .collect()
}

fn drive_errors(case: &Case, drive: &SceneDrive) {
    let Case { rig, world, seconds, .. } = case;
    let size = rig.davis.camera.size;
    let threshold = world.description().davis.threshold;
    let step = Span::from_micros(5_000);
    let n = (seconds * 1e6 / 5_000.0) as usize;
    let start = world.clocks().davis(Span::ZERO).as_micros();
    let grid = TimeGrid { start_us: start, step_us: 5_000, n };
    let begun = Instant::now();
    let (mut errors, mut stated, mut known) = (Vec::new(), Vec::new(), 0);
    let mut slopes = Vec::new();
    for pixel in (0..size.n_pixels()).step_by(37) {
        let (x, y) =
            ((pixel % usize::from(size.width)) as u16, (pixel / usize::from(size.width)) as u16);
        let Some(curve) = drive.curve(x, y, grid) else { continue };
        let pairs: Vec<(f64, f64)> = curve
            .values()
            .iter()
            .enumerate()
            // The five-second protocol begins with flashes, which the map's light does not follow.
            .filter(|(i, value)| value.is_finite() && *i > 60)
            .map(|(i, value)| {
                let time = Span::from_nanos(step.as_nanos() * i as i64);
                let light = world.light_on(CameraName::Davis, [x, y], time);
                (f64::from(*value), f64::from(light).ln())
            })
            .collect();
        if pairs.len() < n / 2 {
            continue;
        }
        known += 1;
        let of = |get: &dyn Fn(&(f64, f64)) -> f64| {
            let mean = pairs.iter().map(get).sum::<f64>() / pairs.len() as f64;
            rms(pairs.iter().map(|pair| get(pair) - mean))
        };
        if of(&|pair| pair.1) > 0.1 {
            errors.push(of(&|pair| pair.0 - pair.1) / threshold);
            stated
                .push(f64::from(drive.error([f64::from(x) + 0.5, f64::from(y) + 0.5])) / threshold);
            slopes.push(of(&|pair| pair.1));
        }
    }
    let n = errors.len();
    println!(
        "  drive: {known} pixels known, {n} textured, error {:.4} (median) {:.4} (90 %) \
         thresholds, stated {:.4}; {:.1} s",
        quantile(&mut errors, 0.5),
        quantile(&mut errors, 0.9),
        quantile(&mut stated, 0.5),
        begun.elapsed().as_secs_f64()
    );
}
