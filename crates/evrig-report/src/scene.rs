//! The scene section: map of the target, camera path, registration of the event camera.

use super::figure::{Figure, FileLink, LegendEntry, LegendMark, Panel};
use super::number::count;
use super::page::{Fact, Section, SectionBlock};
use super::plot::chart::{Chart, ChartAxis, Layer, Stroke};
use super::plot::grid::{Colours, FirstRow, HeatGrid, draw};
use super::plot::pixel_image::PixelImageError;
use super::plot::{Drawing, Ink};
use evrig_core::geometry::Size;
use evrig_reconstruct::scene::{MovingIllumination, Scene};

/// Columns of a map as it is drawn, at most.
const COLUMNS: usize = 420;

/// Knots of the path that are drawn, at most.
const MAX_POINTS: usize = 2_000;

/// The scene section of the page.
///
/// # Errors
/// When the map has no cells.
pub fn scene_section(scene: &Scene) -> Result<Section, PixelImageError> {
    let blocks = vec![
        SectionBlock::Figure(maps(scene)?),
        SectionBlock::Facts(facts(scene)),
        SectionBlock::Figure(path(scene)),
    ];
    Ok(Section {
        title: "Scene".into(),
        lead: "Radiance of the target from the Pi's raw frames, the camera head's path over it, \
            and the registration of the event camera. The log-intensity signal of the diagnosis \
            is computed from these."
            .into(),
        blocks,
    })
}

fn facts(scene: &Scene) -> Vec<Fact> {
    let (survey, found) = (&scene.reconstruction, &scene.registration);
    let [n, lost] = survey.n_frames;
    let bridged = match survey.n_bridged {
        0 => String::new(),
        n => format!("; {} of them without the tag, from neighbouring frames", count(n as u64)),
    };
    let grid = &survey.map.grid;
    let [row_us, row_error_us] = survey.row_s.map(|s| s * 1e6);
    vec![
        Fact::new(
            "map",
            format!("{} × {} cells of {:.3} mm", grid.width, grid.height, grid.cell_mm),
        ),
        Fact::new(
            "frames on the path",
            format!("{} of {}{bridged}", count((n - lost) as u64), count(n as u64)),
        ),
        Fact::new("rows", format!("{row_us:.2} ± {row_error_us:.2} µs apart by the frames")),
        Fact::new(
            "frames of the event camera",
            format!(
                "{} registered to the map: residual {:.2} DN and {:.4} px per frame",
                found.n_frames, found.residual_dn, found.residual_px
            ),
        ),
        Fact::new(
            "clocks",
            format!(
                "{:.0} ± {:.0} µs from those of the stage sync, rate {:.1} ± {:.1} ppm",
                found.alignment.lag_s * 1e6,
                found.alignment_error[8] * 1e6,
                found.alignment.skew * 1e6,
                found.alignment_error[9] * 1e6
            ),
        ),
        Fact::new(
            "optics",
            format!(
                "blurred by {:.3} ± {:.3} px in addition to the Pi's optics",
                found.spread.sigma_px, found.sigma_error_px
            ),
        ),
        Fact::new("signal error", format!("{:.2} %", 100.0 * found.light_error)),
    ]
    .into_iter()
    .chain(light(scene))
    .collect()
}

/// Vignetting, read noise, tone curve and moving shadow, where measured.
fn light(scene: &Scene) -> impl Iterator<Item = Fact> {
    let tone = scene.registration.tone;
    let percent = |[loss, error]: [f64; 2]| format!("{:.1} ± {:.1} %", 100.0 * loss, 100.0 * error);
    let corners = [
        ("the Pi's", scene.reconstruction.corner_loss),
        ("the event camera's", tone.map(|tone| tone.corner_loss)),
    ];
    let corners: Vec<String> = corners
        .into_iter()
        .filter_map(|(whose, loss)| Some(format!("{} in {whose}", percent(loss?))))
        .collect();
    let corners = (!corners.is_empty()).then(|| corners.join(", "));
    let noise = scene
        .reconstruction
        .read_noise_dn
        .map(|[dn, error]| format!("read noise of the raw frames: {dn:.2} ± {error:.2} DN"));
    let tone = tone.map(|tone| {
        let [gamma, error] = tone.gamma;
        format!(
            "raw frames are proportional to the power {gamma:.3} ± {error:.3} of the event camera's"
        )
    });
    let moving = scene.reconstruction.moving_illumination.as_ref().map(|moving| {
        let MovingIllumination { speed_mm_per_s, direction_deg, depth, .. } = moving;
        format!(
            "a shadow of {} moves over the target at {speed_mm_per_s:.1} mm/s towards \
             {direction_deg:.0}°",
            percent(*depth)
        )
    });
    [("vignetting in corners", corners), ("readout", noise), ("tone", tone), ("shadow", moving)]
        .into_iter()
        .filter_map(|(name, value)| Some(Fact::new(name, value?)))
}

