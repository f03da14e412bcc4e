//! A report page as data, and its HTML.

use super::figure::{Figure, FileLink, Panel};
use super::measure::{MeasureRow, departing, headline};
use super::number::{count, quantity, significant};
use super::plot::{Drawing, strip};
use super::table::{ReportTable, TableCell};
use base64::Engine;
use minijinja::value::Value;
use minijinja::{Environment, context};
use sha2::{Digest, Sha256};

const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// A report: title, summary, sections.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Page {
    /// Name of the session or dataset.
    pub title: String,
    /// Kind of report, such as "Session report".
    pub kind: String,
    /// Summary.
    pub summary: ReportSummary,
    /// Sections in reading order.
    pub sections: Vec<Section>,
    /// Whether sections are folded until they are opened.
    pub is_folded: bool,
    /// Versions, seeds, inputs; at the end of the page.
    pub provenance: Vec<Fact>,
}

/// The top of the page.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReportSummary {
    /// The result in one sentence.
    pub headline: String,
    /// Remarks below it.
    pub remarks: Vec<String>,
    /// Duration, counts, size.
    pub facts: Vec<Fact>,
    /// Pictures of the result: the first two side by side, others over the page's width.
    pub figures: Vec<Figure>,
}

/// A name and its value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fact {
    /// Name.
    pub name: String,
    /// Value with its unit.
    pub value: String,
}

/// A section.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Section {
    /// Title.
    pub title: String,
    /// Introduction.
    pub lead: String,
    /// Figures, tables and text in reading order.
    pub blocks: Vec<SectionBlock>,
}

/// An element of a section.
#[derive(Debug, Clone, PartialEq)]
pub enum SectionBlock {
    /// A figure.
    Figure(Figure),
    /// Comparison measures with their strips and verdicts.
    Measures(Vec<MeasureRow>),
    /// Any other table.
    ReportTable(ReportTable),
    /// Names and values.
    Facts(Vec<Fact>),
    /// A paragraph.
    Text(String),
}

/// A page that cannot be written.
#[derive(Debug, thiserror::Error)]
#[error(
    "the report \"{title}\" cannot be rendered: {source}; this is a fault of evrig's page template"
)]
pub struct PageError {
    title: String,
    source: minijinja::Error,
}

impl Fact {
    /// A name and its value.
    #[must_use]
    pub fn new(name: &str, value: impl Into<String>) -> Self {
        Self { name: name.to_owned(), value: value.into() }
    }
}

impl ReportSummary {
    /// Summary of comparison measures.
    #[must_use]
    pub fn from_measures(measures: &[MeasureRow]) -> Self {
        Self {
            headline: headline(measures),
            remarks: departing(measures),
            figures: measures
                .iter()
                .any(|m| m.healthy.is_some())
                .then(|| strip::departures_figure(measures))
                .into_iter()
                .collect(),
            ..Self::default()
        }
    }
}

impl Page {
    /// The page as one HTML file in UTF-8 that loads nothing from anywhere.
    ///
    /// Its content security policy allows embedded images and the page's own script only.
    ///
    /// # Errors
    /// A fault of the template.
    pub fn to_html(&self) -> Result<String, PageError> {
        self.render().map_err(|source| PageError { title: self.title.clone(), source })
    }

    fn render(&self) -> Result<String, minijinja::Error> {
        let mut environment = Environment::new();
        environment.set_trim_blocks(true);
        environment.set_lstrip_blocks(true);
        // The suffix .html enables escaping.
        environment.add_template("page.html", TEMPLATE)?;
        let sections: Vec<Value> = self.sections.iter().enumerate().map(section_view).collect();
        environment.get_template("page.html")?.render(context! {
            title => self.title,
            kind => self.kind,
            version => env!("CARGO_PKG_VERSION"),
            policy => policy(),
            style => safe(STYLE),
            script => safe(SCRIPT),
            headline => self.summary.headline,
            remarks => self.summary.remarks,
            facts => facts_view(&self.summary.facts),
            figures => self.summary.figures.iter().map(figure_view).collect::<Vec<Value>>(),
            is_folded => self.is_folded,
            sections => sections,
            provenance => facts_view(&self.provenance),
        })
    }
}

