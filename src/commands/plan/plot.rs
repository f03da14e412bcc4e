//! A plan as an SVG file: the path as the DAVIS sees it, speed over time, joint angles over time.

use evrig_core::time::Span;
use evrig_report::plot::Ink;
use evrig_report::plot::chart::{Chart, ChartAxis, Layer, Stroke};
use evrig_report::plot::sheet::{Sheet, chart_area};
use evrig_report::plot::svg::Area;
use evrig_session::rig::{Mounting, Rig};
use evrig_session::trajectory::Plan;

const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 760.0;
const PATH_AREA: Area = Area { x: 14.0, y: 44.0, w: 420.0, h: 702.0 };
const SPEED_AREA: Area = Area { x: 450.0, y: 44.0, w: 540.0, h: 330.0 };
const JOINT_AREA: Area = Area { x: 450.0, y: 390.0, w: 540.0, h: 356.0 };
/// Points through which the path is drawn.
const PATH_POINTS: usize = 4000;
const JOINTS: [&str; 4] = ["J1", "J2", "J3", "J4"];

/// The plan as SVG text.
pub(super) fn svg(plan: &Plan, rig: &Rig) -> String {
    let mut sheet = Sheet::new(WIDTH, HEIGHT);
    let title = format!("{} on rig {}: {:.2} s", plan.trajectory, plan.rig, plan.duration_s);
    sheet.title([14.0, 26.0], &title);

    let cameras = [
        (Ink::Series(0), Stroke::Solid, "DAVIS", camera_path(plan, rig, &rig.mount.davis)),
        (Ink::Series(1), Stroke::Thin, "Pi", camera_path(plan, rig, &rig.mount.pi)),
    ];
    let legend = cameras.each_ref().map(|&(ink, stroke, name, _)| (ink, stroke, name));
    let layers = cameras.into_iter().flat_map(|(ink, stroke, _, points)| {
        let start = points.iter().take(1).copied().collect();
        [Layer::Line { ink, stroke, points }, Layer::Points { ink, points: start }]
    });
    let path = Chart {
        x: ChartAxis::linear("right, mm"),
        y: ChartAxis::linear("up, mm"),
        layers: layers.collect(),
    };
    let path = path.with_equal_scales(chart_area(PATH_AREA));
    sheet.chart(PATH_AREA, "cameras' path as the DAVIS sees it", &legend, &path);

    let points = plan.profile.iter().map(|point| [point.time_s, point.speed_mm_per_s]);
    let speed = over_time("mm/s", vec![points.collect()]);
    sheet.chart(SPEED_AREA, "speed of the tool", &[], &speed);

    let joint = |i: usize| {
        let points = plan.profile.iter();
        points.filter_map(|point| Some([point.time_s, point.joints?.to_deg()[i]])).collect()
    };
    let angles = over_time("deg", (0..JOINTS.len()).map(joint).collect());
    let legend: Vec<_> =
        (0..).zip(JOINTS).map(|(i, name)| (Ink::Series(i), Stroke::Solid, name)).collect();
    sheet.chart(JOINT_AREA, "joint angles", &legend, &angles);
    sheet.finish()
}

fn over_time(unit: &str, lines: Vec<Vec<[f64; 2]>>) -> Chart {
    let layers = (0..).zip(lines).map(|(i, points)| Layer::Line {
        ink: Ink::Series(i),
        stroke: Stroke::Solid,
        points,
    });
    Chart { x: ChartAxis::linear("time, s"), y: ChartAxis::linear(unit), layers: layers.collect() }
}

/// Path of a camera's optical centre in the image plane of the DAVIS at the start: right, up, mm.
fn camera_path(plan: &Plan, rig: &Rig, mounting: &Mounting) -> Vec<[f64; 2]> {
    let davis = rig.mount.davis.frame(plan.path.start());
    let begin = mounting.frame(plan.path.start()).centre_mm;
    (0..=PATH_POINTS)
        .map(|i| {
            let time = Span::from_secs_f64(plan.duration_s * i as f64 / PATH_POINTS as f64);
            let moved = mounting.frame(plan.path.pose_at(time)).centre_mm - begin;
            [moved.dot(&davis.right), -moved.dot(&davis.down)]
        })
        .collect()
}
