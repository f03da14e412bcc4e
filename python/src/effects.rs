//! Physical effects on frames in memory.

use crate::arrays::{EventColumns, FrameArray, FrameStack, columns};
use crate::errors::Failure;
use crate::generator::times;
use crate::task::run_borrowing;
use evrig::drive::Drive;
use evrig::effect_id::EffectId;
use evrig::frame::Luminance;
use evrig::generate::effect::{EffectSet, RecordingContext};
use evrig::generate::forward::{ForwardParameters, ForwardSimulator};
use evrig::generate::voltmeter::Coefficients;
use evrig::generate::{GenerateError, ModelParameters, Preset};
use evrig::geometry::Size;
use evrig::scene::FramesDrive;
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

/// What a simulation with effects is given beside its frames.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SimulationArguments {
    effects_json: String,
    preset: Option<String>,
    k: Option<[f64; 6]>,
    seed: u64,
    step_us: u32,
    row_us: f64,
    frame_starts_us: Vec<i64>,
}

impl SimulationArguments {
    fn coefficients(&self) -> Result<Coefficients, Failure> {
        if let Some(k) = self.k {
            return Ok(Coefficients::new(k)?);
        }
        let preset: Preset = match &self.preset {
            Some(name) => name.parse()?,
            None => Preset::Dvs346,
        };
        match preset.parameters() {
            ModelParameters::Voltmeter { k, .. } => Ok(k),
            other => Err(Failure::Argument(format!(
                "preset: expected one of the voltmeter, on which the effects act, got {preset} of \
                 {}",
                other.model()
            ))),
        }
    }
}

/// The events of frames whose camera has physical effects.
#[pyfunction]
pub(crate) fn simulate_effects<'py>(
    py: Python<'py>,
    frames: &Bound<'py, PyAny>,
    t_us: PyReadonlyArray1<'py, i64>,
    arguments: SimulationArguments,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<EventColumns<'py>> {
    let array = FrameArray::take(frames, 3)?;
    let stack = array.stack()?;
    let (_, size) = stack.shape()?;
    let t_us = times(&t_us)?;
    let effects: EffectSet = serde_json::from_str(&arguments.effects_json)
        .map_err(|error| Failure::argument("effects", &error))?;
    let parameters =
        ForwardParameters { k: arguments.coefficients()?, effects, step_us: arguments.step_us };
    let context = RecordingContext {
        aps_starts_us: arguments.frame_starts_us.clone(),
        frame_times_us: t_us.to_vec(),
    };
    let forward = ForwardSimulator::new(parameters, context).map_err(Failure::from)?;
    let events = run_borrowing(py, progress, |link| {
        link.report("signal", 0, 0);
        let frames = checked_frames(stack, t_us, size)?;
        let drive = FramesDrive::new(frames, 0.0, arguments.row_us)
            .map_err(|error| Failure::argument("frames", &error))?;
        let pixels: Vec<(u16, u16)> =
            (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y))).collect();
        link.report("simulate", 0, 0);
        let adjust = |_, _, _: &mut _| link.check();
        let made = forward.run_with(&drive, &pixels, drive.span_us(), arguments.seed, &adjust)?;
        Ok(made.events)
    })?;
    Ok(columns(py, events))
}

fn checked_frames(
    stack: FrameStack<'_>,
    t_us: &[i64],
    size: Size,
) -> Result<Vec<Luminance>, Failure> {
    let frame = |(i, &t_us): (usize, &i64)| {
        let mut frame = Luminance { t_us, size, values: Vec::with_capacity(size.n_pixels()) };
        stack.read(i, &mut frame);
        let is_bad = |value: &f32| !(0.0..=f32::MAX).contains(value);
        match frame.values.iter().position(is_bad) {
            None => Ok(frame),
            Some(at) => {
                let width = usize::from(size.width);
                let (x, y) = ((at % width) as u16, (at / width) as u16);
                let (index, value) = (i as u64, frame.values[at]);
                Err(GenerateError::BadBrightness { index, x, y, value }.into())
            }
        }
    };
    t_us.iter().enumerate().map(frame).collect()
}

/// Ids of all effects with the keys of their parameters.
#[pyfunction]
pub(crate) fn effect_library() -> Vec<(&'static str, Vec<&'static str>)> {
    EffectId::ALL.iter().map(|id| (id.as_str(), id.parameters().to_vec())).collect()
}
