//! A plan as a plot: the path as the DAVIS sees it, speed over time, joint angles over time.

use anyhow::anyhow;
use evrig_core::time::Span;
use evrig_session::rig::{Mounting, Rig};
use evrig_session::trajectory::{Plan, ProfilePoint};
use nalgebra::Vector3;
use plotters::coord::Shift;
use plotters::prelude::*;

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Points = Vec<(f64, f64)>;

const SIZE: (u32, u32) = (1000, 760);
/// Okabe and Ito's palette, distinguishable with colour vision deficiency.
const COLOURS: [RGBColor; 4] =
    [RGBColor(0, 114, 178), RGBColor(213, 94, 0), RGBColor(0, 158, 115), RGBColor(204, 121, 167)];
/// Points along the drawn path.
const PATH_POINTS: usize = 4000;

/// The plan as SVG text.
pub(super) fn svg(plan: &Plan, rig: &Rig) -> anyhow::Result<String> {
    let mut text = String::new();
    {
        let canvas = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        draw(&canvas, plan, rig).map_err(|error| anyhow!("{error}"))?;
        canvas.present().map_err(|error| anyhow!("{error}"))?;
    }
    Ok(text)
}

fn draw(canvas: &Canvas<'_>, plan: &Plan, rig: &Rig) -> Result<(), Box<dyn std::error::Error>> {
    canvas.fill(&WHITE)?;
    let title = format!("{} on rig {}: {:.2} s", plan.trajectory, plan.rig, plan.duration_s);
    let canvas = canvas.titled(&title, ("sans-serif", 22))?;
    let (left, right) = canvas.split_horizontally(420);
    let (above, below) = right.split_vertically(340);
    draw_path(&left, plan, rig)?;
    let speed = over_time(plan, |point| Some(point.speed_mm_per_s));
    draw_lines(&above, "speed of the tool", "mm/s", &[("speed", speed)])?;
    let joint =
        |i: usize| over_time(plan, move |point| point.joints.map(|joints| joints.to_deg()[i]));
    let joints = [("J1", joint(0)), ("J2", joint(1)), ("J3", joint(2)), ("J4", joint(3))];
    draw_lines(&below, "joint angles", "deg", &joints)
}

fn over_time(plan: &Plan, value: impl Fn(&ProfilePoint) -> Option<f64>) -> Points {
    plan.profile.iter().filter_map(|point| Some((point.time_s, value(point)?))).collect()
}

/// Path of each camera's optical centre in the axes of the DAVIS's first image: right, up, in millimetres.
fn camera_path(plan: &Plan, rig: &Rig, mounting: &Mounting) -> Points {
    let davis = rig.mount.davis.frame(plan.path.start());
    let begin = mounting.frame(plan.path.start()).centre_mm;
    (0..=PATH_POINTS)
        .map(|i| {
            let time = Span::from_secs_f64(plan.duration_s * i as f64 / PATH_POINTS as f64);
            let moved: Vector3<f64> = mounting.frame(plan.path.pose_at(time)).centre_mm - begin;
            (moved.dot(&davis.right), -moved.dot(&davis.down))
        })
        .collect()
}

fn draw_path(area: &Canvas<'_>, plan: &Plan, rig: &Rig) -> Result<(), Box<dyn std::error::Error>> {
    let cameras = [
        ("DAVIS", camera_path(plan, rig, &rig.mount.davis)),
        ("Pi", camera_path(plan, rig, &rig.mount.pi)),
    ];
    let all = || cameras.iter().flat_map(|(_, points)| points.iter().copied());
    // One scale for both axes, so that a circle looks like one.
    let (width, height) = area.dim_in_pixel();
    let (width, height) = (width.saturating_sub(60), height.saturating_sub(70));
    let [x, y] = [range(all().map(|p| p.0)), range(all().map(|p| p.1))];
    let mm_per_px = ((x[1] - x[0]) / f64::from(width)).max((y[1] - y[0]) / f64::from(height)) * 1.3;
    let around = |[low, high]: [f64; 2], pixels: u32| {
        let half = 0.5 * mm_per_px * f64::from(pixels);
        (0.5 * (low + high) - half)..(0.5 * (low + high) + half)
    };
    let mut chart = ChartBuilder::on(area)
        .caption("cameras' path as the DAVIS sees it", ("sans-serif", 16))
        .margin(8)
        .x_label_area_size(34)
        .y_label_area_size(44)
        .build_cartesian_2d(around(x, width), around(y, height))?;
    chart
        .configure_mesh()
        .x_desc("right, mm")
        .y_desc("up, mm")
        .light_line_style(TRANSPARENT)
        .draw()?;
    for ((name, points), (colour, stroke)) in cameras.iter().zip([(COLOURS[0], 3), (COLOURS[1], 1)])
    {
        let style = colour.stroke_width(stroke);
        chart
            .draw_series(LineSeries::new(points.iter().copied(), style))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
        let start = points.first().copied().unwrap_or_default();
        chart.draw_series(std::iter::once(Circle::new(start, 4, colour.filled())))?;
    }
    let corner = SeriesLabelPosition::UpperRight;
    chart
        .configure_series_labels()
        .position(corner)
        .border_style(BLACK.mix(0.3))
        .background_style(WHITE)
        .draw()?;
    Ok(())
}

fn draw_lines(
    area: &Canvas<'_>,
    caption: &str,
    unit: &str,
    lines: &[(&'static str, Points)],
) -> Result<(), Box<dyn std::error::Error>> {
    let all = || lines.iter().flat_map(|(_, points)| points.iter().copied());
    let [t0, t1] = range(all().map(|point| point.0));
    let [low, high] = range(all().map(|point| point.1));
    let padding = 0.06 * (high - low);
    let mut chart = ChartBuilder::on(area)
        .caption(caption, ("sans-serif", 16))
        .margin(8)
        .x_label_area_size(34)
        .y_label_area_size(48)
        .build_cartesian_2d(t0..t1, (low - padding)..(high + padding))?;
    chart.configure_mesh().x_desc("s").y_desc(unit).light_line_style(TRANSPARENT).draw()?;
    for ((name, points), colour) in lines.iter().zip(COLOURS) {
        chart
            .draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2)))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    if lines.len() > 1 {
        chart
            .configure_series_labels()
            .border_style(BLACK.mix(0.3))
            .background_style(WHITE)
            .draw()?;
    }
    Ok(())
}

/// Lowest and highest value, at least a unit apart.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] =
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
    match (low, high) {
        (low, high) if low > high => [0.0, 1.0],
        (low, high) if high - low < 1e-6 => [low - 0.5, high + 0.5],
        range => range.into(),
    }
}
