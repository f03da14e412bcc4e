//! A plan as text and tables.

use evrig_report::number::counted;
use evrig_session::trajectory::{Margin, Plan, SegmentPlan, Trajectory};
use std::fmt;

/// Longest list of motions; further ones are only counted.
const MAX_ROWS: usize = 60;

pub(super) struct PlanTable<'a> {
    pub(super) plan: &'a Plan,
    pub(super) trajectory: &'a Trajectory,
}

impl fmt::Display for PlanTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plan = self.plan;
        writeln!(f, "{} on rig {}", plan.trajectory, plan.rig)?;
        if let Some(description) = &self.trajectory.description {
            writeln!(f, "  {description}")?;
        }
        writeln!(
            f,
            "  {:.3} s, {:.1} mm, {}, each from rest to rest (corners are {})",
            plan.duration_s,
            plan.length_mm,
            counted(plan.segments.len() as u64, "motion"),
            plan.corners
        )?;
        writeln!(
            f,
            "  at most {:.1} mm/s, {:.0} mm/s^2 along and {:.0} mm/s^2 across the path\n",
            plan.peak_speed_mm_per_s,
            plan.peak_acceleration_mm_per_s2,
            plan.peak_curve_acceleration_mm_per_s2
        )?;
        segments(f, &plan.segments)?;
        writeln!(
            f,
            "\n{:<26} {:>10} {:>24} {:>10}  nearest at",
            "limit", "value", "allowed", "margin"
        )?;
        for margin in &plan.margins {
            margin_row(f, margin)?;
        }
        views(f, plan)?;
        disk(f, plan)?;
        for remark in &plan.remarks {
            write!(f, "\nnote: {remark}")?;
        }
        for violation in &plan.violations {
            write!(f, "\nbeyond a limit: {violation}")?;
        }
        let verdict = if plan.is_feasible { "the arm can run it" } else { "the arm cannot run it" };
        write!(f, "\n{verdict}")
    }
}

fn segments(f: &mut fmt::Formatter<'_>, segments: &[SegmentPlan]) -> fmt::Result {
    let width = segments.iter().map(|s| s.label.len()).max().unwrap_or(0).clamp(7, 40);
    writeln!(
        f,
        "{:<width$} {:>9} {:>9} {:>9} {:>8} {:>8} {:>7}  sets",
        "segment", "start s", "lasts s", "path mm", "mm/s", "mm/s^2", "cruise"
    )?;
    for segment in segments.iter().take(MAX_ROWS) {
        let SegmentPlan { label, start_s, duration_s, length_mm, .. } = segment;
        write!(f, "{label:<width$} {start_s:>9.3} {duration_s:>9.3} {length_mm:>9.2}")?;
        let (speed, acceleration) = (segment.peak_speed_mm_per_s, segment.acceleration_mm_per_s2);
        let cruise = 100.0 * segment.cruise_share;
        let row =
            format!(" {speed:>8.1} {acceleration:>8.0} {cruise:>5.0} %  {}", settings(segment));
        writeln!(f, "{}", row.trim_end())?;
    }
    match segments.len().saturating_sub(MAX_ROWS) {
        0 => Ok(()),
        more => writeln!(f, "... and {more} more (--json lists them all)"),
    }
}

fn settings(segment: &SegmentPlan) -> String {
    let set = &segment.settings;
    let mut message = Vec::new();
    message.extend(set.aps.map(|on| format!("aps {}", if on { "on" } else { "off" })));
    message.extend(set.exposure_scale.map(|scale| format!("exposure x {scale}")));
    message.extend(set.light_level.map(|level| format!("light x {level}")));
    if set.n_flashes > 0 {
        message.push(format!("{} flashes", set.n_flashes));
    }
    message.extend(set.biases.iter().map(|(name, value)| format!("{name} = {value}")));
    message.extend(set.prompt.iter().map(|prompt| format!("prompt: {prompt}")));
    message.join(", ")
}

fn margin_row(f: &mut fmt::Formatter<'_>, margin: &Margin) -> fmt::Result {
    let gauge = &margin.gauge;
    let allowed = match gauge.low {
        Some(low) => format!("{low} to {} {}", gauge.high, gauge.unit),
        None => format!("up to {} {}", gauge.high, gauge.unit),
    };
    let (limit, value, left) = (gauge.limit, gauge.value, margin.margin);
    let (segment, time_s) = (&margin.segment, margin.time_s);
    writeln!(f, "{limit:<26} {value:>10.2} {allowed:>24} {left:>10.2}  {segment}, {time_s:.3} s")
}

fn views(f: &mut fmt::Formatter<'_>, plan: &Plan) -> fmt::Result {
    for view in &plan.views {
        write!(
            f,
            "\n{} sees {:.2} px/mm, a tag of {:.1} px, up to {:.0} px/s; the whole tag {:.0} %, \
             the whole target {:.0} % of the time",
            view.camera,
            view.pixels_per_mm,
            view.tag_side_px,
            view.peak_speed_px_per_s,
            100.0 * view.tag_visible,
            100.0 * view.target_visible
        )?;
    }
    Ok(())
}

fn disk(f: &mut fmt::Formatter<'_>, plan: &Plan) -> fmt::Result {
    writeln!(f, "\n\ndisk, uncompressed: {}", bytes(plan.disk_bytes))?;
    for stream in &plan.disk {
        writeln!(f, "  {:<7} {:>9}  {}", stream.stream, bytes(stream.bytes), stream.basis)?;
    }
    Ok(())
}

fn bytes(n: u64) -> String {
    let n = n as f64;
    match n {
        n if n >= 1e9 => format!("{:.2} GB", n * 1e-9),
        n if n >= 1e6 => format!("{:.1} MB", n * 1e-6),
        n => format!("{:.1} kB", n * 1e-3),
    }
}
