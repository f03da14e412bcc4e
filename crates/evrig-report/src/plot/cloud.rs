//! Events as points in x, y and time, from a fixed point of view.

use super::Drawing;
use super::Ink;
use super::scale::{AxisScale, ScaleKind};
use super::svg::{Anchor, Canvas};
use crate::figure::{Figure, LegendEntry, LegendMark, Panel};
use crate::number::count;
use evrig_core::event::{Event, EventSlice};
use evrig_core::geometry::Size;

/// Bound on the points of a panel.
const MAX_POINTS: usize = 6_000;
/// The drawing, in user units.
const CANVAS: [f64; 2] = [460.0, 330.0];

/// Events of one window on one grid.
#[derive(Debug, Clone, Copy)]
pub struct Clouds<'a> {
    /// The pixel grid.
    pub size: Size,
    /// The events shown: from the first time up to but not including the second, µs.
    pub window_us: [i64; 2],
    /// Real events in ascending time.
    pub real: EventSlice<'a>,
    /// Simulated events in ascending time.
    pub simulated: EventSlice<'a>,
}

/// Both clouds from the same point of view, equally thinned.
#[must_use]
pub fn figure(clouds: &Clouds<'_>) -> Figure {
    let both = [("Recorded".to_owned(), clouds.real), ("Generated".to_owned(), clouds.simulated)];
    let (panels, thinned) = panels(clouds.size, clouds.window_us, &both);
    Figure {
        title: "Events in space and time".to_owned(),
        caption: format!(
            "{thinned}A moving edge is a tilted sheet: its slope is the speed, its thickness the \
             spread of latencies. Sheets at regular times in the simulation only are artefacts of \
             the frames."
        ),
        legend: legend(),
        panels,
        data: None,
    }
}

/// Legend of the dots.
#[must_use]
pub fn legend() -> Vec<LegendEntry> {
    vec![
        LegendEntry::new(Ink::On, LegendMark::Dot, "ON"),
        LegendEntry::new(Ink::Off, LegendMark::Dot, "OFF"),
    ]
}

