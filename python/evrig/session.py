"""Sessions: one recording is one directory."""

from __future__ import annotations

import json
import os
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _evrig
from ._arguments import PathLike
from ._errors import SessionError
from ._progress import Progress, shown
from ._records import Record, load, read
from .calibration import Calibration
from .comparison import Comparison, comparison_of
from .diagnosis import Diagnosis
from .events import Events
from .frames import Frame, Frames, frames_of, gathered
from .generation import Effects, choice, effects_json

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Stream(Record):
    """A recorded or imported stream.

    Attributes:
        name: Its name.
        kind: ``events``, ``frames``, ``imu``, ``triggers``, ``poses``, ``metadata``,
            ``clock_readings`` or ``log``.
        file: Its file, inside the session.
        count: Number of events, frames or samples that can be read.
        first_us: First stamp, µs of its clock.
        last_us: Last stamp, µs of its clock.
        source: The camera or program that made it.
        size: ``width`` and ``height``, for events and frames.
        clock: The clock that orders it in its file: ``davis``, ``pi-sensor`` or ``unix``.
    """

    name: str
    kind: str
    file: str
    count: int
    first_us: Optional[int]
    last_us: Optional[int]
    source: str
    stream_id: Optional[int] = None
    size: Optional[Dict[str, int]] = None
    clock: str = "davis"


@dataclass(frozen=True)
class Loss(Record):
    """Something that was lost, dropped or is doubtful; the count is 0 where it is unknown."""

    stream: str
    what: str
    count: int


@dataclass(frozen=True)
class ClockMap(Record):
    """The map from the Pi's sensor clock to the events' clock.

    Attributes:
        method: How it was found.
        segments: Pieces of time, each with one linear map and its error, as in ``clock.json``
            (docs/explanation/clock-synchronization.md).
    """

    method: str
    segments: List[Dict[str, Any]]
    session: Session = field(repr=False, compare=False)

    def map(self, sensor_ns: Union[int, Sequence[int], NDArray[np.int64]]) -> Tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Stamps of the sensor clock (ns) on the events' clock (ns), shape (n,), and the ends of the
        95 % interval of truth minus map (ns), shape (n, 2); NaN where an end is unknown."""
        column = _arguments.times("sensor_ns", np.atleast_1d(np.asarray(sensor_ns)))
        found = self.session._handle.davis_from_sensor(column)
        if found is None:
            raise SessionError(f"{self.session.path} holds no clock map any more; run process()")
        return found


@dataclass(frozen=True, eq=False)
class Track:
    """The path of the tag through a camera's frames, a row per detection.

    Attributes:
        clock: ``davis``, or ``pi-sensor``.
        tag: Family and number of the tag.
        t_ns: Times, ns of that clock, int64, shape (n,).
        polygon: Corners of the target image in pixels: bottom left, bottom right, top right, top
            left, shape (n, 4, 2).
        polygon_error: Their standard errors along x and y, shape (n, 4, 2).
        angle_deg: Direction of the bottom edge, clockwise, shape (n,).
        angle_error_deg: Its standard error.
        homography: From mm on the target to pixels of an ideal lens, shape (n, 3, 3).
    """

    clock: str
    tag: str
    t_ns: NDArray[np.int64] = field(repr=False)
    polygon: NDArray[np.float64] = field(repr=False)
    polygon_error: NDArray[np.float64] = field(repr=False)
    angle_deg: NDArray[np.float64] = field(repr=False)
    angle_error_deg: NDArray[np.float64] = field(repr=False)
    homography: NDArray[np.float64] = field(repr=False)

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the arm's tool in its base frame.

    Attributes:
        t_ns: Unix time of the host, ns, int64, shape (n,).
        x_mm: Forwards from the base.
        y_mm: To the left.
        z_mm: Up from the shoulder axis.
        r_deg: Attitude about z, anticlockwise seen from above.
    """

    t_ns: NDArray[np.int64] = field(repr=False)
    x_mm: NDArray[np.float64] = field(repr=False)
    y_mm: NDArray[np.float64] = field(repr=False)
    z_mm: NDArray[np.float64] = field(repr=False)
    r_deg: NDArray[np.float64] = field(repr=False)

    def __len__(self) -> int:
        return len(self.t_ns)

    def to_pandas(self) -> pandas.DataFrame:
        """A row per pose."""
        import pandas

        names = ("t_ns", "x_mm", "y_mm", "z_mm", "r_deg")
        return pandas.DataFrame({name: getattr(self, name) for name in names})