/// Means over blocks of cells, rows from the bottom up; NaN where unknown.
fn reduced(scene: &Scene, values: &[f32]) -> (Size, Vec<f64>) {
    let grid = &scene.reconstruction.map.grid;
    let block = grid.width.div_ceil(COLUMNS).max(1);
    let (width, height) = (grid.width.div_ceil(block), grid.height.div_ceil(block));
    let mean = |i: usize| {
        let (column, row) = (i % width * block, (height - 1 - i / width) * block);
        let rows = row..(row + block).min(grid.height);
        let cells = rows.flat_map(|y| {
            (column..(column + block).min(grid.width)).map(move |x| y * grid.width + x)
        });
        let known = cells.map(|cell| f64::from(values[cell])).filter(|value| value.is_finite());
        let (sum, n) = known.fold((0.0, 0), |(sum, n), value| (sum + value, n + 1));
        if n == 0 { f64::NAN } else { sum / f64::from(n) }
    };
    let size = Size::new(width as u16, height as u16);
    (size, (0..width * height).map(mean).collect())
}

fn maps(scene: &Scene) -> Result<Figure, PixelImageError> {
    let map = &scene.reconstruction.map;
    let grid = &map.grid;
    let [left, top] = grid.origin_mm;
    let (right, bottom) =
        (left + grid.width as f64 * grid.cell_mm, top + grid.height as f64 * grid.cell_mm);
    let drawn = |values: &[f32], colours, label: &str| -> Result<Drawing, PixelImageError> {
        let (cells, values) = reduced(scene, values);
        draw(&HeatGrid {
            x: ChartAxis::linear("x on the target (mm, right)").over(left, right),
            y: ChartAxis::linear("y on the target (mm, up)").over(-bottom, -top),
            cells,
            values: &values,
            first_row: FirstRow::Bottom,
            colours,
            label: label.to_owned(),
        })
    };
    let panel = |title: &str, alt: &str, drawing| Panel {
        title: title.into(),
        note: String::new(),
        alt: alt.into(),
        drawing,
    };
    Ok(Figure {
        title: "Radiance of the target".into(),
        caption: "Map from all raw frames of the Pi, black level subtracted and colours of the \
            mosaic equalised, in millimetres from the tag's middle; and its standard error by \
            cell, from the residuals of the frames. Empty: not covered by any frame."
            .into(),
        legend: vec![],
        panels: vec![
            panel(
                "Radiance",
                "Map of the target's radiance.",
                drawn(map.values(), Colours::Sequential, "DN of green above black")?,
            ),
            panel(
                "Standard error",
                "Map of the standard error of the radiance.",
                drawn(map.errors(), Colours::Log, "DN (log scale)")?,
            ),
        ],
        data: Some(FileLink::beside("derived/scene/map.npy")),
    })
}

/// Errors of the path over time.
fn path(scene: &Scene) -> Figure {
    let knots = &scene.reconstruction.path.knots;
    let pixel_mm = scene.registration.pixel_mm;
    let step = knots.len().div_ceil(MAX_POINTS).max(1);
    let line = |ink, of: &dyn Fn(&evrig_reconstruct::scene::PathKnot) -> f64| Layer::Line {
        ink,
        stroke: Stroke::Solid,
        points: knots.iter().step_by(step).map(|knot| [knot.time_s, of(knot)]).collect(),
    };
    let place = |knot: &evrig_reconstruct::scene::PathKnot| {
        knot.pose_error[0].hypot(knot.pose_error[1]) / std::f64::consts::SQRT_2 / pixel_mm
    };
    let errors = Chart {
        x: ChartAxis::linear("time on the Pi's clock (s)"),
        y: ChartAxis::from_zero("standard error (px)"),
        layers: vec![line(Ink::Real, &place)],
    };
    let misfit = Chart {
        x: ChartAxis::linear("time on the Pi's clock (s)"),
        y: ChartAxis::from_zero("residual / noise"),
        layers: vec![line(Ink::Simulated, &|knot| knot.misfit)],
    };
    let panel = |title: &str, alt: &str, drawing| Panel {
        title: title.into(),
        note: String::new(),
        alt: alt.into(),
        drawing,
    };
    Figure {
        title: "Registration of each frame to the map".into(),
        caption: "Standard error of the head's position at each frame, along one axis, in pixels \
            of the event camera; and the residual of the frame relative to the frames' noise. \
            Peaks are frames under other light, blurred or misregistered."
            .into(),
        legend: vec![
            LegendEntry::new(Ink::Real, LegendMark::Line, "position error"),
            LegendEntry::new(Ink::Simulated, LegendMark::Line, "misfit"),
        ],
        panels: vec![
            panel("Path", "Standard error of the path over time.", errors.draw_half()),
            panel("Misfit", "Misfit of the frames over time.", misfit.draw_half()),
        ],
        data: Some(FileLink::beside("derived/scene/path.npy")),
    }
}
