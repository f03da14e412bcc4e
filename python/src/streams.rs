//! Event files, comparison and camera report of streams in memory.

use crate::arrays::{BorrowedColumns, EventColumns, columns, slice};
use crate::errors::Failure;
use crate::pool;
use crate::task::{run_borrowing, run_owning};
use evrig::camera_report::{FrameReference, FrameStarts, camera_report as report_on};
use evrig::commands::error_text;
use evrig::compare::{self, Setup};
use evrig::geometry::Size;
use evrig::report::{camera_report as words, session::measures, terminal};
use evrig::session::import::{EventTableOptions, read_recording};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use std::path::PathBuf;

/// What a user states about a table of events.
#[derive(FromPyObject, Default)]
#[pyo3(from_item_all)]
pub(crate) struct TableArguments {
    time_unit: Option<String>,
    columns: Option<String>,
    polarity: Option<String>,
    table: Option<String>,
    epoch: Option<String>,
    begin_us: Option<i64>,
}

/// A text that names a value, with the argument's name in the error.
pub(crate) fn parsed<T: std::str::FromStr>(
    name: &str,
    text: Option<&String>,
) -> Result<Option<T>, Failure>
where
    T::Err: std::fmt::Display,
{
    let read = |text: &String| {
        text.parse().map_err(|error| Failure::Argument(format!("{name}: `{text}`: {error}")))
    };
    text.map(read).transpose()
}

impl TableArguments {
    pub(crate) fn options(&self) -> Result<EventTableOptions, Failure> {
        Ok(EventTableOptions {
            time_unit: parsed("time_unit", self.time_unit.as_ref())?,
            columns: parsed("columns", self.columns.as_ref())?,
            polarity: parsed("polarity", self.polarity.as_ref())?,
            table: self.table.clone(),
            epoch: parsed("epoch", self.epoch.as_ref())?.unwrap_or_default(),
            begin_us: self.begin_us,
        })
    }
}

/// Width and height as the library's size.
pub(crate) fn size_of(size: Option<(u16, u16)>) -> Option<Size> {
    size.map(|(width, height)| Size::new(width, height))
}

/// Events of a file, its size, starts of its frames and their meaning, and notes of the reading.
type ReadEvents<'py> = (
    EventColumns<'py>,
    (u16, u16),
    Option<(Vec<i64>, &'static str)>,
    Vec<String>,
    Vec<(String, u64)>,
);

/// Reads the events of a file of any kind.
#[pyfunction]
pub(crate) fn read_events<'py>(
    py: Python<'py>,
    path: PathBuf,
    size: Option<(u16, u16)>,
    table: TableArguments,
) -> PyResult<ReadEvents<'py>> {
    let (size, options) = (size_of(size), table.options()?);
    let found = run_owning(py, None, move |_| Ok(read_recording(&path, size, &options)?))?;
    let starts = FrameStarts::of_frames(&found.frames);
    let starts = starts.map(|starts| (starts.starts_us, reference_name(starts.reference)));
    let losses = found.losses.into_iter().map(|loss| (loss.what, loss.count)).collect();
    let size = (found.size.width, found.size.height);
    Ok((columns(py, found.events), size, starts, found.decisions, losses))
}

pub(crate) const fn reference_name(reference: FrameReference) -> &'static str {
    match reference {
        FrameReference::ExposureStart => "exposure_start",
        FrameReference::FrameStamp => "frame_stamp",
        FrameReference::FoundPeriod => "found_period",
    }
}

/// What the events show of their camera: the report as JSON, and in words.
#[pyfunction]
pub(crate) fn camera_report<'py>(
    py: Python<'py>,
    events: BorrowedColumns<'py>,
    size: (u16, u16),
    frame_starts: Option<(Vec<i64>, String)>,
    name: String,
) -> PyResult<(String, String)> {
    let (events, size) = (slice("events", &events)?, Size::new(size.0, size.1));
    let starts = frame_starts.map(|(starts_us, reference)| {
        let is_exposure = reference == reference_name(FrameReference::ExposureStart);
        let reference =
            if is_exposure { FrameReference::ExposureStart } else { FrameReference::FrameStamp };
        FrameStarts::new(starts_us, reference)
    });
    run_borrowing(py, None, |_| {
        let report = report_on(events, size, starts.as_ref())
            .map_err(|error| Failure::argument("events", &error))?;
        Ok((json(&report)?, words::text(&name, &report)))
    })
}