@dataclass(frozen=True)
class Processed(Record):
    """The stages that were run, and those that were left out, each with the reason."""

    stages: List[str]
    left_out: List[Tuple[str, str]]


class Session:
    """A session, opened for reading. Stages write their results into it, beside the recorded files.

    Args:
        path: Its directory.

    Raises:
        SessionError: It is not a session.
    """

    def __init__(self, path: PathLike) -> None:
        self._handle = _evrig.SessionHandle(_arguments.path("path", path))
        self.path = Path(path)
        #: The manifest ``session.json`` as plain values.
        self.manifest: Dict[str, Any] = json.loads(self._handle.manifest())

    def __repr__(self) -> str:
        streams = ", ".join(f"{s.name} {s.count} {s.kind}" for s in self.streams)
        return f"Session({str(self.path)!r}: {streams})"

    @property
    def name(self) -> str:
        """Its name."""
        return str(self.manifest["name"])

    @property
    def streams(self) -> List[Stream]:
        """The recorded and imported streams."""
        return [load(Stream, stream) for stream in self.manifest["streams"]]

    @property
    def losses(self) -> List[Loss]:
        """What was lost, dropped or is doubtful."""
        return [load(Loss, loss) for loss in self.manifest["losses"]]

    @property
    def generated(self) -> List[str]:
        """Names of the event streams that generators made here."""
        return self._handle.generated()

    @property
    def size(self) -> Optional[Tuple[int, int]]:
        """Width and height of the event camera, pixels."""
        return self._handle.size()

    def events(self, name: str = "real") -> Events:
        """The events of a recorded, imported or generated stream, in ascending time.

        Raises:
            SessionError: There is no such stream.
        """
        columns, n_outside = self._handle.events(name)
        notes = (f"left out: {n_outside} events off the sensor",) if n_outside else ()
        stream = next((s for s in self.streams if s.name == name and s.kind == "events"), None)
        size = self.size
        if stream is not None and stream.size is not None:
            size = (stream.size["width"], stream.size["height"])
        return Events(*columns, size=size, notes=notes)

    def iter_frames(self, name: Optional[str] = None) -> Iterator[Frame]:
        """The frames of a stream, one after another; by default those that events are generated from.

        Raises:
            SessionError: There is no such stream.
        """
        return frames_of(self._handle.frames(self._frames_name(name)))

    def frames(self, name: Optional[str] = None) -> Frames:
        """The frames of a stream in memory.

        Raises:
            SessionError: There is no such stream, or its frames change their shape.
        """
        name = self._frames_name(name)
        stream = next((s for s in self.streams if s.name == name and s.kind == "frames"), None)
        n = 0 if stream is None else stream.count
        return gathered(self.iter_frames(name), n, name, self._handle.frames_clock(name))

    def poses(self, commanded: bool = False) -> Poses:
        """Poses that the arm reported, or those that the trajectory commanded."""
        t_ns, rows = self._handle.poses(commanded)
        return Poses(t_ns, *np.ascontiguousarray(rows.T))

    def clock_map(self) -> Optional[ClockMap]:
        """The map from the Pi's sensor clock to the events' clock; None before the stage ``sync``."""
        text = self._handle.clocks()
        if text is None:
            return None
        clock = json.loads(text)["davis_from_sensor"]
        return ClockMap(clock["method"], clock["segments"], self)

    def clocks(self) -> Optional[Dict[str, Any]]:
        """All clock maps with their errors as plain values, as in ``derived/sync/clock.json``."""
        text = self._handle.clocks()
        return None if text is None else json.loads(text)

    def track(self, name: Optional[str] = None) -> Optional[Track]:
        """The track of a frame stream; None before the stage ``track``."""
        found = self._handle.track(self._frames_name(name))
        if found is None:
            return None
        clock, tag, t_ns, rows = found
        return Track(
            clock=clock,
            tag=tag,
            t_ns=t_ns,
            polygon=rows[:, :8].reshape(-1, 4, 2),
            polygon_error=rows[:, 8:16].reshape(-1, 4, 2),
            angle_deg=rows[:, 16],
            angle_error_deg=rows[:, 17],
            homography=rows[:, 18:].reshape(-1, 3, 3),
        )

    def comparison(self, name: str) -> Optional[Comparison]:
        """The stored comparison of a simulated stream; None before the stage ``compare``."""
        found = self._handle.comparison(name)
        return None if found is None else comparison_of(found, self.size)

    def diagnosis(self) -> Optional[Diagnosis]:
        """The stored diagnosis; None before the stage ``diagnose``."""
        text = self._handle.diagnosis()
        return None if text is None else read(Diagnosis, text)

    def calibration(self, frames: Optional[str] = None) -> Optional[Calibration]:
        """The stored calibration on a signal; None before the stage ``calibrate``."""
        text = self._handle.calibration(self._frames_name(frames))
        return None if text is None else read(Calibration, text)

    def generate(
        self,
        name: Optional[str] = None,
        *,
        frames: Optional[str] = None,
        model: Optional[str] = None,
        preset: Optional[str] = None,
        k: Union[None, str, Sequence[float]] = None,
        knobs: Optional[Mapping[str, float]] = None,
        full_scale_dn: Optional[float] = None,
        law: Optional[str] = None,
        seed: int = 0,
        effects: Union[None, Effects, Iterable[str]] = None,
        interpolate_us: Optional[int] = None,
        in_plane: bool = False,
        colour: Optional[str] = None,
        subtract_black: bool = False,
        divide_exposure: bool = False,
        force: bool = False,
        progress: Progress = None,
    ) -> Events:
        """Generates an event stream from frames of the session and keeps it there.

        Args:
            name: Name of the new stream; by default that of the frames.
            frames: Name of the frames, or ``scene``; by default those of the event camera.
            k: k1 to k6, or ``"@calibrated"`` for the session's own.
            effects: As for :func:`evrig.simulate_effects`.
            interpolate_us: Longest interval between frames after interpolation, µs.
            in_plane: Interpolate along the motion of the target; needs its track.
            colour: ``mosaic``, ``luma``, ``red``, ``green`` or ``blue``, of raw frames.
            subtract_black: Subtract the stated black level.
            divide_exposure: Divide by exposure time and gain.
            force: Run even when the result is there.

        The other arguments are those of :class:`evrig.Generator`.

        Raises:
            ArgumentError: An unknown name or a value out of its range.
            SessionError: The session lacks frames, a track or a calibration.
        """
        frames = self._frames_name(frames)
        name = frames if name is None else name
        if isinstance(k, str) and k.lower() == "@calibrated":
            preset, k = "tuned", None
        chosen = choice(model, preset, k, knobs, full_scale_dn, law, seed)  # type: ignore[arg-type]
        doubt = self._handle.doubt(chosen, frames)
        if doubt is not None:
            warnings.warn(doubt, stacklevel=2)
        conditions = {
            "name": name,
            "frames": frames,
            "effects_json": effects_json(effects),
            "interpolate_us": _arguments.whole("interpolate_us", interpolate_us, 1, 2**32 - 1),
            "in_plane": bool(in_plane),
            "colour": colour,
            "subtract_black": bool(subtract_black),
            "divide_exposure": bool(divide_exposure),
            "force": bool(force),
        }
        with shown(progress, "generate") as report:
            self._handle.generate(chosen, conditions, report)
        return self.events(name)

    def generate_diagnosed(
        self,
        name: str = "diagnosed",
        *,
        camera: Optional[PathLike] = None,
        seed: int = 0,
        force: bool = False,
    ) -> Events:
        """Generates events with the camera that a diagnosis found: of this session, or the
        ``camera.json`` of another.

        Returns:
            The events; ``notes`` hold why they differ from those of the real camera.

        Raises:
            SessionError: There is no diagnosed camera, or no signal for it.
        """
        path = None if camera is None else _arguments.path("camera", camera)
        _, notes = self._handle.generate_diagnosed(path, name, _arguments.seed(seed), force)
        events = self.events(name)
        return Events(*events.columns, size=events.size, notes=(*events.notes, *notes))

    def compare(
        self, name: str, *, real: str = "real", seed: int = 0, force: bool = False
    ) -> Comparison:
        """Compares a simulated stream with the recorded one.

        Raises:
            SessionError: A stream is missing, or the two do not overlap in time.
        """
        found = self._handle.compare(name, real, _arguments.seed(seed), force)
        return comparison_of(found, self.size)

    def calibrate(
        self,
        frames: Optional[str] = None,
        *,
        real: str = "real",
        objective: str = "score",
        evaluations: int = 300,
        seed: int = 0,
        force: bool = False,
    ) -> Calibration:
        """Fits the voltmeter's constants k1 to k6 to the recorded events.

        Args:
            frames: Name of the frames, or ``scene``.
            real: Name of the recorded events.
            objective: ``score`` (predictive log score, nats per event) or ``emd``.
            evaluations: Evaluations of the search; 0 for none.

        Raises:
            AnalysisError: The events do not determine the constants.
            SessionError: A stream is missing.
        """
        request = {
            "frames": self._frames_name(frames),
            "real": real,
            "objective": objective,
            "n_evaluations": _arguments.whole("evaluations", evaluations, 0, 10**6),
            "seed": _arguments.seed(seed),
            "force": bool(force),
        }
        return read(Calibration, self._handle.calibrate(request))

    def diagnose(
        self,
        *,
        real: str = "real",
        frames: Optional[str] = None,
        baseline: Optional[str] = None,
        pixels: Optional[int] = None,
        seed: int = 0,
        force: bool = False,
        progress: Progress = None,
    ) -> Diagnosis:
        """Finds physical effects that the model of this recording lacks; takes minutes.

        Args:
            real: Name of the recorded events.
            frames: Name of the frames.
            baseline: ``scene``, ``motion`` (motion-compensated interpolation) or ``frames`` (linear);
                by default the scene where there is one, else motion.
            pixels: Pixels to evaluate; 120 by default.

        Raises:
            AnalysisError: There are too few events, or signal and events do not overlap.
            SessionError: The session has neither a scene nor frames on the events' pixel grid.
            KeyboardInterrupt: After Ctrl-C; nothing is written then.
        """
        request = {
            "real": real,
            "baseline": baseline,
            "frames": frames,
            "n_pixels": _arguments.whole("pixels", pixels, 1, 10**6),
            "seed": _arguments.seed(seed),
            "force": bool(force),
        }
        with shown(progress, "diagnose") as report:
            return read(Diagnosis, self._handle.diagnose(request, report))

    def process(
        self,
        *,
        variants: Optional[str] = None,
        preset: Optional[str] = None,
        seed: int = 0,
        force: bool = False,
        progress: Progress = None,
    ) -> Processed:
        """Runs every stage for which the session has the inputs.

        Args:
            variants: A list of generators to add: ``twelve``, ``davis``, or a TOML file.
            preset: A published set of parameters for the generator.

        Raises:
            SessionError: The session is locked by another process, or a result is damaged.
        """
        chosen = choice(None, preset, None, None, None, None, seed)
        with shown(progress, "process") as report:
            stages, left_out = self._handle.process(chosen, variants, force, report)
        return Processed(stages, left_out)

    def report(self, path: Optional[PathLike] = None) -> Path:
        """Writes the report, one HTML file, and gives its path; by default into the session."""
        target = self.path / "report.html" if path is None else Path(_arguments.path("path", path))
        target.write_text(self._handle.report(), encoding="utf-8")
        return target

    def _frames_name(self, name: Optional[str]) -> str:
        found = name or self._handle.default_frames()
        if found is None:
            raise SessionError(f"{os.fspath(self.path)} has no frames; import a recording that has some")
        return found


def open(path: PathLike) -> Session:
    """Opens a session.

    Raises:
        SessionError: The directory is missing or not a session.
    """
    return Session(path)
