"""Frames of a session."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Iterator, Optional, Tuple

import numpy as np
from numpy.typing import NDArray

from ._errors import SessionError

if TYPE_CHECKING:
    import xarray

    from . import _evrig


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame.

    Attributes:
        image: Samples, uint8 or uint16, shape (height, width), or (height, width, 3) in blue,
            green, red.
        t_us: Middle of the first row's exposure, µs of the camera's clock.
        stamp_ns: The camera's own stamp, ns.
        exposure_ns: Start and end of the first row's exposure, ns; None where not stated.
        row_ns: Delay from row to row, ns; 0 for a global shutter.
        bits: Bits of a sample that are used.
        mosaic: Order of the colours, as ``rggb``; None for grey and colour frames.
        black_dn: Black levels of R, green by R, green by B and B.
        gain: Analogue times digital gain; None where not stated.
    """

    image: NDArray[Any]
    t_us: int
    stamp_ns: int
    exposure_ns: Optional[Tuple[int, int]]
    row_ns: int
    bits: int
    mosaic: Optional[str]
    black_dn: Tuple[float, float, float, float]
    gain: Optional[float]


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a stream in memory.

    Attributes:
        images: Shape (n, height, width) or (n, height, width, 3).
        t_us: Middle of the first row's exposure, µs of the camera's clock, int64, shape (n,).
        stamp_ns: The camera's own stamps, ns, int64.
        exposure_ns: Start and end of the exposures, ns, int64, shape (n, 2); None where not stated.
        row_us: Delay from row to row, µs.
        bits: Bits of a sample that are used.
        mosaic: Order of the colours; None for grey and colour frames.
        clock: ``davis``, or ``pi-sensor`` for the Pi's.
    """

    images: NDArray[Any] = field(repr=False)
    t_us: NDArray[np.int64] = field(repr=False)
    stamp_ns: NDArray[np.int64] = field(repr=False)
    exposure_ns: Optional[NDArray[np.int64]] = field(repr=False)
    row_us: float
    bits: int
    mosaic: Optional[str]
    clock: str

    def __len__(self) -> int:
        return len(self.images)

    def to_xarray(self) -> xarray.DataArray:
        """The images over ``t_us``, y and x (and channel)."""
        import xarray

        names = ("t_us", "y", "x", "channel")[: self.images.ndim]
        return xarray.DataArray(self.images, dims=names, coords={"t_us": self.t_us})


def frames_of(reader: _evrig.FrameReader) -> Iterator[Frame]:
    """The frames of the library's reader."""
    for parts in reader:
        yield Frame(*parts)


def gathered(frames: Iterator[Frame], n: int, name: str, clock: str) -> Frames:
    """All frames in one array."""
    images: Optional[NDArray[Any]] = None
    t_us, stamps = np.empty(n, np.int64), np.empty(n, np.int64)
    exposures = np.empty((n, 2), np.int64)
    has_exposures, count = True, 0
    first: Optional[Frame] = None
    for frame in frames:
        if images is None or first is None:
            first, images = frame, np.empty((n, *frame.image.shape), frame.image.dtype)
        if frame.image.shape != images.shape[1:]:
            raise SessionError(
                f"frames of `{name}` change their shape from {images.shape[1:]} to "
                f"{frame.image.shape}; read them one by one with Session.iter_frames"
            )
        images[count], t_us[count], stamps[count] = frame.image, frame.t_us, frame.stamp_ns
        has_exposures = has_exposures and frame.exposure_ns is not None
        exposures[count] = frame.exposure_ns or (0, 0)
        count += 1
    if images is None or first is None:
        raise SessionError(f"stream `{name}` has no frames that can be read")
    return Frames(
        images=images[:count],
        t_us=t_us[:count],
        stamp_ns=stamps[:count],
        exposure_ns=exposures[:count] if has_exposures else None,
        row_us=first.row_ns / 1e3,
        bits=first.bits,
        mosaic=first.mosaic,
        clock=clock,
    )
