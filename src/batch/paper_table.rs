//! A comparison as a paper's table: LaTeX for booktabs, and the same as CSV.
//!
//! A row is a variant, a column a measure. Within a group of rows, a session or the mean over all,
//! the value nearest to the ideal one is marked in each column. Whether it differs from the others
//! is to be read from the errors.

use super::BatchError;
use super::aggregate::{Aggregate, plain, write_csv};
use crate::pipeline::PipelineError;
use evrig_analysis::compare::{IdealValue, MeasureId};
use evrig_core::stats::Estimate;
use evrig_report::{latex, number};
use evrig_session::SessionError;
use std::path::PathBuf;

/// What the table holds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PaperTableRequest {
    /// Path of both files without ending.
    pub out: PathBuf,
    /// Measures by their keys, in the order of the columns; all where none is given.
    pub measures: Vec<String>,
    /// Whether every session has rows of its own, before the means.
    pub has_sessions: bool,
}

struct PaperColumn {
    key: String,
    name: String,
    unit: String,
    ideal: IdealValue,
}

/// Rows among which the best values are marked.
struct PaperGroup {
    /// The session, or the number of those behind the means.
    name: String,
    rows: Vec<PaperRow>,
}

struct PaperRow {
    variant: String,
    cells: Vec<PaperCell>,
}

struct PaperCell {
    estimate: Estimate,
    is_best: bool,
}

/// Writes a comparison as `<out>.tex` and `<out>.csv`; gives both paths.
///
/// The errors of a session are those of its time blocks or tiles, the errors of means those of a
/// bootstrap over sessions. Values and errors in the CSV are not rounded.
///
/// # Errors
/// [`PipelineError::Request`] for a measure that the comparison does not hold; when the disk refuses.
pub fn write_paper_table(
    aggregate: &Aggregate,
    request: &PaperTableRequest,
) -> Result<[PathBuf; 2], BatchError> {
    let columns = columns(aggregate, &request.measures)?;
    let groups = groups(aggregate, &columns, request.has_sessions);
    let paths = ["tex", "csv"].map(|ending| {
        // A dot in the name is no ending.
        let mut name = request.out.clone().into_os_string();
        name.push(format!(".{ending}"));
        PathBuf::from(name)
    });
    let [tex, csv] = &paths;
    if let Some(folder) = tex.parent() {
        std::fs::create_dir_all(folder).map_err(SessionError::io(folder))?;
    }
    evrig_session::write_whole(tex, latex_table(aggregate, &columns, &groups).as_bytes())?;
    write_csv(csv, csv_rows(&columns, &groups).into_iter())?;
    Ok(paths)
}

fn columns(aggregate: &Aggregate, wanted: &[String]) -> Result<Vec<PaperColumn>, BatchError> {
    let cells = aggregate.variants.first().map(|variant| variant.cells.as_slice());
    let cells = cells.unwrap_or_default();
    let known = || cells.iter().map(|cell| cell.measure.clone());
    let keys: Vec<String> = if wanted.is_empty() { known().collect() } else { wanted.to_vec() };
    if keys.is_empty() {
        let what = "nothing was compared, so that there is no table to write";
        return Err(PipelineError::Request(what.into()).into());
    }
    let column = |key: String| {
        let cell = cells.iter().find(|cell| cell.measure == key);
        let id = serde_json::from_value::<MeasureId>(key.as_str().into()).ok();
        let (cell, id) = cell.zip(id).ok_or_else(|| {
            let known = known().collect::<Vec<_>>().join(", ");
            PipelineError::Request(format!("no measure `{key}`; the comparison has {known}"))
        })?;
        let (name, unit) = (cell.name.clone(), cell.unit.clone());
        Ok(PaperColumn { key, name, unit, ideal: id.ideal() })
    };
    keys.into_iter().map(column).collect()
}

fn groups(aggregate: &Aggregate, columns: &[PaperColumn], has_sessions: bool) -> Vec<PaperGroup> {
    let mut sessions: Vec<&str> = aggregate.sessions.iter().map(|v| v.session.as_str()).collect();
    sessions.dedup();
    let of_session = |session: &str| {
        let value = |variant: &str, key: &str| {
            let mut values = aggregate.sessions.iter();
            let found = values.find(|v| {
                (v.session.as_str(), v.variant.as_str()) == (session, variant) && v.measure == key
            });
            found.map(|value| value.estimate)
        };
        group(session.to_owned(), aggregate, columns, value)
    };
    let of_all = |variant: &str, key: &str| {
        let variant = aggregate.variants.iter().find(|known| known.name == variant)?;
        variant.cells.iter().find(|cell| cell.measure == key).map(|cell| cell.mean)
    };
    let n = sessions.len();
    // The mean of one session is that session, with its own errors.
    let (is_split, is_pooled) = (has_sessions || n == 1, n > 1);
    let mut groups: Vec<PaperGroup> =
        sessions.into_iter().filter(|_| is_split).map(of_session).collect();
    if is_pooled {
        groups.push(group(format!("mean of {n} sessions"), aggregate, columns, of_all));
    }
    groups
}

