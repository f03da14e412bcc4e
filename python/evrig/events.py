"""Events as columns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Optional, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _evrig
from ._errors import ArgumentError

if TYPE_CHECKING:
    import pandas
    import xarray

Columns = Tuple[NDArray[np.int64], NDArray[np.uint16], NDArray[np.uint16], NDArray[np.bool_]]

#: The fields of a structured array of events.
DTYPE = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "?")])


@dataclass(frozen=True, eq=False)
class Events:
    """Events of one stream, a NumPy column each. All columns have the same length n.

    Events of the library own its memory, without copies. Columns of other types or strides are
    converted; columns of these types are taken as they are.

    Attributes:
        t: Time, µs of the stream's clock, int64, shape (n,).
        x: Pixel column from the left, uint16, shape (n,).
        y: Pixel row from the top, uint16, shape (n,).
        p: Polarity, bool, shape (n,): true for ON (brightness rose).
        size: Width and height of the sensor, pixels; None where unknown.
        frame_starts_us: When the camera of the file took frames, µs, int64; None where unknown.
        frame_reference: What a start is: ``exposure_start`` or ``frame_stamp``.
        notes: What had to be decided about the file, and what was lost.

    Raises:
        ArgumentError: Columns of different lengths, of other types, or outside their range.
    """

    t: NDArray[np.int64]
    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    p: NDArray[np.bool_]
    size: Optional[Tuple[int, int]] = None
    frame_starts_us: Optional[NDArray[np.int64]] = field(default=None, repr=False)
    frame_reference: Optional[str] = field(default=None, repr=False)
    notes: Tuple[str, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        columns = {
            "t": _arguments.times("t", self.t),
            "x": _arguments.integers("x", self.x, 0, 65535, np.uint16),
            "y": _arguments.integers("y", self.y, 0, 65535, np.uint16),
            "p": _arguments.polarity("p", self.p),
        }
        lengths = {name: len(column) for name, column in columns.items()}
        if len(set(lengths.values())) > 1:
            raise ArgumentError(f"events: expected columns of one length, got {lengths}")
        for name, column in columns.items():
            object.__setattr__(self, name, column)
        object.__setattr__(self, "size", _arguments.size(self.size))

    @classmethod
    def of(cls, events: object, name: str = "events", size: Optional[Tuple[int, int]] = None) -> Events:
        """Events of any form: :class:`Events`, a structured array or table with the columns t, x, y
        and p (or ``on``, ``polarity``), or an array of shape (n, 4) in that order.

        Raises:
            ArgumentError: It is none of these.
        """
        size = _arguments.size(size)
        if isinstance(events, Events):
            return events if size is None else replace(events, size=size)
        names: Tuple[str, ...] = ()
        if isinstance(events, np.ndarray):
            names = events.dtype.names or ()
            if not names and events.ndim == 2 and events.shape[1] == 4:
                return cls(events[:, 0], events[:, 1], events[:, 2], events[:, 3], size)
        elif hasattr(events, "columns"):
            names = tuple(str(column) for column in events.columns)
        third = next((name for name in ("p", "on", "polarity") if name in names), None)
        if third is not None and {"t", "x", "y"} <= set(names):
            table: Any = events
            t, x, y, p = (np.asarray(table[key]) for key in ("t", "x", "y", third))
            return cls(t, x, y, p, size)
        raise ArgumentError(
            f"{name}: expected Events, a table or structured array with t, x, y and p, or integers "
            f"of shape (n, 4), got {_arguments.describe(events)}"
        )

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, which: Union[slice, NDArray[Any]]) -> Events:
        """The events of a slice (without copies), a mask or an array of indices."""
        if isinstance(which, (int, np.integer)):
            raise ArgumentError(f"events: expected a slice, a mask or indices, got {which}")
        return Events(self.t[which], self.x[which], self.y[which], self.p[which], self.size)

    @property
    def columns(self) -> Columns:
        """t, x, y and p."""
        return self.t, self.x, self.y, self.p

    @property
    def n_on(self) -> int:
        """Number of ON events."""
        return int(np.count_nonzero(self.p))

    def between(self, start_us: int, end_us: int) -> Events:
        """The events with ``start_us <= t < end_us``, of events in ascending time."""
        start, end = np.searchsorted(self.t, (start_us, end_us))
        return self[int(start) : int(end)]

    def sorted(self) -> Events:
        """The events in ascending time; those of one microsecond keep their order."""
        t, x, y, p = _evrig.sorted_events(self.columns)
        return replace(self, t=t, x=x, y=y, p=p)

    def check(self, name: str = "events") -> Events:
        """These events, if they are in ascending time and on the sensor.

        Raises:
            ArgumentError: The first event that is not.
        """
        _evrig.check_events(name, self.columns, self.size)
        return self

    def image(self, signed: bool = False) -> NDArray[np.int64]:
        """Number of events of each pixel, int64, shape (height, width); with ``signed`` ON minus OFF.

        Raises:
            ArgumentError: The size of the sensor is not known.
        """
        width, height = self.sensor()
        pixel = self.y.astype(np.int64) * width + self.x
        counts = [
            np.bincount(pixel[mask], minlength=width * height)[: width * height]
            for mask in (self.p, ~self.p)
        ]
        image = counts[0] - counts[1] if signed else counts[0] + counts[1]
        return image.reshape(height, width).astype(np.int64)

    def sensor(self) -> Tuple[int, int]:
        """Width and height of the sensor.

        Raises:
            ArgumentError: They are not known.
        """
        if self.size is None:
            raise ArgumentError("size: expected (width, height) of the sensor, got None")
        return self.size

    def to_structured(self) -> NDArray[Any]:
        """A structured array of :data:`DTYPE`, shape (n,)."""
        array = np.empty(len(self), DTYPE)
        for name, column in zip("txyp", self.columns):
            array[name] = column
        return array

    def to_array(self) -> NDArray[np.int64]:
        """int64 of shape (n, 4): t (µs), x, y, and p as 1 and 0; the layout of ``evrig export``."""
        return np.stack([column.astype(np.int64) for column in self.columns], axis=1)

    def to_tonic(self) -> NDArray[Any]:
        """A structured array of integers x, y, t (µs), p, as the transforms of tonic take it."""
        array = np.empty(len(self), np.dtype([(name, "<i8") for name in "xytp"]))
        for name, column in zip("txyp", self.columns):
            array[name] = column
        return array

    def to_pandas(self) -> pandas.DataFrame:
        """A table with the columns t (µs), x, y and p."""
        import pandas

        return pandas.DataFrame(dict(zip("txyp", self.columns)), copy=False)

    def to_xarray(self) -> xarray.Dataset:
        """A dataset over the dimension ``event`` with t (µs), x, y and p, and the sensor's size."""
        import xarray

        data = {name: ("event", column) for name, column in zip("txyp", self.columns)}
        attributes = {} if self.size is None else dict(zip(("width", "height"), self.size))
        dataset = xarray.Dataset(data, attrs=attributes)
        dataset["t"].attrs["units"] = "us"
        return dataset

    def save(self, path: _arguments.PathLike) -> None:
        """Writes an ``.npz`` with ``events`` of :meth:`to_array` that :func:`evrig.read_events`
        reads."""
        with open(path, "wb") as file:
            np.savez(file, events=self.to_array())
