//! Frames of a session as arrays, one after another.

use crate::errors::Failure;
use crate::pool;
use evrig::frame::{BayerOrder, Samples};
use evrig::session::{DavisFrames, PiCameraFrames, RecordedFrame, Session};
use evrig::time::{Clock, Davis, PiSensor};
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};

enum OpenedFrames {
    Davis(DavisFrames),
    Pi(PiCameraFrames),
}

/// A frame with the times of its camera's clock.
enum ClockedFrame {
    Davis(RecordedFrame<Davis>),
    Pi(RecordedFrame<PiSensor>),
}

/// An iterator over a stream's frames.
#[pyclass(frozen, module = "evrig._evrig")]
pub(crate) struct FrameReader {
    source: Mutex<OpenedFrames>,
}

/// A frame's samples and what is known of them.
type FrameTuple<'py> = (
    Bound<'py, PyAny>,
    i64,
    i64,
    Option<[i64; 2]>,
    i64,
    u8,
    Option<&'static str>,
    [f32; 4],
    Option<f64>,
);

impl FrameReader {
    pub(crate) fn open(session: &Session, name: &str) -> Result<Self, Failure> {
        let source = if session.is_from_pi(name)? {
            OpenedFrames::Pi(session.pi_frames(name)?)
        } else {
            OpenedFrames::Davis(session.davis_frames(name)?)
        };
        Ok(Self { source: Mutex::new(source) })
    }

    fn next(&self) -> Result<Option<ClockedFrame>, Failure> {
        let mut source = self.source.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(match &mut *source {
            OpenedFrames::Davis(frames) => frames.next().transpose()?.map(ClockedFrame::Davis),
            OpenedFrames::Pi(frames) => frames.next().transpose()?.map(ClockedFrame::Pi),
        })
    }
}

#[pymethods]
impl FrameReader {
    const fn __iter__(own: PyRef<'_, Self>) -> PyRef<'_, Self> {
        own
    }

    /// Samples; mid-exposure of row 0 (µs), stamp (ns), exposure (ns), row time (ns); bits, mosaic,
    /// black levels, gain.
    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<FrameTuple<'py>>> {
        Ok(match py.detach(|| pool::run(|| self.next()))? {
            None => None,
            Some(ClockedFrame::Davis(frame)) => Some(parts(py, frame)?),
            Some(ClockedFrame::Pi(frame)) => Some(parts(py, frame)?),
        })
    }
}

fn parts<C: Clock>(py: Python<'_>, frame: RecordedFrame<C>) -> PyResult<FrameTuple<'_>> {
    let RecordedFrame { frame, properties, .. } = frame;
    let (height, width) = (usize::from(frame.size.height), usize::from(frame.size.width));
    let shape = match frame.channels.count() {
        1 => vec![height, width],
        n => vec![height, width, n],
    };
    let timing = frame.timing;
    let samples = match frame.samples {
        Samples::U8(samples) => samples.into_pyarray(py).reshape(shape)?.into_any(),
        Samples::U16(samples) => samples.into_pyarray(py).reshape(shape)?.into_any(),
    };
    let exposure = timing.exposure.map(|ends| ends.map(|end| end.as_nanos()));
    Ok((
        samples,
        timing.mid_exposure(0).as_micros(),
        timing.stamp.as_nanos(),
        exposure,
        timing.row_time.as_nanos(),
        properties.bits,
        properties.bayer.map(mosaic),
        properties.black_dn,
        properties.gain,
    ))
}

const fn mosaic(order: BayerOrder) -> &'static str {
    match order {
        BayerOrder::Rggb => "rggb",
        BayerOrder::Bggr => "bggr",
        BayerOrder::Grbg => "grbg",
        BayerOrder::Gbrg => "gbrg",
    }
}