fn group(
    name: String,
    aggregate: &Aggregate,
    columns: &[PaperColumn],
    value: impl Fn(&str, &str) -> Option<Estimate>,
) -> PaperGroup {
    let row = |variant: &str| -> Option<PaperRow> {
        let found: Vec<Option<Estimate>> =
            columns.iter().map(|column| value(variant, &column.key)).collect();
        // A variant that a session lacks has no row there.
        found.iter().any(Option::is_some).then(|| {
            let cell = |estimate: Option<Estimate>| PaperCell {
                estimate: estimate.unwrap_or(Estimate::unknown()),
                is_best: false,
            };
            PaperRow { variant: variant.to_owned(), cells: found.into_iter().map(cell).collect() }
        })
    };
    let mut rows: Vec<PaperRow> =
        aggregate.variants.iter().filter_map(|variant| row(&variant.name)).collect();
    for (i, column) in columns.iter().enumerate() {
        let shortfall = |row: &PaperRow| column.ideal.shortfall(row.cells[i].estimate.value);
        let known: Vec<f64> = rows.iter().map(shortfall).filter(|value| !value.is_nan()).collect();
        let least = known.iter().copied().fold(f64::INFINITY, f64::min);
        for row in rows.iter_mut().filter(|_| known.len() > 1) {
            row.cells[i].is_best = shortfall(row) == least;
        }
    }
    PaperGroup { name, rows }
}

fn latex_table(aggregate: &Aggregate, columns: &[PaperColumn], groups: &[PaperGroup]) -> String {
    let heading = |column: &PaperColumn| {
        let unit = match column.unit.as_str() {
            "1" | "" => String::new(),
            unit => format!(" [{}]", latex::text(unit)),
        };
        let arrow = match column.ideal {
            IdealValue::One => r"\to 1",
            IdealValue::Zero => r"\downarrow",
            IdealValue::Largest => r"\uparrow",
        };
        format!("{}{unit} ${arrow}$", latex::text(&column.name))
    };
    let mut lines = vec![
        format!("% evrig {}, {}", env!("CARGO_PKG_VERSION"), aggregate.dataset.replace('\n', " ")),
        r"% \usepackage{booktabs}".to_owned(),
        format!(r"\begin{{tabular}}{{ll{}}}", "c".repeat(columns.len())),
        r"\toprule".to_owned(),
        format!(
            r"Session & Variant & {} \\",
            columns.iter().map(heading).collect::<Vec<_>>().join(" & ")
        ),
    ];
    for group in groups {
        lines.push(r"\midrule".to_owned());
        for (i, row) in group.rows.iter().enumerate() {
            let name = if i == 0 { latex::text(&group.name) } else { String::new() };
            let cell =
                |cell: &PaperCell| latex::quantity(&number::quantity(&cell.estimate), cell.is_best);
            let cells: Vec<String> = row.cells.iter().map(cell).collect();
            lines.push(format!(
                r"{name} & {} & {} \\",
                latex::text(&row.variant),
                cells.join(" & ")
            ));
        }
    }
    lines.push(r"\bottomrule".to_owned());
    lines.push("\\end{tabular}\n".to_owned());
    lines.join("\n")
}

/// Rows of session, variant, value and standard error of each measure, and the measures in which
/// the row is the best of its group.
fn csv_rows(columns: &[PaperColumn], groups: &[PaperGroup]) -> Vec<Vec<String>> {
    let mut head = vec!["session".to_owned(), "variant".to_owned()];
    head.extend(columns.iter().flat_map(|c| [c.key.clone(), format!("{}_error", c.key)]));
    head.push("best".to_owned());
    let mut rows = vec![head];
    for (group, row) in groups.iter().flat_map(|g| g.rows.iter().map(move |row| (g, row))) {
        let mut fields = vec![group.name.clone(), row.variant.clone()];
        fields.extend(
            row.cells
                .iter()
                .flat_map(|cell| [cell.estimate.value, cell.estimate.standard_error].map(plain)),
        );
        let best = columns.iter().zip(&row.cells).filter(|(_, cell)| cell.is_best);
        fields.push(best.map(|(column, _)| column.key.as_str()).collect::<Vec<_>>().join(" "));
        rows.push(fields);
    }
    rows
}
