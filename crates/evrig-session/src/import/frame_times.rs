//! The time of each frame: a frame rate, a file, or numbers in the images' names.

use super::event_table::{TIME_UNITS, TimeUnit, seconds, stated_in, to_micros};
use super::images::NamedImage;
use crate::SessionError;
use crate::manifest::file_name;
use evrig_format::npy::{ArrayReader, Column};
use std::path::{Path, PathBuf};

/// Where the frames' times come from.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameTimes {
    /// Equal steps from zero, frames per second.
    Fps(f64),
    /// A file of one time per frame: npy, or text.
    File(PathBuf),
    /// The number in each image's name.
    Names,
}

/// The times of the frames and what was decided about them.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct DecidedTimes {
    pub(super) t_us: Vec<i64>,
    pub(super) decisions: Vec<String>,
}

/// Times between frames of ordinary cameras, 5 to 5000 frames per second, µs. The ends are a factor
/// of 1000 apart, so one unit fits.
const ORDINARY_STEPS_US: [f64; 2] = [200.0, 200_000.0];

/// Longest time between frames that is taken as it is, µs.
const LONGEST_STEP_US: f64 = 5_000_000.0;

/// The time of each of `n` frames, ascending.
pub(super) fn decide(
    times: &FrameTimes,
    unit: Option<TimeUnit>,
    n: u64,
    images: &[NamedImage],
) -> Result<DecidedTimes, SessionError> {
    let (path, column, note) = match times {
        FrameTimes::Fps(fps) => return Ok(of_rate(*fps, n, images)),
        FrameTimes::File(path) => {
            let (column, note) = of_file(path)?;
            (path.clone(), column, note)
        }
        FrameTimes::Names => {
            let path = images.first().map(|image| image.path.clone()).unwrap_or_default();
            let column = of_names(images).ok_or_else(|| {
                SessionError::import(&path, "the names of the images hold no one number each")
            })?;
            let is_count = super::images::steps(images).is_some_and(|steps| {
                let last = steps.last().copied().unwrap_or(0);
                images.last().and_then(|image| image.number) < Some(2 * last + images.len() as u64)
            });
            if is_count && unit.is_none() {
                let what = "the numbers in the names count frames; give their rate with --fps";
                return Err(SessionError::import(&path, what));
            }
            (path, column, None)
        }
    };
    let wrong = |what: String| SessionError::import(&path, what);
    if column.len() as u64 != n {
        return Err(wrong(format!(
            "has {} times for {n} frames; expected one per frame",
            column.len()
        )));
    }
    let (unit, decision) = decide_unit(&column, unit, note).map_err(wrong)?;
    let t_us =
        to_micros(column, unit).map_err(|i| wrong(format!("time {i} is beyond 64 bits of us")))?;
    if let Some(i) = t_us.windows(2).position(|pair| pair[1] <= pair[0]) {
        return Err(wrong(format!(
            "frame {} at {} us is not later than frame {i} at {} us (times read in {unit}); \
             expected ascending times, leave the frame out or give the unit with --timestamps-unit",
            i + 1,
            t_us[i + 1],
            t_us[i]
        )));
    }
    Ok(DecidedTimes { t_us, decisions: vec![decision] })
}

/// The times in a file, µs, however many.
pub(super) fn times_of_file(path: &Path) -> Result<DecidedTimes, SessionError> {
    let n = of_file(path)?.0.len() as u64;
    decide(&FrameTimes::File(path.to_owned()), None, n, &[])
}

/// The numbers in the names of the images.
fn of_names(images: &[NamedImage]) -> Option<Column> {
    let whole: Option<Vec<i64>> =
        images.iter().map(|image| i64::try_from(image.number?).ok()).collect();
    let values = || images.iter().map(|image| image.value).collect::<Option<Vec<f64>>>();
    whole.map(Column::Int).or_else(|| values().map(Column::Float))
}

/// Equal steps; a number that is missing in the names is a step without a frame.
fn of_rate(fps: f64, n: u64, images: &[NamedImage]) -> DecidedTimes {
    let time = |i: u64| (i as f64 * 1e6 / fps).round() as i64;
    let steps = super::images::steps(images);
    match steps {
        Some(steps) if steps.last().is_some_and(|last| *last + 1 > n) => {
            let n_missing = steps.last().copied().unwrap_or(0) + 1 - n;
            let decision = format!(
                "the numbers in the names count the frames: {n_missing} missing ones leave gaps in \
                 time"
            );
            DecidedTimes { t_us: steps.into_iter().map(time).collect(), decisions: vec![decision] }
        }
        _ => DecidedTimes { t_us: (0..n).map(time).collect(), decisions: Vec::new() },
    }
}

