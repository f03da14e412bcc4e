"""Reading, importing and analysing recordings."""

from __future__ import annotations

import tempfile
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Iterator, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _evrig
from ._arguments import PathLike, Size
from ._errors import ArgumentError
from ._progress import Progress, shown
from ._records import read
from .calibration import Calibration
from .camera import CameraReport
from .comparison import Comparison, comparison_of
from .diagnosis import Diagnosis
from .events import Events
from .session import Session

Source = Union[Session, Events, PathLike, NDArray[Any]]


def _table(
    time_unit: Optional[str],
    columns: Optional[str],
    polarity: Optional[str],
    table: Optional[str],
    epoch: Union[None, int, str],
    begin_us: Optional[int] = None,
) -> Dict[str, Any]:
    return {
        "time_unit": time_unit,
        "columns": columns,
        "polarity": polarity,
        "table": table,
        "epoch": None if epoch is None else str(epoch),
        "begin_us": _arguments.whole("events_begin_us", begin_us, -(2**63), 2**63 - 1),
    }


def read_events(
    path: PathLike,
    *,
    size: Optional[Size] = None,
    time_unit: Optional[str] = None,
    columns: Optional[str] = None,
    polarity: Optional[str] = None,
    table: Optional[str] = None,
    epoch: Union[None, int, str] = None,
) -> Events:
    """The events of a file of any kind that evrig reads: AEDAT 2, 3.1 and 4, Prophesee ``.raw`` and
    ``.dat``, ROS bags, npy, npz, text, HDF5, Parquet (docs/how-to/import-recordings.md).

    Args:
        path: The file.
        size: Width and height of the sensor; by default what the file states, or the smallest grid
            of its events.
        time_unit: Unit of the times in a table: ``s``, ``ms``, ``us`` or ``ns``; by default stated
            by the file, or the only one that fits.
        columns: Order of the columns of a table, as ``txyp``.
        polarity: Values of ON and OFF in a table, as ``1,-1``.
        table: Which table, topic or stream of a file with several.
        epoch: Where the camera's clock restarted: ``longest`` (default), a number from 1, or ``all``.

    Returns:
        The events in ascending time; ``notes`` say what was decided and what was lost.

    Raises:
        FileError: The file holds no events, or is not what it should be.
        ArgumentError: An argument that cannot be read.
    """
    options = _table(time_unit, columns, polarity, table, epoch)
    found = _evrig.read_events(_arguments.path("path", path), _arguments.size(size), options)
    own_columns, own_size, starts, decisions, losses = found
    lost = [f"lost: {n} {what}" if n else f"lost: {what}" for what, n in losses]
    return Events(
        *own_columns,
        size=own_size,
        frame_starts_us=None if starts is None else np.array(starts[0], np.int64),
        frame_reference=None if starts is None else starts[1],
        notes=(*(f"decided: {decision}" for decision in decisions), *lost),
    )


def import_(
    path: PathLike,
    out: PathLike,
    *,
    fps: Optional[float] = None,
    timestamps: Optional[PathLike] = None,
    timestamps_unit: Optional[str] = None,
    events: Optional[PathLike] = None,
    events_name: str = "real",
    size: Optional[Size] = None,
    stride: Optional[int] = None,
    packing: Optional[str] = None,
    id: Optional[str] = None,
    timezone: str = "UTC",
    time_unit: Optional[str] = None,
    columns: Optional[str] = None,
    polarity: Optional[str] = None,
    table: Optional[str] = None,
    epoch: Union[None, int, str] = None,
    events_begin_us: Optional[int] = None,
    progress: Progress = None,
) -> Session:
    """Makes a session of a recording of other software; its kind is found out.

    Args:
        path: A recording, a table of events, an npy array of frames, a folder of images, or a folder
            of the Raw2Event recorder.
        out: Directory of the new session.
        fps: Frames per second, for frames without times.
        timestamps: A file with the time of each frame; ``names`` takes the numbers in their names.
        timestamps_unit: Unit of these times.
        events: A file of events on the frames' pixel grid and clock.
        events_name: ``real``, or any other name for simulated events.
        stride: Bytes of a row of raw frames with its padding.
        packing: Samples of raw frames: ``8``, ``raw10``, ``raw12`` or ``16``.
        id: Part of the files' names, for a folder of the Raw2Event recorder.
        timezone: Time zone of that recorder's clock.
        events_begin_us: Time of the first event on the frames' clock, µs.

    The other arguments are those of :func:`read_events`.

    Raises:
        FileError: A file is not what it should be, or ``out`` is taken.
        ArgumentError: An argument that cannot be read, or is missing for this kind of recording.
    """
    own = {
        "fps": _arguments.number("fps", fps),
        "timestamps": None if timestamps is None else _arguments.path("timestamps", timestamps),
        "timestamps_unit": timestamps_unit,
        "events": None if events is None else _arguments.path("events", events),
        "events_name": events_name,
        "size": _arguments.size(size),
        "stride": _arguments.whole("stride", stride, 1, 2**32 - 1),
        "packing": packing,
        "id": id,
        "timezone": timezone,
        "table": _table(time_unit, columns, polarity, table, epoch, events_begin_us),
    }
    target = _arguments.path("out", out)
    with shown(progress, "import") as report:
        _evrig.import_session(_arguments.path("path", path), target, own, report)
    return Session(target)