fn safe(markup: &str) -> Value {
    Value::from_safe_string(markup.to_owned())
}

fn policy() -> String {
    let hash = |text: &str| base64::engine::general_purpose::STANDARD.encode(Sha256::digest(text));
    format!(
        "default-src 'none'; img-src data:; style-src 'sha256-{}'; script-src 'sha256-{}'; \
         base-uri 'none'; form-action 'none'",
        hash(STYLE),
        hash(SCRIPT)
    )
}

fn section_view((index, section): (usize, &Section)) -> Value {
    let blocks: Vec<Value> = section.blocks.iter().map(block_view).collect();
    context! {
        id => format!("section-{}", index + 1),
        number => index + 1,
        title => section.title,
        lead => section.lead,
        blocks => blocks,
    }
}

fn block_view(block: &SectionBlock) -> Value {
    match block {
        SectionBlock::Figure(figure) => context! { figure => figure_view(figure) },
        SectionBlock::Measures(measures) => {
            let rows: Vec<Value> = measures.iter().map(measure_view).collect();
            context! { measures => rows }
        }
        SectionBlock::ReportTable(table) => context! { table => table_view(table) },
        SectionBlock::Facts(facts) => context! { facts => facts_view(facts) },
        SectionBlock::Text(text) => context! { text => text },
    }
}

fn facts_view(facts: &[Fact]) -> Vec<Value> {
    facts.iter().map(|f| context! { name => f.name, value => f.value }).collect()
}

fn figure_view(figure: &Figure) -> Value {
    let legend: Vec<Value> = figure
        .legend
        .iter()
        .map(|k| context! { ink => k.ink_class(), sample => k.sample_class(), text => k.text() })
        .collect();
    let panels: Vec<Value> = figure.panels.iter().map(panel_view).collect();
    let layout = match figure.panels.as_slice() {
        [one] if !one.drawing.is_wide() => "beside-caption",
        [_, _, ..] if figure.panels.iter().all(|p| !p.drawing.is_wide()) => "side-by-side",
        _ => "stacked",
    };
    context! {
        title => figure.title,
        caption => figure.caption,
        legend => legend,
        panels => panels,
        layout => layout,
        data => figure.data.as_ref().map(link_view),
    }
}

fn panel_view(panel: &Panel) -> Value {
    context! {
        title => panel.title,
        note => panel.note,
        alt => panel.alt,
        size => if panel.drawing.is_wide() { "full" } else { "half" },
        drawing => drawing_view(&panel.drawing),
    }
}

fn drawing_view(drawing: &Drawing) -> Value {
    context! { wide => safe(drawing.wide()), narrow => drawing.narrow().map(safe) }
}

fn link_view(link: &FileLink) -> Value {
    context! { href => link.href(), text => link.text() }
}

fn measure_view(measure: &MeasureRow) -> Value {
    let shown = quantity(&measure.estimate);
    let verdict = measure.verdict();
    // Counts are not rounded.
    let side = |value: Option<f64>| {
        value
            .map(|v| if v.fract() == 0.0 && v >= 1e3 { count(v as u64) } else { significant(v, 4) })
    };
    context! {
        id => measure.id,
        name => measure.name,
        formula => measure.formula,
        source => measure.source,
        unit => measure.unit,
        value => shown.value,
        error => shown.error,
        n => measure.estimate.n,
        range => measure.range_text(),
        verdict => verdict.word(),
        mark => verdict.mark(),
        class => verdict.class(),
        strip => drawing_view(&strip::row(measure)),
        has_sides => measure.real.is_some() || measure.simulated.is_some(),
        real => side(measure.real),
        simulated => side(measure.simulated),
        data => measure.data.as_ref().map(link_view),
    }
}

