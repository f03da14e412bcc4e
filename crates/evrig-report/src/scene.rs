//! The section on the scene: the map of the print, the head's path over it, the event camera's tie.

use super::figure::{Figure, Key, Link, Panel, Sample};
use super::number::count;
use super::page::{Block, Fact, Section};
use super::plot::chart::{Axis, Chart, Layer, Stroke};
use super::plot::grid::{Colours, FirstRow, Grid, draw};
use super::plot::picture::PictureError;
use super::plot::{Drawing, Ink};
use evrig_core::geometry::Size;
use evrig_reconstruct::scene::{MovingIllumination, Scene};

/// Columns of a map as it is drawn, at most.
const COLUMNS: usize = 420;

/// Knots of the path that are drawn, at most.
const MAX_POINTS: usize = 2_000;

/// What the event pixels looked at, and how well it is known.
///
/// # Errors
/// When the map has no cells.
pub fn scene_section(scene: &Scene) -> Result<Section, PictureError> {
    let blocks =
        vec![Block::Figure(maps(scene)?), Block::Facts(facts(scene)), Block::Figure(path(scene))];
    Ok(Section {
        title: "Scene".into(),
        lead: "The print as the Pi's raw frames show it, the head's path over it, and how the event \
               camera is tied to both. The light signal that real events are held against comes from here."
            .into(),
        blocks,
    })
}

fn facts(scene: &Scene) -> Vec<Fact> {
    let (survey, found) = (&scene.reconstruction, &scene.registration);
    let [n, lost] = survey.n_frames;
    let bridged = match survey.n_bridged {
        0 => String::new(),
        n => format!("; {} of them without the tag, from the frames beside them", count(n as u64)),
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
                "{} held against the map: {:.2} DN and {:.4} px a frame left",
                found.n_frames, found.residual_dn, found.residual_px
            ),
        ),
        Fact::new(
            "clocks",
            format!(
                "{:.0} ± {:.0} µs off those of the stage sync, rate {:.1} ± {:.1} ppm",
                found.alignment.lag_s * 1e6,
                found.alignment_error[8] * 1e6,
                found.alignment.skew * 1e6,
                found.alignment_error[9] * 1e6
            ),
        ),
        Fact::new(
            "optics",
            format!(
                "the map is blurred by {:.3} ± {:.3} px on top of the Pi's own",
                found.spread.sigma_px, found.sigma_error_px
            ),
        ),
        Fact::new("light", format!("places are wrong by {:.2} %", 100.0 * found.light_error)),
    ]
    .into_iter()
    .chain(light(scene))
    .collect()
}

/// What frames show of lenses, readout and lamps.
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
    let noise = scene.reconstruction.read_noise_dn.map(|[dn, error]| {
        format!("raw frames scatter by {dn:.2} ± {error:.2} DN where there is no light")
    });
    let tone = tone.map(|tone| {
        let [gamma, error] = tone.gamma;
        format!("raw frames go as the power {gamma:.3} ± {error:.3} of those of the event camera")
    });
    let moving = scene.reconstruction.moving_illumination.as_ref().map(|moving| {
        let MovingIllumination { speed_mm_per_s, direction_deg, depth, .. } = moving;
        format!(
            "a shadow of {} goes over the print by {speed_mm_per_s:.1} mm/s along {direction_deg:.0}°",
            percent(*depth)
        )
    });
    [("light lost in corners", corners), ("readout", noise), ("tone", tone), ("shadow", moving)]
        .into_iter()
        .filter_map(|(what, says)| Some(Fact::new(what, says?)))
}

/// Means over blocks of cells, row after row from the bottom; what is not known stays empty.
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

fn maps(scene: &Scene) -> Result<Figure, PictureError> {
    let map = &scene.reconstruction.map;
    let grid = &map.grid;
    let [left, top] = grid.origin_mm;
    let (right, bottom) =
        (left + grid.width as f64 * grid.cell_mm, top + grid.height as f64 * grid.cell_mm);
    let drawn = |values: &[f32], colours, label: &str| -> Result<Drawing, PictureError> {
        let (cells, values) = reduced(scene, values);
        draw(&Grid {
            x: Axis::linear("right on the print (mm)").over(left, right),
            y: Axis::linear("up on the print (mm)").over(-bottom, -top),
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
        title: "Radiance of the print".into(),
        caption: "The map that all raw frames of the Pi made together, pedestal removed and the mosaic's \
                  colours brought to one level, in millimetres from the tag's middle; and its standard \
                  error by cell, from what the frames leave unexplained. Empty: no frame looked."
            .into(),
        legend: vec![],
        panels: vec![
            panel(
                "Radiance",
                "Map of the print's radiance.",
                drawn(map.values(), Colours::Sequential, "DN of green above black")?,
            ),
            panel(
                "Standard error",
                "Map of the standard error of the radiance.",
                drawn(map.errors(), Colours::Log, "DN (log scale)")?,
            ),
        ],
        data: Some(Link::beside("derived/scene/map.npy")),
    })
}

/// The path's errors over time, in pixels of the event camera.
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
        x: Axis::linear("time on the Pi's clock (s)"),
        y: Axis::from_zero("standard error (px)"),
        layers: vec![line(Ink::Real, &place)],
    };
    let misfit = Chart {
        x: Axis::linear("time on the Pi's clock (s)"),
        y: Axis::from_zero("left over noise"),
        layers: vec![line(Ink::Simulated, &|knot| knot.misfit)],
    };
    let panel = |title: &str, alt: &str, drawing| Panel {
        title: title.into(),
        note: String::new(),
        alt: alt.into(),
        drawing,
    };
    Figure {
        title: "How well each frame lies on the map".into(),
        caption: "The standard error of the head's place at each frame, along one axis, in pixels of the \
                  event camera; and what the map leaves unexplained of the frame, over the frames' own noise. \
                  A rise is a frame in other light, blurred, or in the wrong place."
            .into(),
        legend: vec![
            Key::new(Ink::Real, Sample::Line, "error of place"),
            Key::new(Ink::Simulated, Sample::Line, "misfit"),
        ],
        panels: vec![
            panel("Path", "Standard error of the path over time.", errors.draw_half()),
            panel("Misfit", "Misfit of the frames over time.", misfit.draw_half()),
        ],
        data: Some(Link::beside("derived/scene/path.npy")),
    }
}