def create_session(
    out: PathLike,
    frames: NDArray[Any],
    t_us: Union[NDArray[np.int64], Sequence[int]],
    events: Optional[object] = None,
    *,
    events_name: str = "real",
) -> Session:
    """Makes a session of frames and events in memory.

    Args:
        out: Directory of the new session.
        frames: uint8 or uint16, shape (n, height, width).
        t_us: Time of each frame, µs, ascending, on the events' clock.
        events: Events on the same pixel grid, of any form that :meth:`evrig.Events.of` takes.
        events_name: ``real``, or any other name for simulated events.

    Raises:
        ArgumentError: Frames of another type or shape, or events that do not fit.
        FileError: ``out`` is taken.
    """
    if not isinstance(frames, np.ndarray) or frames.ndim != 3 or frames.dtype not in ("u1", "u2"):
        raise ArgumentError(
            "frames: expected an array (n, height, width) of uint8 or uint16, got "
            f"{_arguments.describe(frames)}"
        )
    times = _arguments.times("t_us", t_us, len(frames))
    with tempfile.TemporaryDirectory() as folder:
        frames_file, times_file = Path(folder, "frames.npy"), Path(folder, "t_us.npy")
        np.save(frames_file, np.ascontiguousarray(frames))
        np.save(times_file, times)
        events_file = None
        if events is not None:
            events_file = Path(folder, "events.npz")
            own = Events.of(events, size=(frames.shape[2], frames.shape[1])).check()
            own.save(events_file)
        return import_(
            frames_file, out, timestamps=times_file, timestamps_unit="us", events=events_file,
            events_name=events_name, time_unit=None if events is None else "us",
            columns=None if events is None else "txyp",
            polarity=None if events is None else "1,0", progress=False,
        )


def compare(
    real: object,
    simulated: object,
    *,
    size: Optional[Size] = None,
    window_us: Optional[Tuple[int, int]] = None,
    region: Optional[NDArray[np.bool_]] = None,
    seed: int = 0,
    bootstrap: int = 400,
) -> Comparison:
    """Compares simulated with real events on one pixel grid, each measure with its error.

    Args:
        real: The camera's events: :class:`Events`, a path, or any form of :meth:`Events.of`.
        simulated: The generator's events.
        size: Width and height of the grid; by default what the events state.
        window_us: Time to compare, µs, end exclusive; by default the overlap of the two.
        region: Pixels to compare, bool, shape (height, width); by default all.
        seed: Seed of the resampling.
        bootstrap: Resamplings behind each error; 0 for unknown errors.

    Raises:
        ArgumentError: A stream out of order or off the grid, or without overlap.

    See docs/reference/measures.md for definitions and sources.
    """
    ours, theirs = _events_of(real, "real", size), _events_of(simulated, "simulated", size)
    grid = _arguments.size(size) or ours.size or theirs.size
    if grid is None:
        raise ArgumentError("size: expected (width, height) of the sensor, got None")
    for name, events in (("real", ours), ("simulated", theirs)):
        if size is None and events.size not in (None, grid):
            raise ArgumentError(f"{name}: expected events on a grid of {grid}, got {events.size}")
    mask = None
    if region is not None:
        mask = np.asarray(region)
        if mask.dtype != np.bool_ or mask.shape != (grid[1], grid[0]):
            raise ArgumentError(
                f"region: expected bool of shape {(grid[1], grid[0])}, got {_arguments.describe(mask)}"
            )
        mask = np.ascontiguousarray(mask).reshape(-1)
    window = None
    if window_us is None:
        ours.check("real")
        theirs.check("simulated")
    else:
        start, end = _arguments.times("window_us", window_us, 2)
        window = [int(start), int(end)]
    arguments = {
        "size": grid,
        "window_us": window,
        "region": mask,
        "seed": _arguments.seed(seed),
        "n_bootstrap": _arguments.whole("bootstrap", bootstrap, 0, 10**6),
        "name": "simulated",
    }
    return comparison_of(_evrig.compare_events(ours.columns, theirs.columns, arguments), grid)