fn decide_unit(
    column: &Column,
    given: Option<TimeUnit>,
    stated: Option<(TimeUnit, String)>,
) -> Result<(TimeUnit, String), String> {
    if let Some(unit) = given {
        return Ok((unit, format!("frame times are in {unit} (--timestamps-unit)")));
    }
    if let Some((unit, place)) = stated {
        return Ok((unit, format!("frame times are in {unit} ({place})")));
    }
    let values: Vec<f64> = (0..column.len()).map(|i| column.get(i)).collect();
    let is_whole = values.iter().all(|value| value.fract() == 0.0);
    if is_whole && values.len() > 2 && values.windows(2).all(|pair| pair[1] - pair[0] == 1.0) {
        return Err("counts frames, one by one; give their rate with --fps instead, or state the \
                    unit of these times with --timestamps-unit"
            .into());
    }
    let mut steps: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.retain(|step| *step > 0.0);
    steps.sort_by(f64::total_cmp);
    let Some(step) = steps.get(steps.len() / 2).copied() else {
        return Ok((TimeUnit::Microseconds, "frame times are in us (documented unit)".into()));
    };
    let is_ordinary = |unit: &TimeUnit| {
        (ORDINARY_STEPS_US[0]..=ORDINARY_STEPS_US[1]).contains(&(step * unit.micros()))
    };
    let why = |unit: TimeUnit| {
        format!("frame times are in {unit}: the frames are {} apart", seconds(step * unit.micros()))
    };
    let micros = TimeUnit::Microseconds;
    let ordinary = TIME_UNITS.into_iter().find(is_ordinary);
    let micros_fit = is_whole && (ORDINARY_STEPS_US[0]..=LONGEST_STEP_US).contains(&step);
    match ordinary {
        Some(unit) if unit == micros => Ok((micros, why(micros))),
        Some(unit) if !micros_fit => Ok((unit, why(unit))),
        None if micros_fit => Ok((micros, why(micros))),
        other => Err(format!(
            "frames are {step} apart, which could be {}; state it with --timestamps-unit s, ms, \
             us or ns",
            other.map_or("any unit".to_owned(), |unit| format!("us or {unit}"))
        )),
    }
}

/// The column of times in a file, and the unit that the file states.
type StatedColumn = (Column, Option<(TimeUnit, String)>);

fn of_file(path: &Path) -> Result<StatedColumn, SessionError> {
    let wrong = |what: String| SessionError::import(path, what);
    if path.extension().is_some_and(|ending| ending == "npy") {
        let column = ArrayReader::open(path)?.read_all()?.fields.pop();
        let (name, column) = column.ok_or_else(|| wrong("is empty".into()))?;
        return Ok((column, unit_of_name(&name).or_else(|| unit_of_name(&file_name(path)))));
    }
    of_text(path).map_err(wrong)
}

fn unit_of_name(name: &str) -> Option<(TimeUnit, String)> {
    let lower = name.to_lowercase();
    let stem = lower.rsplit_once('.').map_or(lower.as_str(), |(stem, _)| stem);
    let words = stem.split(|c: char| !c.is_alphanumeric());
    let unit = words.filter(|word| word.len() > 1).find_map(TimeUnit::of_word)?;
    Some((unit, format!("name `{name}`")))
}

/// Times in a text: alone in their lines, in the column that a heading names, beside the names of
/// the images, or behind the numbers of the frames.
fn of_text(path: &Path) -> Result<StatedColumn, String> {
    let text = std::fs::read_to_string(path).map_err(|error| error.to_string())?;
    let mut note = None;
    let mut heading: Vec<String> = Vec::new();
    let mut rows: Vec<Vec<Option<f64>>> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim_start_matches('\u{feff}').trim();
        let comment = line.strip_prefix('#').or_else(|| line.strip_prefix('%'));
        if line.is_empty() || comment.is_some() {
            let unit = stated_in(line).map(|unit| (unit, format!("`{line}`")));
            note = note.or(unit);
            if let Some(comment) = comment.filter(|_| rows.is_empty()) {
                heading = cells(comment).map(str::to_owned).collect();
            }
            continue;
        }
        let row: Vec<Option<f64>> = cells(line)
            .map(|cell| cell.parse::<f64>().ok().filter(|value| value.is_finite()))
            .collect();
        if row.iter().any(Option::is_some) {
            rows.push(row);
        } else if rows.is_empty() {
            heading = cells(line).map(str::to_owned).collect();
        } else {
            return Err(format!("line {}: expected a time, found `{line}`", number + 1));
        }
    }
    let n_columns = rows.first().map_or(0, Vec::len);
    if heading.len() != n_columns {
        heading.clear();
    }
    let column = time_column(&rows, &heading)?;
    let values = rows.iter().enumerate().map(|(i, row)| {
        let value = row.get(column).copied().flatten();
        value.ok_or_else(|| format!("row {} has no time in column {}", i + 1, column + 1))
    });
    let values = values.collect::<Result<Vec<f64>, String>>()?;
    let unit = heading.get(column).and_then(|name| {
        let unit = unit_of_name(name).or_else(|| Some((stated_in(name)?, format!("`{name}`"))));
        unit.filter(|_| note.is_none())
    });
    Ok((exact(&text, column, values), unit.or(note)))
}