fn table_view(table: &ReportTable) -> Value {
    let columns: Vec<Value> = table
        .columns
        .iter()
        .map(|c| context! { name => c.name, unit => c.unit, is_numeric => c.is_numeric })
        .collect();
    let cell_view = |cell: Option<&TableCell>, is_numeric: bool| {
        context! {
            text => cell.map_or("", TableCell::shown),
            key => cell.and_then(TableCell::sort_key).map(|key| format!("{key:e}")),
            link => cell.and_then(TableCell::link).map(link_view),
            is_numeric => is_numeric,
        }
    };
    let rows: Vec<Vec<Value>> = table
        .rows
        .iter()
        .map(|row| {
            let cells = table.columns.iter().enumerate();
            cells.map(|(i, column)| cell_view(row.get(i), column.is_numeric)).collect()
        })
        .collect();
    context! { title => table.title, caption => table.caption, columns => columns, rows => rows }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{LegendEntry, LegendMark};
    use crate::measure::tests::measure;
    use crate::plot::Ink;
    use crate::plot::chart::{Chart, ChartAxis, Layer, Stroke};
    use crate::table::TableColumn;

    const HOSTILE: &str = "<script>alert(1)</script>\"'&<img src=x onerror=alert(1)>";

    /// A measure whose every text is hostile.
    fn hostile_measure() -> crate::measure::MeasureRow {
        let mut hostile_measure = measure(9.0, 0.1, Some([0.5, 2.0]));
        for text in [
            &mut hostile_measure.id,
            &mut hostile_measure.name,
            &mut hostile_measure.formula,
            &mut hostile_measure.source,
            &mut hostile_measure.unit,
        ] {
            *text = HOSTILE.into();
        }
        hostile_measure.data = Some(FileLink::beside(HOSTILE));
        hostile_measure
    }

    /// A page whose every text is hostile.
    fn hostile_page() -> Page {
        let line = Layer::Line {
            ink: Ink::Real,
            stroke: Stroke::Solid,
            points: vec![[0.0, 1.0], [1.0, 2.0]],
        };
        let level = Layer::Level { y: 1.5, text: HOSTILE.into() };
        let chart = Chart {
            x: ChartAxis::linear(HOSTILE),
            y: ChartAxis::log(HOSTILE),
            layers: vec![line, level],
        };
        let panel = |drawing| Panel {
            title: HOSTILE.into(),
            note: HOSTILE.into(),
            alt: HOSTILE.into(),
            drawing,
        };
        let figure = Figure {
            title: HOSTILE.into(),
            caption: HOSTILE.into(),
            legend: vec![LegendEntry::new(Ink::On, LegendMark::Dot, HOSTILE)],
            panels: vec![panel(chart.draw_wide()), panel(chart.draw_half())],
            data: Some(FileLink::beside(HOSTILE)),
        };
        let measures = vec![hostile_measure()];
        let mut summary = ReportSummary::from_measures(&measures);
        summary.facts = vec![Fact::new(HOSTILE, HOSTILE)];
        let cell = TableCell::text(HOSTILE).with_link(FileLink::beside("javascript:alert(1)"));
        let table = ReportTable {
            title: HOSTILE.into(),
            caption: HOSTILE.into(),
            columns: vec![TableColumn::number(HOSTILE, HOSTILE), TableColumn::text("short row")],
            rows: vec![vec![cell]],
        };
        Page {
            title: HOSTILE.into(),
            kind: HOSTILE.into(),
            summary,
            sections: vec![Section {
                title: HOSTILE.into(),
                lead: HOSTILE.into(),
                blocks: vec![
                    SectionBlock::Figure(figure),
                    SectionBlock::Measures(measures),
                    SectionBlock::ReportTable(table),
                    SectionBlock::Facts(vec![Fact::new(HOSTILE, HOSTILE)]),
                    SectionBlock::Text(HOSTILE.into()),
                ],
            }],
            is_folded: true,
            provenance: vec![Fact::new(HOSTILE, HOSTILE)],
        }
    }

    #[test]
    fn every_text_comes_out_escaped() {
        let html = hostile_page().to_html().unwrap();
        assert_eq!(html.matches("<script").count(), 1, "only our own script");
        assert!(!html.contains("<img") && !html.contains("alert(1)</script"));
        assert!(!html.contains("href=\"javascript"));
        assert!(html.matches("&lt;script&gt;").count() > 30, "every text is still shown");
    }

    #[test]
    fn the_page_refers_to_nothing_outside_itself() {
        let html = hostile_page().to_html().unwrap();
        for outside in ["http://", "https://", "url(", "@import", "src=\"//", "href=\"//", "xlink"]
        {
            assert!(!html.contains(outside), "{outside}");
        }
        assert!(
            html.contains("default-src &#x27;none&#x27;") || html.contains("default-src 'none'")
        );
    }

    #[test]
    fn every_figure_has_a_caption_and_every_drawing_words() {
        let html = hostile_page().to_html().unwrap();
        let count = |what: &str| html.matches(what).count();
        assert_eq!(count("<figure"), 3, "summary, figure, table");
        assert_eq!(count("<figure"), count("<figcaption>"));
        assert_eq!(count("class=\"drawing\""), count("role=\"img\" aria-label=\"&lt;") + 1);
        assert!(html.contains("aria-label=\"Departures from identical. "));
        assert!(!html.contains("aria-label=\"\""));
    }

    #[test]
    fn a_short_row_ends_in_empty_cells_and_an_empty_page_is_a_page() {
        let html = hostile_page().to_html().unwrap();
        let row = html.split("class=\"sortable\"").nth(1).unwrap();
        assert_eq!(
            row.split("<tbody>")
                .nth(1)
                .unwrap()
                .split("</tr>")
                .next()
                .unwrap()
                .matches("<td")
                .count(),
            2
        );
        assert!(Page::default().to_html().unwrap().contains("</html>"));
    }

    /// Colour of a variable in the style sheet, light or dark.
    fn variable(name: &str, is_dark: bool) -> [f64; 3] {
        let declared = STYLE.split(&format!("{name}: #")).nth(1 + usize::from(is_dark)).unwrap();
        let part =
            |i: usize| f64::from(u8::from_str_radix(&declared[2 * i..2 * i + 2], 16).unwrap());
        [part(0), part(1), part(2)]
    }

    /// Contrast ratio of WCAG 2.1, 1 to 21.
    fn contrast(a: [f64; 3], b: [f64; 3]) -> f64 {
        let luminance = |colour: [f64; 3]| {
            let linear = colour.map(|v| {
                let v = v / 255.0;
                if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
            });
            0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
        };
        let (a, b) = (luminance(a) + 0.05, luminance(b) + 0.05);
        a.max(b) / a.min(b)
    }

    #[test]
    fn text_can_be_read_and_pairs_differ_without_colour() {
        for is_dark in [false, true] {
            let between = |a: &str, b: &str| contrast(variable(a, is_dark), variable(b, is_dark));
            for text in ["--ink", "--muted", "--link", "--good", "--warn", "--bad"] {
                assert!(between(text, "--paper") >= 4.5, "{text} on paper, dark: {is_dark}");
            }
            for mark in ["--real", "--sim", "--fix", "--off"] {
                assert!(between(mark, "--paper") >= 3.0, "{mark} on paper, dark: {is_dark}");
            }
            for (a, b) in [("--real", "--sim"), ("--on", "--off"), ("--real", "--fix")] {
                assert!(
                    between(a, b) >= 1.7,
                    "{a} and {b} in gray, dark: {is_dark}: {}",
                    between(a, b)
                );
            }
        }
    }
}