def _events_of(source: object, name: str, size: Optional[Size] = None) -> Events:
    if isinstance(source, (str, Path)):
        return read_events(source, size=size)
    return Events.of(source, name, size)


def camera_report(
    source: Source, *, size: Optional[Size] = None, stream: str = "real"
) -> CameraReport:
    """What events alone show of their camera: frame coupling, refractory periods, hot pixels, noise,
    flicker, readout. Takes seconds.

    Args:
        source: A session, its directory, a file of events, or events.
        size: Width and height of the sensor, where the source does not state them.
        stream: Which events of a session.

    Raises:
        ArgumentError: No events, events out of order or off the sensor, or an unknown size.
        FileError: The file holds no events.
    """
    if isinstance(source, (str, Path)) and Path(source, "session.json").exists():
        source = Session(source)
    starts: Optional[Tuple[Sequence[int], str]] = None
    if isinstance(source, Session):
        name = f"{source.name}, stream {stream}"
        events = source.events(stream)
        frames = source._handle.default_frames()
        starts = None if frames is None else source._handle.frame_starts(frames)
    else:
        name = Path(source).name if isinstance(source, (str, Path)) else "events"
        events = _events_of(source, "source", size)
        if events.frame_starts_us is not None and events.frame_reference is not None:
            starts = (events.frame_starts_us.tolist(), events.frame_reference)
    text, words = _evrig.camera_report(events.columns, events.sensor(), starts, name)
    return replace(read(CameraReport, text), text=words)


@contextmanager
def _session_of(
    session: Optional[Session], events: Optional[object], frames: Optional[NDArray[Any]], t_us: Any
) -> Iterator[Session]:
    """The session given, or one in a temporary directory of the events and frames given."""
    given = [value is not None for value in (events, frames, t_us)]
    if session is not None and not any(given):
        yield Session(session) if isinstance(session, (str, Path)) else session
        return
    if session is not None or not all(given) or frames is None:
        raise ArgumentError("session: expected a session, or events, frames and t_us, got a mixture")
    with tempfile.TemporaryDirectory() as folder:
        yield create_session(Path(folder, "session"), frames, t_us, events)


def calibrate(
    session: Optional[Session] = None,
    *,
    events: Optional[object] = None,
    frames: Optional[NDArray[Any]] = None,
    t_us: Union[None, NDArray[np.int64], Sequence[int]] = None,
    objective: str = "score",
    evaluations: int = 300,
    seed: int = 0,
) -> Calibration:
    """Fits the voltmeter's constants k1 to k6, each with its error, to recorded events.

    Args:
        session: A session or its directory; or instead
        events: recorded events,
        frames: frames on the same pixel grid, uint8 or uint16, shape (n, height, width),
        t_us: and the time of each, µs, on the events' clock.
        objective: ``score`` (predictive log score, nats per event) or ``emd``.
        evaluations: Evaluations of the search; 0 for none.

    Raises:
        AnalysisError: The events do not determine the constants.

    See docs/explanation/calibration.md for the estimators and their sources.
    """
    with _session_of(session, events, frames, t_us) as own:
        return own.calibrate(objective=objective, evaluations=evaluations, seed=seed)


def diagnose(
    session: Optional[Session] = None,
    *,
    events: Optional[object] = None,
    frames: Optional[NDArray[Any]] = None,
    t_us: Union[None, NDArray[np.int64], Sequence[int]] = None,
    baseline: Optional[str] = None,
    pixels: Optional[int] = None,
    seed: int = 0,
    progress: Progress = None,
) -> Diagnosis:
    """Finds physical effects that the model of a recording lacks; takes minutes.

    Args:
        session: A session or its directory; or instead
        events: recorded events,
        frames: frames on the same pixel grid, uint8 or uint16, shape (n, height, width),
        t_us: and the time of each, µs, on the events' clock.
        baseline: The signal between frames: ``motion`` (motion-compensated interpolation), ``frames``
            (linear), or ``scene``; by default the scene where there is one, else motion.
        pixels: Pixels to evaluate; 120 by default.
        progress: None: a bar in a terminal or in Jupyter; True, False; or a function.

    Raises:
        AnalysisError: There are too few events, or signal and events do not overlap.

    See docs/explanation/diagnosis.md for the method.
    """
    with _session_of(session, events, frames, t_us) as own:
        return own.diagnose(baseline=baseline, pixels=pixels, seed=seed, progress=progress)