/// Titled clouds from the same point of view, equally thinned, and a sentence on the thinning.
#[must_use]
pub fn panels(
    size: Size,
    [from, to]: [i64; 2],
    clouds: &[(String, EventSlice<'_>)],
) -> (Vec<Panel>, String) {
    let shown = |events: &EventSlice<'_>| events.between(from, to).len();
    let most = clouds.iter().map(|(_, events)| shown(events)).max().unwrap_or(0);
    let one_of = most.div_ceil(MAX_POINTS).max(1);
    let window_ms = to.saturating_sub(from) as f64 * 1e-3;
    let thinned = if one_of > 1 {
        format!("One of every {one_of} events is drawn. ")
    } else {
        "Every event is drawn. ".to_owned()
    };
    let panel = |(title, events): &(String, EventSlice<'_>)| {
        let events = events.between(from, to);
        let n = count(events.len() as u64);
        Panel {
            title: title.clone(),
            note: format!("{n} events in {window_ms:.1} ms"),
            alt: format!(
                "{title} events as points in x, y and time: {n} events in {window_ms:.1} ms."
            ),
            drawing: Drawing::single(draw(size, [from, to], events, one_of)),
        }
    };
    (clouds.iter().map(panel).collect(), thinned)
}

/// The fixed view: time runs to the right, x into the page, y down.
struct CloudView {
    time: AxisScale,
    /// Shift on paper per column.
    per_column: [f64; 2],
    /// Shift on paper per row.
    per_row: [f64; 2],
    top: f64,
}

impl CloudView {
    fn new(size: Size, window_ms: f64) -> Self {
        let depth = [128.0, -64.0];
        let time = AxisScale::new(
            ScaleKind::Linear,
            [0.0, window_ms],
            [58.0, CANVAS[0] - depth[0] - 30.0],
        );
        let height = CANVAS[1] - 40.0 + depth[1] - 8.0;
        Self {
            time,
            per_column: depth.map(|d| d / f64::from(size.width.max(2) - 1)),
            per_row: [0.0, height / f64::from(size.height.max(2) - 1)],
            top: 8.0 - depth[1],
        }
    }

    fn place(&self, t_ms: f64, x: f64, y: f64) -> [f64; 2] {
        [
            self.time.position(t_ms) + x * self.per_column[0] + y * self.per_row[0],
            self.top + x * self.per_column[1] + y * self.per_row[1],
        ]
    }
}

fn draw(size: Size, [from, to]: [i64; 2], events: EventSlice<'_>, one_of: usize) -> String {
    let window_ms = to.saturating_sub(from) as f64 * 1e-3;
    let view = CloudView::new(size, window_ms);
    let mut canvas = Canvas::new(CANVAS[0], CANVAS[1]);
    draw_box(&mut canvas, &view, size, window_ms);
    let kept = |i: &usize| hash(*i as u64).is_multiple_of(one_of as u64);
    let place = |event: Event| {
        let t_ms = event.t.saturating_sub(from) as f64 * 1e-3;
        view.place(t_ms, f64::from(event.x), f64::from(event.y))
    };
    // OFF first, since ON is lighter.
    for (ink, polarity) in [(Ink::Off, false), (Ink::On, true)] {
        let chosen = (0..events.len()).filter(|i| events.on[*i] == polarity).filter(kept);
        let class = format!("dots fine {}", ink.class());
        canvas.dots(&class, chosen.map(|i| place(events.get(i))));
    }
    canvas.finish()
}

fn draw_box(canvas: &mut Canvas, view: &CloudView, size: Size, window_ms: f64) {
    let [right, bottom] = [size.width, size.height].map(|n| f64::from(n.max(2) - 1));
    let corner = |t: f64, x: f64, y: f64| view.place(t * window_ms, x * right, y * bottom);
    let edges = [
        ([0., 0., 0.], [1., 0., 0.]),
        ([0., 0., 1.], [1., 0., 1.]),
        ([0., 1., 0.], [1., 1., 0.]),
        ([0., 1., 1.], [1., 1., 1.]),
        ([0., 0., 0.], [0., 1., 0.]),
        ([0., 0., 1.], [0., 1., 1.]),
        ([1., 0., 0.], [1., 1., 0.]),
        ([1., 0., 1.], [1., 1., 1.]),
        ([0., 0., 0.], [0., 0., 1.]),
        ([1., 0., 0.], [1., 0., 1.]),
        ([0., 1., 0.], [0., 1., 1.]),
        ([1., 1., 0.], [1., 1., 1.]),
    ];
    for ([t0, x0, y0], [t1, x1, y1]) in edges {
        canvas.line("grid", corner(t0, x0, y0), corner(t1, x1, y1));
    }
    let floor = corner(0.0, 0.0, 1.0)[1];
    for tick in view.time.ticks(5) {
        let x = view.time.position(tick.value);
        canvas.line("tick", [x, floor], [x, floor + 5.0]);
        canvas.text("tick-label num", [x, floor + 18.0], Anchor::Middle, &tick.label);
    }
    let middle = view.time.position(window_ms / 2.0);
    canvas.text("axis-label", [middle, floor + 34.0], Anchor::Middle, "time (ms)");
    let [x, y] = corner(1.0, 0.5, 1.0);
    canvas.text(
        "axis-label",
        [x + 8.0, y + 18.0],
        Anchor::Start,
        &format!("x ({} px)", size.width),
    );
    let [x, y] = corner(0.0, 0.0, 0.5);
    canvas.text("axis-label", [x - 6.0, y - 4.0], Anchor::End, "y");
    canvas.text("axis-label", [x - 6.0, y + 12.0], Anchor::End, &format!("{} px", size.height));
}

/// Hash of an index for thinning (Steele, Lea and Flood, OOPSLA 2014).
fn hash(index: u64) -> u64 {
    let mut z = index.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::Events;

    #[test]
    fn both_sides_are_thinned_alike_and_the_caption_states_it() {
        let many: Events = (0..20_000)
            .map(|t| Event { t, x: (t % 30) as u16, y: (t % 20) as u16, on: t % 3 == 0 })
            .collect();
        let few = many.as_slice().range(0, 4_000);
        let size = Size::new(30, 20);
        let clouds = Clouds { size, window_us: [0, 20_000], real: many.as_slice(), simulated: few };
        let figure = figure(&clouds);
        assert!(figure.caption.contains("One of every 4 events"));
        let n_dots = |i: usize| figure.panels[i].drawing.wide().matches("h0").count() as f64;
        assert!((n_dots(0) - 5_000.0).abs() < 5.0 * 5_000_f64.sqrt());
        assert!((n_dots(1) - 1_000.0).abs() < 5.0 * 1_000_f64.sqrt());
    }

    #[test]
    fn every_corner_of_the_box_lies_on_the_canvas() {
        let size = Size::DAVIS346;
        let view = CloudView::new(size, 40.0);
        for (t, x, y) in
            [(0.0, 0.0, 0.0), (40.0, 345.0, 259.0), (0.0, 345.0, 0.0), (40.0, 0.0, 259.0)]
        {
            let [px, py] = view.place(t, x, y);
            assert!(
                (0.0..=CANVAS[0]).contains(&px) && (0.0..=CANVAS[1]).contains(&py),
                "{px} {py}"
            );
        }
    }
}
