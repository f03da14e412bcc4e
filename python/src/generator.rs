//! Event generation from frames in memory: all at once, or frame by frame.

use crate::arrays::{EventColumns, FrameArray, FrameStack, columns};
use crate::errors::Failure;
use crate::pool;
use crate::task::run_borrowing;
use evrig::event::Events;
use evrig::frame::Luminance;
use evrig::generate::{
    FrameUpsampling, GenerateParameters, Generator as EventModel, Interpolator, RowShift, RowTimes,
    build,
};
use evrig::geometry::Size;
use evrig::pipeline::ModelChoice;
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};

/// A model's choice as Python states it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ChoiceArguments {
    model: Option<String>,
    preset: Option<String>,
    k: Option<Vec<f64>>,
    knobs: Vec<(String, f64)>,
    full_scale_dn: Option<f64>,
    law: Option<String>,
    seed: u64,
}

impl ChoiceArguments {
    /// The same as the command line has it. `"@calibrated"` for k is the preset `tuned`.
    pub(crate) fn choice(self) -> ModelChoice {
        let Self { model, preset, k, knobs, full_scale_dn, law, seed } = self;
        let k = k.map(|k| k.iter().map(f64::to_string).collect::<Vec<_>>().join(","));
        let knobs = knobs.into_iter().map(|(name, value)| format!("{name}={value}")).collect();
        ModelChoice { model, preset, k, knobs, full_scale_dn, law, seed }
    }

    pub(crate) fn parameters(self) -> Result<GenerateParameters, Failure> {
        Ok(self.choice().parameters()?)
    }
}

/// A model with the memory that it uses from frame to frame.
struct FrameRun {
    model: Box<dyn EventModel>,
    upsampling: FrameUpsampling,
    row_us: f64,
    shift: RowShift,
    frame: Luminance,
    made: Events,
}

impl FrameRun {
    fn new(
        parameters: &GenerateParameters,
        threads: Option<NonZeroUsize>,
        interpolate_us: Option<u32>,
        row_us: f64,
    ) -> Result<Self, Failure> {
        if !row_us.is_finite() {
            return Err(Failure::Argument(format!(
                "row_us: expected a finite number, got {row_us}"
            )));
        }
        let upsampling = match interpolate_us {
            Some(step_us) => FrameUpsampling::Pixels(Interpolator::new(step_us)?),
            None => FrameUpsampling::Nothing,
        };
        Ok(Self {
            model: build(parameters, threads)?,
            upsampling,
            row_us,
            shift: RowShift::default(),
            frame: Luminance { t_us: 0, size: Size::new(0, 0), values: Vec::new() },
            made: Events::new(),
        })
    }

    /// Appends the events since the frame before to `out`.
    fn push(
        &mut self,
        frames: FrameStack<'_>,
        i: usize,
        t_us: i64,
        size: Size,
        out: &mut Events,
    ) -> Result<(), Failure> {
        let Self { model, upsampling, row_us, shift, frame, made } = self;
        frames.read(i, frame);
        (frame.t_us, frame.size) = (t_us, size);
        let is_shifted = *row_us != 0.0;
        made.clear();
        let target = if is_shifted { &mut *made } else { &mut *out };
        match upsampling {
            FrameUpsampling::Nothing => model.push(frame, target)?,
            upsampling => {
                upsampling.push(frame.clone(), |frame| model.push(frame, target))?;
            }
        }
        if is_shifted {
            shift.push(RowTimes::about_middle(*row_us, size), size, t_us, made, out);
        }
        Ok(())
    }
}

/// Generates events frame by frame.
#[pyclass(frozen, module = "evrig._evrig")]
pub(crate) struct FrameGenerator {
    run: Mutex<(FrameRun, usize)>,
}

#[pymethods]
impl FrameGenerator {
    #[new]
    #[pyo3(signature = (choice, threads, interpolate_us, row_us))]
    fn new(
        choice: ChoiceArguments,
        threads: Option<NonZeroUsize>,
        interpolate_us: Option<u32>,
        row_us: f64,
    ) -> PyResult<Self> {
        let run = FrameRun::new(&choice.parameters()?, threads, interpolate_us, row_us)?;
        Ok(Self { run: Mutex::new((run, 0)) })
    }

    /// The events after the frame before, up to this one.
    fn push<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        t_us: i64,
    ) -> PyResult<EventColumns<'py>> {
        let array = FrameArray::take(frame, 2)?;
        let stack = array.stack()?;
        let (_, size) = stack.shape()?;
        let events = py.detach(|| {
            let mut run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
            let (run, n_before) = &mut *run;
            // A frame makes about as many events as the one before.
            let mut out = Events::with_capacity(*n_before + *n_before / 4);
            pool::run(|| run.push(stack, 0, t_us, size, &mut out))?;
            *n_before = out.len();
            Ok::<_, Failure>(out)
        });
        Ok(columns(py, events?))
    }

    /// The events that are held back until no row of a next frame can precede them.
    fn finish<'py>(&self, py: Python<'py>) -> EventColumns<'py> {
        let mut out = Events::new();
        let mut run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
        run.0.shift.finish(&mut out);
        columns(py, out)
    }
}

/// All events of an array of frames.
#[pyfunction]
#[pyo3(signature = (frames, t_us, choice, threads, interpolate_us, row_us, progress))]
#[expect(clippy::too_many_arguments, reason = "the keywords of the Python function")]
pub(crate) fn generate<'py>(
    py: Python<'py>,
    frames: &Bound<'py, PyAny>,
    t_us: PyReadonlyArray1<'py, i64>,
    choice: ChoiceArguments,
    threads: Option<NonZeroUsize>,
    interpolate_us: Option<u32>,
    row_us: f64,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<EventColumns<'py>> {
    let array = FrameArray::take(frames, 3)?;
    let stack = array.stack()?;
    let (_, size) = stack.shape()?;
    let times = times(&t_us)?;
    let mut run = FrameRun::new(&choice.parameters()?, threads, interpolate_us, row_us)?;
    let events = run_borrowing(py, progress, |link| {
        let mut out = Events::new();
        for (i, &t_us) in times.iter().enumerate() {
            run.push(stack, i, t_us, size, &mut out)?;
            link.report("generate", i as u64 + 1, times.len() as u64);
        }
        run.shift.finish(&mut out);
        Ok(out)
    })?;
    Ok(columns(py, events))
}

/// The times of frames, contiguous.
pub(crate) fn times<'a>(t_us: &'a PyReadonlyArray1<'_, i64>) -> Result<&'a [i64], Failure> {
    t_us.as_slice().map_err(|error| Failure::argument("t_us", &error))
}
