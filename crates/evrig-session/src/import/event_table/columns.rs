//! Which column is which: by `--columns`, by names, else by the only order that fits the data.

use super::column_facts::ColumnFacts;
use super::time_unit::{self, TimeUnit};
use evrig_core::geometry::Size;
use evrig_format::StoredTable;
use rayon::prelude::*;
use std::str::FromStr;

/// Indices of the columns t, x, y and p, and how they were found.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ColumnAssignment {
    /// Of t, x, y, p.
    pub(super) columns: [usize; 4],
    /// The unit of t that its heading states, and where.
    pub(super) unit: Option<(TimeUnit, String)>,
    /// How it was found.
    pub(super) decision: String,
}

/// An order of columns given by the user: `txyp`, with `-` for a column to ignore.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColumnOrder {
    columns: [usize; 4],
    text: String,
}

impl FromStr for ColumnOrder {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || "expected each of t, x, y, p once, and - for others, as txyp or -xypt";
        let letters: Vec<char> = text.chars().filter(|c| *c != ',' && *c != ' ').collect();
        if letters.iter().any(|letter| !"txyp-".contains(*letter)) {
            return Err(expected().into());
        }
        let place = |wanted: char| {
            let mut found = letters.iter().enumerate().filter(|(_, letter)| **letter == wanted);
            let only = found.next().map(|(i, _)| i);
            only.filter(|_| found.next().is_none()).ok_or_else(|| expected().to_owned())
        };
        let columns = [place('t')?, place('x')?, place('y')?, place('p')?];
        Ok(Self { columns, text: letters.into_iter().collect() })
    }
}

/// Words by which columns are named: t, x, y, p.
const NAMES: [&[&str]; 4] = [
    &["t", "ts", "time", "times", "timestamp", "timestamps", "stamp"],
    &["x", "xs"],
    &["y", "ys"],
    &["p", "ps", "pol", "polarity", "polarities", "on"],
];

/// Rows below which the usual order t, x, y, p is taken where it fits.
const MIN_ROWS_FOR_ORDER: usize = 20;

/// Finds the columns.
///
/// # Errors
/// When names are missing, or no order or several fit the data.
pub(super) fn assign(
    table: &StoredTable,
    order: Option<&ColumnOrder>,
    size: Option<Size>,
) -> Result<ColumnAssignment, String> {
    let names: Vec<&str> = table.columns.iter().map(|(name, _)| name.as_str()).collect();
    if let Some(order) = order {
        let n = order.text.chars().count();
        if n != names.len() {
            return Err(format!("has {} columns; --columns {} names {n}", names.len(), order.text));
        }
        let decision = format!("columns are {} (--columns)", order.text);
        return Ok(ColumnAssignment { columns: order.columns, unit: None, decision });
    }
    if names.iter().any(|name| !name.is_empty()) {
        return by_names(&names, "heading");
    }
    for note in &table.notes {
        let described = note.rsplit_once(':').map_or(note.as_str(), |(_, list)| list);
        let described = described.trim_start_matches(['#', '%', '/', ' ']);
        let parts: Vec<&str> = if described.contains(',') {
            described.split(',').map(str::trim).collect()
        } else {
            described.split_whitespace().collect()
        };
        if parts.len() == names.len()
            && let Ok(found) = by_names(&parts, "comment")
        {
            return Ok(found);
        }
    }
    by_data(table, size)
}

fn by_names(names: &[&str], place: &str) -> Result<ColumnAssignment, String> {
    let words: Vec<Vec<String>> = names.iter().map(|name| words_of(name)).collect();
    let find = |known: &[&str]| {
        let is_named = |words: &&Vec<String>| words.iter().any(|w| known.contains(&w.as_str()));
        let found: Vec<usize> = (0..names.len()).filter(|i| is_named(&&words[*i])).collect();
        // `t` beside `t_offset`: the shortest name is meant.
        let exact = found.iter().copied().filter(|i| words[*i].len() == 1).collect::<Vec<_>>();
        match (exact.as_slice(), found.as_slice()) {
            ([only], _) | ([], [only]) => Ok(*only),
            ([], []) => Err(format!("{place} {names:?} names no column `{}`", known[0])),
            _ => Err(format!("{place} {names:?} names several columns `{}`", known[0])),
        }
    };
    let add_remedy = |what: String| format!("{what}; state the order with --columns, as txyp");
    let columns = [find(NAMES[0]), find(NAMES[1]), find(NAMES[2]), find(NAMES[3])];
    let [t, x, y, p] = columns.map(|found| found.map_err(add_remedy));
    let columns = [t?, x?, y?, p?];
    let time = names[columns[0]];
    let unit = words[columns[0]].iter().find_map(|word| TimeUnit::of_word(word));
    let unit = unit.or_else(|| time_unit::stated_in(time));
    Ok(ColumnAssignment {
        columns,
        unit: unit.map(|unit| (unit, format!("{place} `{time}`"))),
        decision: format!("columns t, x, y, p are {} ({place})", describe(columns)),
    })
}