fn cells(line: &str) -> impl Iterator<Item = &str> {
    let cells = line.split([',', ';', '\t', ' ']);
    cells.map(str::trim).filter(|cell| !cell.is_empty())
}

/// Whole numbers of up to 18 digits, as times in ns since 1970 have, keep all of them.
fn exact(text: &str, column: usize, values: Vec<f64>) -> Column {
    let lines = text.lines().map(|line| line.trim_start_matches('\u{feff}').trim());
    let rows = lines.filter(|line| !line.is_empty() && !line.starts_with(['#', '%']));
    let whole = rows.filter_map(|line| cells(line).nth(column)).map(str::parse::<i64>);
    let whole: Vec<i64> = whole.filter_map(Result::ok).collect();
    if whole.len() == values.len() { Column::Int(whole) } else { Column::Float(values) }
}

/// Which column holds the times.
fn time_column(rows: &[Vec<Option<f64>>], heading: &[String]) -> Result<usize, String> {
    let Some(first) = rows.first() else { return Err("holds no times".into()) };
    let is_time = |name: &&String| {
        let lower = name.to_lowercase();
        let first = lower.split(|c: char| !c.is_alphanumeric()).next().unwrap_or("").to_owned();
        first == "t" || lower.contains("time") || lower.contains("stamp") || first == "ts"
    };
    let named: Vec<usize> = (0..heading.len()).filter(|i| is_time(&&heading[*i])).collect();
    if let [only] = named.as_slice() {
        return Ok(*only);
    }
    let numeric: Vec<usize> = (0..first.len()).filter(|i| first[*i].is_some()).collect();
    if let [only] = numeric.as_slice() {
        return Ok(*only);
    }
    let counts = |column: usize| {
        let values = rows.iter().map(|row| row.get(column).copied().flatten());
        let mut numbered = values.enumerate();
        let start = first[column].unwrap_or(0.0);
        start <= 1.0 && numbered.all(|(i, value)| value == Some(start + i as f64))
    };
    let others: Vec<usize> = numeric.iter().copied().filter(|column| !counts(*column)).collect();
    match others.as_slice() {
        [only] => Ok(*only),
        _ => Err(format!(
            "has {} columns of numbers; expected one time per line, or a heading that names the \
             column of times",
            numeric.len()
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<i64>, String> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("times.txt");
        std::fs::write(&path, text).unwrap();
        let n = text.lines().filter(|l| l.starts_with(|c: char| c.is_ascii_digit())).count();
        let decided = decide(&FrameTimes::File(path), None, n as u64, &[]);
        decided.map(|decided| decided.t_us).map_err(|error| error.to_string())
    }

    #[test]
    fn every_unit_is_found_from_its_statement_or_from_the_frame_interval() {
        let expected = Ok(vec![0, 8_333, 16_666]);
        for text in [
            "# timecode format v2\n0.000\n8.333\n16.666\n",
            "0.0\n0.008333\n0.016666\n",
            "0\n8333\n16666\n",
            "frame,t_us\n0,0\n1,8333\n2,16666\n",
            "0 0\n1 8333\n2 16666\n",
            "0.0 images/a.png\n0.008333 images/b.png\n0.016666 images/c.png\n",
            "# t [ns]\n0\n8333000\n16666000\n",
            "0\n8333000\n16666000\n",
        ] {
            assert_eq!(read(text), expected, "{text}");
        }
    }

    #[test]
    fn times_that_fit_two_units_or_columns_are_refused() {
        let error = read("0\n1000000\n2000000\n").unwrap_err();
        assert!(error.contains("us or ns"), "{error}");
        let error = read("0\n1\n2\n3\n").unwrap_err();
        assert!(error.contains("--fps"), "{error}");
        let error = read("5 10\n6 8343\n8 16676\n").unwrap_err();
        assert!(error.contains("2 columns of numbers"), "{error}");
    }

    #[test]
    fn times_since_1970_keep_their_nanoseconds_apart() {
        let text = "1700000000000000001\n1700000000008333001\n1700000000016666001\n";
        let t = read(text).unwrap();
        assert_eq!(t[1] - t[0], 8_333);
    }
}