/// A result as JSON.
pub(crate) fn json(value: &impl serde::Serialize) -> Result<String, Failure> {
    serde_json::to_string(value).map_err(|error| Failure::Internal(error_text(&error)))
}

/// How two streams are compared.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ComparisonArguments<'py> {
    size: (u16, u16),
    window_us: Option<[i64; 2]>,
    region: Option<PyReadonlyArray1<'py, bool>>,
    seed: u64,
    n_bootstrap: usize,
    name: String,
}

/// Compares two streams: the comparison as JSON, in words, and its four maps.
#[pyfunction]
pub(crate) fn compare_events<'py>(
    py: Python<'py>,
    real: BorrowedColumns<'py>,
    simulated: BorrowedColumns<'py>,
    arguments: ComparisonArguments<'py>,
) -> PyResult<ComparisonResult<'py>> {
    let (real, simulated) = (slice("real", &real)?, slice("simulated", &simulated)?);
    let region = arguments.region.as_ref().map(PyReadonlyArray1::as_slice).transpose();
    let region = region.map_err(|error| Failure::argument("region", &error))?;
    let overlap = || -> Option<[i64; 2]> {
        let first = (*real.t.first()?).max(*simulated.t.first()?);
        let last = (*real.t.last()?).min(*simulated.t.last()?);
        (first <= last).then_some([first, last + 1])
    };
    let window = arguments.window_us.or_else(overlap).ok_or_else(|| {
        Failure::Argument(
            "real, simulated: the streams do not overlap in time; expected a common window, give \
             window_us"
                .into(),
        )
    })?;
    let setup = Setup {
        size: Size::new(arguments.size.0, arguments.size.1),
        window,
        region,
        seed: arguments.seed,
        n_bootstrap: arguments.n_bootstrap,
        frames: None,
    };
    let comparison =
        run_borrowing(py, None, move |_| Ok(compare::compare(real, simulated, &setup)?))?;
    comparison_result(py, &arguments.name, comparison)
}

/// A comparison as JSON, in words, and its maps of real and simulated ON and OFF events.
pub(crate) type ComparisonResult<'py> = (String, String, [Bound<'py, PyArray1<u32>>; 4]);

pub(crate) fn comparison_result<'py>(
    py: Python<'py>,
    name: &str,
    comparison: compare::Comparison,
) -> PyResult<ComparisonResult<'py>> {
    let text = terminal::measures(&measures(name, &comparison));
    let value = json(&comparison)?;
    let compare::Maps { real_on, real_off, simulated_on, simulated_off, .. } = comparison.maps;
    let maps = [real_on, real_off, simulated_on, simulated_off].map(|map| map.into_pyarray(py));
    Ok((value, text, maps))
}

/// Checks that events are in ascending time and on the sensor; an error names the first that is not.
#[pyfunction]
pub(crate) fn check_events(
    name: &str,
    events: BorrowedColumns<'_>,
    size: Option<(u16, u16)>,
) -> PyResult<()> {
    let events = slice(name, &events)?;
    if let Some(index) = events.first_disorder() {
        let (t, before) = (events.t[index], events.t[index - 1]);
        let text = format!(
            "{name}: expected ascending times, got {t} us at index {index} after {before} us; sort \
             them with Events.sorted()"
        );
        return Err(Failure::Argument(text).into());
    }
    let Some(size) = size_of(size) else { return Ok(()) };
    if let Some(index) = events.first_outside(size) {
        let (x, y) = (events.x[index], events.y[index]);
        let text = format!(
            "{name}: expected pixels on the sensor of {size}, got ({x}, {y}) at index {index}"
        );
        return Err(Failure::Argument(text).into());
    }
    Ok(())
}

/// The events in ascending time; events of one microsecond keep their order.
#[pyfunction]
pub(crate) fn sorted_events<'py>(
    py: Python<'py>,
    events: BorrowedColumns<'py>,
) -> PyResult<EventColumns<'py>> {
    let events = slice("events", &events)?;
    let sorted = py.detach(|| {
        pool::run(|| {
            let mut own = events.to_events();
            own.sort_by_time();
            Ok(own)
        })
    });
    Ok(columns(py, sorted?))
}
