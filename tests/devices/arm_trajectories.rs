//! The arm follows the plan: every bundled trajectory on the simulated arm.
//!
//! The planner and the simulated arm share no geometry, kinematics or speed profile.

use evrig::device::dobot::{ArmClient, ArmTimeouts, Magician, port};
use evrig::record::Arm;
use evrig::rig::{Pose, Rig};
use evrig::sim::arm::{ArmClock, ArmEmulator, ArmOptions};
use evrig::time::Span;
use evrig::trajectory::{OptionalSegments, Plan, ToolPath, Trajectory};

fn emulator() -> ArmEmulator {
    let options = ArmOptions { is_homed: true, ..ArmOptions::default() };
    ArmEmulator::start(options, ArmClock::Stepped(Span::from_micros(5_000)), Vec::new()).unwrap()
}

/// Distance from a pose to the nearest point of the steps around `step`, mm.
fn off_path(path: &ToolPath, step: usize, pose: Pose) -> f64 {
    let around = &path.steps()[step.saturating_sub(1)..path.steps().len().min(step + 2)];
    let points = around
        .iter()
        .flat_map(|step| (0..=1_000).map(|n| step.curve.pose_at(f64::from(n) / 1_000.0)));
    points.map(|point| point.distance(pose).0).fold(f64::INFINITY, f64::min)
}

#[test]
fn every_bundled_trajectory_is_driven_as_planned() {
    let rig = Rig::simulated().unwrap();
    for name in Trajectory::bundled_names() {
        let trajectory = Trajectory::find(name).unwrap();
        let plan = Plan::new(&trajectory, &rig, OptionalSegments::LeftOut).unwrap();
        let path = plan.feasible_path().unwrap();
        let emulator = emulator();
        let link = port::open(emulator.port()).unwrap();
        let patience = ArmTimeouts { between_polls: Span::ZERO, ..ArmTimeouts::default() };
        let client = ArmClient::new(Box::new(link), patience);
        let mut arm = Magician::over(client, rig.arm.clone());
        let remarks = arm.prepare(path).unwrap();
        assert!(remarks.is_empty(), "{name}: {remarks:?}");
        arm.start(0..path.steps().len()).unwrap();
        let (mut worst, mut n_poses) = (0.0_f64, 0_u32);
        let n_dry = loop {
            let progress = arm.progress().unwrap_or_else(|error| panic!("{name}: {error}"));
            // Every tenth pose is enough.
            if n_poses % 10 == 0 {
                worst = worst.max(off_path(path, progress.step, progress.pose.pose));
            }
            n_poses += 1;
            if progress.is_done {
                break progress.n_dry;
            }
        };
        arm.finish().unwrap();
        let end = emulator.state().planner.distance(path.end()).0;
        let driven_s = driven_time(&emulator).as_secs_f64();
        println!(
            "{name}: {n_poses} poses, at most {worst:.3} mm off the path, {driven_s:.3} s of {:.3} s",
            plan.duration_s
        );
        assert_eq!(n_dry, 0, "{name}: the arm waited for points");
        assert!(worst < 0.2 && end < 0.01, "{name}: {worst} mm off, ends {end} mm off");
        assert!((driven_s / plan.duration_s - 1.0).abs() < 0.02, "{name}: {driven_s} s");
    }
}

/// Time of the arm's clock from the start of the queue to its last command.
fn driven_time(emulator: &ArmEmulator) -> Span {
    let journal = emulator.journal();
    let start = journal.iter().rposition(|line| line.name == "QUEUE_START").unwrap();
    let end = journal.iter().rposition(|line| line.was_busy).unwrap();
    Span::from_nanos(journal[end].arm_ns - journal[start].arm_ns)
}
