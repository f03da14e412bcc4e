"""Arguments as the library takes them; an error names the argument, what was expected and got."""

from __future__ import annotations

import os
from typing import Any, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from ._errors import ArgumentError

Size = Tuple[int, int]
PathLike = Union[str, "os.PathLike[str]"]


def describe(value: object) -> str:
    """A value's type, and the shape of an array."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} of shape {value.shape}"
    return f"{type(value).__name__} {value!r}" if np.isscalar(value) else type(value).__name__


def integers(name: str, values: object, low: int, high: int, kind: Any) -> NDArray[Any]:
    """A contiguous column of integers of one type; copied only where its type or strides differ."""
    array = np.asarray(values)
    if array.size == 0 and array.ndim == 1:
        return np.empty(0, kind)
    if array.ndim != 1 or array.dtype.kind not in "iu":
        hint = ""
        if array.ndim == 1 and array.dtype.kind == "f":
            hint = "; round and convert them, as in np.rint(values).astype(np.int64)"
        raise ArgumentError(f"{name}: expected a column of integers, got {describe(array)}{hint}")
    if array.dtype != kind:
        smallest, largest = int(array.min()), int(array.max())
        if smallest < low or largest > high:
            raise ArgumentError(
                f"{name}: expected integers from {low} to {high}, got {smallest} to {largest}"
            )
    return np.ascontiguousarray(array, dtype=kind)


def times(name: str, values: object, n: Optional[int] = None) -> NDArray[np.int64]:
    """Times in microseconds, as many as ``n``."""
    column = integers(name, values, -(2**63), 2**63 - 1, np.int64)
    if n is not None and len(column) != n:
        raise ArgumentError(f"{name}: expected {n} times, one for each frame, got {len(column)}")
    return column


def polarity(name: str, values: object) -> NDArray[np.bool_]:
    """Polarities as booleans: true and false, 1 and 0, or 1 and -1."""
    array = np.asarray(values)
    if array.ndim != 1 or (array.dtype.kind not in "biu" and array.size > 0):
        raise ArgumentError(
            f"{name}: expected a column of booleans or of 1 and 0 or -1, got {describe(array)}"
        )
    if array.dtype == np.bool_:
        column = np.ascontiguousarray(array)
        # A view of bytes as booleans may hold other values than 0 and 1.
        if column.size and int(column.view(np.uint8).max()) > 1:
            raise ArgumentError(f"{name}: expected booleans, got bytes other than 0 and 1")
        return column
    if array.size and not np.isin(array, (-1, 0, 1)).all():
        found = np.unique(array)[:4].tolist()
        raise ArgumentError(f"{name}: expected polarities of 1 for ON and 0 or -1 for OFF, got {found}")
    return np.asarray(array > 0)


def size(value: Optional[Sequence[int]], name: str = "size") -> Optional[Size]:
    """Width and height."""
    if value is None:
        return None
    sides = [int(side) for side in value] if np.ndim(value) == 1 else []
    if len(sides) != 2 or not all(0 < side <= 65535 for side in sides):
        raise ArgumentError(f"{name}: expected (width, height), as (346, 260), got {value!r}")
    return sides[0], sides[1]


def seed(value: int) -> int:
    """A seed of 64 bits."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 0 <= value < 2**64:
        raise ArgumentError(f"seed: expected an integer from 0 to 2**64 - 1, got {describe(value)}")
    return int(value)


def path(name: str, value: object) -> str:
    """A path of the file system."""
    if not isinstance(value, (str, os.PathLike)):
        raise ArgumentError(f"{name}: expected a path, got {describe(value)}")
    return os.fspath(value) if isinstance(value, str) else str(os.fspath(value))


def whole(name: str, value: Optional[int], low: int, high: int) -> Optional[int]:
    """An integer within a range, or None."""
    if value is None:
        return None
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not low <= value <= high:
        raise ArgumentError(
            f"{name}: expected an integer from {low} to {high}, got {describe(value)}"
        )
    return int(value)


def number(name: str, value: Optional[float]) -> Optional[float]:
    """A finite number, or None."""
    if value is None:
        return None
    if not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
        raise ArgumentError(f"{name}: expected a finite number, got {describe(value)}")
    return float(value)