/// `timestamp_us` and `time (us)` as words.
fn words_of(name: &str) -> Vec<String> {
    let lower = name.trim().to_lowercase();
    let is_part = |c: char| c.is_alphanumeric();
    lower.split(|c| !is_part(c)).filter(|w| !w.is_empty()).map(str::to_owned).collect()
}

fn describe(columns: [usize; 4]) -> String {
    columns.map(|i| (i + 1).to_string()).join(", ")
}

/// The only order in which every column can be what it is taken for; x is taken to be before y.
fn by_data(table: &StoredTable, size: Option<Size>) -> Result<ColumnAssignment, String> {
    let n = table.columns.len();
    if n != 4 {
        return Err(format!(
            "has {n} columns without names; expected t, x, y, p; state which they are with \
             --columns, as txyp--"
        ));
    }
    let facts: Vec<ColumnFacts> =
        table.columns.par_iter().map(|(_, column)| ColumnFacts::of(column)).collect();
    let found = |columns: [usize; 4], why: &str| ColumnAssignment {
        columns,
        unit: None,
        decision: format!("columns t, x, y, p are {} ({why})", describe(columns)),
    };
    let fits = |[t, x, y, p]: [usize; 4]| {
        facts[p].can_be_polarity()
            && facts[x].can_be_coordinate(size.map(|size| size.width))
            && facts[y].can_be_coordinate(size.map(|size| size.height))
            && facts[t].can_be_time()
    };
    const USUAL: [usize; 4] = [0, 1, 2, 3];
    // Of a few rows nothing is known but the usual order; a wrong polarity is named as such.
    let fits_but_polarity = facts[1].can_be_coordinate(None) && facts[2].can_be_coordinate(None);
    let is_short = table.n_rows() < MIN_ROWS_FOR_ORDER;
    if is_short && (fits(USUAL) || (fits_but_polarity && !facts[3].can_be_polarity())) {
        return Ok(found(USUAL, "the usual order"));
    }
    let mut fitting: Vec<[usize; 4]> = orders().filter(|order| fits(*order)).collect();
    // Recordings are in order of time: an order with such a column outweighs those without.
    if fitting.iter().any(|order| facts[order[0]].is_ascending()) {
        fitting.retain(|order| facts[order[0]].is_ascending());
    }
    let x_before_y: Vec<[usize; 4]> =
        fitting.iter().copied().filter(|[_, x, y, _]| x < y).collect();
    let candidates = if x_before_y.is_empty() { &fitting } else { &x_before_y };
    match candidates.as_slice() {
        [only] => Ok(found(*only, "the only order that fits the data")),
        [] if fits(USUAL) => Ok(found(USUAL, "the usual order")),
        [] => Err(format!(
            "columns {}: no order of t, x, y and p fits the data{}; state it with --columns, as \
             txyp",
            facts.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
            size.map(|size| format!(" and the grid {size}")).unwrap_or_default()
        )),
        several => {
            let orders: Vec<String> = several.iter().map(|order| letters(*order)).collect();
            Err(format!(
                "its columns have no names and fit several orders: {}; state it with --columns",
                orders.join(", ")
            ))
        }
    }
}

fn letters(columns: [usize; 4]) -> String {
    let mut text = ['-'; 4];
    columns.into_iter().zip(['t', 'x', 'y', 'p']).for_each(|(i, letter)| text[i] = letter);
    text.iter().collect()
}

/// All orders of four columns.
fn orders() -> impl Iterator<Item = [usize; 4]> {
    let all = (0..256).map(|i| [i / 64, i / 16 % 4, i / 4 % 4, i % 4]);
    all.filter(|order| (0..4).all(|i| order.contains(&i)))
}
