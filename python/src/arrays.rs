//! NumPy arrays as the library's values and back, without copies of event columns.

use crate::errors::Failure;
use evrig::event::{EventSlice, Events};
use evrig::frame::Luminance;
use evrig::geometry::Size;
use numpy::ndarray::{ArrayView2, ArrayView3, Axis, Ix3};
use numpy::{
    IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArrayDyn,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

/// Columns t, x, y, p whose memory is the library's.
pub(crate) type EventColumns<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<u16>>,
    Bound<'py, PyArray1<u16>>,
    Bound<'py, PyArray1<bool>>,
);

/// Gives the events' memory to NumPy.
pub(crate) fn columns(py: Python<'_>, events: Events) -> EventColumns<'_> {
    let (t, x, y, on) = events.into_columns();
    (t.into_pyarray(py), x.into_pyarray(py), y.into_pyarray(py), on.into_pyarray(py))
}

/// Borrowed columns of one event stream; the Python layer has checked types, lengths and values.
pub(crate) type BorrowedColumns<'py> = (
    PyReadonlyArray1<'py, i64>,
    PyReadonlyArray1<'py, u16>,
    PyReadonlyArray1<'py, u16>,
    PyReadonlyArray1<'py, bool>,
);

/// The events of borrowed columns.
pub(crate) fn slice<'a>(
    name: &str,
    (t, x, y, on): &'a BorrowedColumns<'_>,
) -> Result<EventSlice<'a>, Failure> {
    let wrong = |error: numpy::AsSliceError| Failure::argument(name, &error);
    Ok(EventSlice {
        t: t.as_slice().map_err(wrong)?,
        x: x.as_slice().map_err(wrong)?,
        y: y.as_slice().map_err(wrong)?,
        on: on.as_slice().map_err(wrong)?,
    })
}

/// Frames in an array of Python, n x height x width, of any strides.
pub(crate) enum FrameArray<'py> {
    U8(PyReadonlyArrayDyn<'py, u8>),
    U16(PyReadonlyArrayDyn<'py, u16>),
    F32(PyReadonlyArrayDyn<'py, f32>),
    F64(PyReadonlyArrayDyn<'py, f64>),
}

/// The frames of a [`FrameArray`] for any thread.
#[derive(Clone, Copy)]
pub(crate) enum FrameStack<'a> {
    U8(ArrayView3<'a, u8>),
    U16(ArrayView3<'a, u16>),
    F32(ArrayView3<'a, f32>),
    F64(ArrayView3<'a, f64>),
}

impl<'py> FrameArray<'py> {
    /// Takes an array of one of the four types with `n_dimensions`.
    pub(crate) fn take(object: &Bound<'py, PyAny>, n_dimensions: usize) -> Result<Self, Failure> {
        let array = object.cast::<PyUntypedArray>().ok();
        let fits = array.is_some_and(|array| array.ndim() == n_dimensions);
        let taken = fits.then(|| {
            let own = object.cast::<PyArrayDyn<u8>>().ok().map(|a| Self::U8(a.readonly()));
            own.or_else(|| object.cast::<PyArrayDyn<u16>>().ok().map(|a| Self::U16(a.readonly())))
                .or_else(|| object.cast::<PyArrayDyn<f32>>().ok().map(|a| Self::F32(a.readonly())))
                .or_else(|| object.cast::<PyArrayDyn<f64>>().ok().map(|a| Self::F64(a.readonly())))
        });
        taken.flatten().ok_or_else(|| {
            let (name, shape) = match n_dimensions {
                2 => ("frame", "(height, width)"),
                _ => ("frames", "(n, height, width)"),
            };
            let got = array.map_or_else(
                || object.get_type().to_string(),
                |array| format!("{} of shape {:?}", array.dtype(), array.shape()),
            );
            Failure::Argument(format!(
                "{name}: expected an array {shape} of uint8, uint16, float32 or float64, got {got}"
            ))
        })
    }

    /// Its frames; a single one where the array has two dimensions.
    pub(crate) fn stack(&self) -> Result<FrameStack<'_>, Failure> {
        fn view<'a, T: numpy::Element>(
            array: &'a PyReadonlyArrayDyn<'_, T>,
        ) -> Result<ArrayView3<'a, T>, Failure> {
            let view = array.as_array();
            let view = if view.ndim() == 2 { view.insert_axis(Axis(0)) } else { view };
            view.into_dimensionality::<Ix3>().map_err(|error| Failure::argument("frames", &error))
        }
        Ok(match self {
            Self::U8(array) => FrameStack::U8(view(array)?),
            Self::U16(array) => FrameStack::U16(view(array)?),
            Self::F32(array) => FrameStack::F32(view(array)?),
            Self::F64(array) => FrameStack::F64(view(array)?),
        })
    }
}

impl FrameStack<'_> {
    /// Number of frames, and their size.
    pub(crate) fn shape(&self) -> Result<(usize, Size), Failure> {
        let (n, height, width) = match self {
            Self::U8(view) => view.dim(),
            Self::U16(view) => view.dim(),
            Self::F32(view) => view.dim(),
            Self::F64(view) => view.dim(),
        };
        match (u16::try_from(width), u16::try_from(height)) {
            (Ok(width @ 1..), Ok(height @ 1..)) => Ok((n, Size::new(width, height))),
            _ => Err(Failure::Argument(format!(
                "frames: expected 1 to 65535 rows and columns, got {height} x {width}"
            ))),
        }
    }

    /// Writes frame `i` into `frame`, whose memory is used again.
    pub(crate) fn read(&self, i: usize, frame: &mut Luminance) {
        let values = &mut frame.values;
        values.clear();
        match self {
            Self::U8(view) => convert(view.index_axis(Axis(0), i), values, |v| f32::from(*v)),
            Self::U16(view) => convert(view.index_axis(Axis(0), i), values, |v| f32::from(*v)),
            Self::F32(view) => convert(view.index_axis(Axis(0), i), values, |v| *v),
            Self::F64(view) => convert(view.index_axis(Axis(0), i), values, |v| *v as f32),
        }
    }
}

/// Row by row, as cameras pad rows.
fn convert<T>(view: ArrayView2<'_, T>, values: &mut Vec<f32>, to_f32: impl Fn(&T) -> f32 + Copy) {
    for row in view.rows() {
        match row.as_slice() {
            Some(row) => values.extend(row.iter().map(to_f32)),
            None => values.extend(row.iter().map(to_f32)),
        }
    }
}
