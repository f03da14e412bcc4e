"""Events from frames in memory."""

from __future__ import annotations

import json
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from . import _arguments, _evrig
from ._errors import ArgumentError
from ._progress import Progress, shown
from .events import Events

#: Effects by id, each with its parameters: ``{"refractory_period": {"refractory_us": 800}}``.
Effects = Mapping[str, Any]


def choice(
    model: Optional[str],
    preset: Optional[str],
    k: Optional[Sequence[float]],
    knobs: Optional[Mapping[str, float]],
    full_scale_dn: Optional[float],
    law: Optional[str],
    seed: int,
) -> Dict[str, Any]:
    """A generator's choice as the library takes it."""
    if isinstance(k, str):
        raise ArgumentError(f"k: expected six numbers k1 to k6, got the text {k!r}")
    return {
        "model": model,
        "preset": preset,
        "k": None if k is None else [float(value) for value in k],
        "knobs": [(name, float(value)) for name, value in (knobs or {}).items()],
        "full_scale_dn": _arguments.number("full_scale_dn", full_scale_dn),
        "law": law,
        "seed": _arguments.seed(seed),
    }


def effects_json(effects: Union[None, Effects, Iterable[str]]) -> str:
    """Effects as a table of the library, from a mapping or from the words of the command line."""
    if effects is None:
        return "{}"
    if isinstance(effects, str):
        effects = [effects]
    if not isinstance(effects, Mapping):
        table: Dict[str, List[Dict[str, float]]] = {}
        for word in effects:
            name, _, rest = str(word).partition(":")
            pairs = (setting.partition("=") for setting in rest.split(",") if setting.strip())
            try:
                parameters = {key.strip(): float(value) for key, _, value in pairs}
            except ValueError:
                raise ArgumentError(
                    f"effects: expected words as refractory_period:refractory_us=800, got {word!r}"
                ) from None
            table.setdefault(name.strip(), []).append(parameters)
        effects = table
    try:
        return json.dumps(dict(effects), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"effects: expected ids with numbers, got {effects!r}: {error}") from None


class Generator:
    """Generates events frame by frame, as frames arrive from a camera.

    The first frame sets the starting brightness and gives no events. The lock of Python is released
    while a frame is worked on; a generator may be used by one thread at a time.

    Args:
        model: ``voltmeter`` (DVS-Voltmeter, Raw2Event; the default), ``esim`` or ``v2e``.
        preset: A published set of parameters, as ``DVS346`` or ``Raw2DVS346``.
        k: The voltmeter's constants k1 to k6 instead of a preset.
        knobs: Changes of the voltmeter's constants by name, as ``{"global-noise": 1e-5}``.
        full_scale_dn: Value of white in the frames, for esim and v2e; 255 by default.
        law: ``exact`` (the default) or ``reference``, for the voltmeter.
        seed: Seed of all draws; the same seed gives the same events, on any number of threads.
        threads: Number of threads; all processors by default.
        interpolate_us: Longest interval between frames after interpolation, µs, linear in log
            intensity; none by default.
        row_us: Delay from row to row of a rolling shutter, µs; a frame's time is then that of its
            middle row.

    Raises:
        ArgumentError: An unknown name, or a value out of its range.

    See docs/reference/generators.md for models and sources.
    """

    def __init__(
        self,
        *,
        model: Optional[str] = None,
        preset: Optional[str] = None,
        k: Optional[Sequence[float]] = None,
        knobs: Optional[Mapping[str, float]] = None,
        full_scale_dn: Optional[float] = None,
        law: Optional[str] = None,
        seed: int = 0,
        threads: Optional[int] = None,
        interpolate_us: Optional[int] = None,
        row_us: float = 0.0,
    ) -> None:
        self._generator = _evrig.FrameGenerator(
            choice(model, preset, k, knobs, full_scale_dn, law, seed),
            _arguments.whole("threads", threads, 1, 1024),
            _arguments.whole("interpolate_us", interpolate_us, 1, 2**32 - 1),
            _arguments.number("row_us", row_us),
        )

    def push(self, frame: NDArray[Any], t_us: int) -> Events:
        """Takes in the next frame and gives the events after the frame before, up to this one.

        Args:
            frame: Shape (height, width), uint8, uint16, float32 or float64, of any strides, in
                digital units, finite and not negative.
            t_us: Its time, µs, later than that of the frame before.

        Raises:
            ArgumentError: A frame of another type or shape, not later, or with a value that is no
                brightness. A refused frame changes nothing.
        """
        time = _arguments.whole("t_us", t_us, -(2**63), 2**63 - 1)
        columns = self._generator.push(frame, time)
        height, width = frame.shape
        return _events(columns, (width, height))

    def finish(self) -> Events:
        """The events held back until no row of a next frame can precede them; none where ``row_us``
        is zero."""
        return Events(*self._generator.finish())


def _events(columns: Any, size: Tuple[int, int]) -> Events:
    """Columns of the library, which need no check."""
    events = object.__new__(Events)
    fields = {"size": size, "frame_starts_us": None, "frame_reference": None, "notes": ()}
    for name, value in (*zip("txyp", columns), *fields.items()):
        object.__setattr__(events, name, value)
    return events


def generate(
    frames: Union[NDArray[Any], Iterable[NDArray[Any]]],
    t_us: Union[NDArray[np.int64], Iterable[int]],
    *,
    model: Optional[str] = None,
    preset: Optional[str] = None,
    k: Optional[Sequence[float]] = None,
    knobs: Optional[Mapping[str, float]] = None,
    full_scale_dn: Optional[float] = None,
    law: Optional[str] = None,
    seed: int = 0,
    threads: Optional[int] = None,
    interpolate_us: Optional[int] = None,
    row_us: float = 0.0,
    progress: Progress = False,
) -> Events:
    """Events from frames.

    Args:
        frames: Shape (n, height, width), uint8, uint16, float32 or float64, of any strides; or any
            iterable of frames, which need not fit in memory.
        t_us: Time of each frame, µs, integers, ascending.
        progress: None: a bar in a terminal or in Jupyter; True, False; or a function of the step,
            what is done and how much there is.

    The other arguments are those of :class:`Generator`.

    Returns:
        The events after the first frame up to the last, in ascending time.

    Raises:
        ArgumentError: As :class:`Generator` and its ``push``.
    """
    if isinstance(frames, np.ndarray):
        if frames.ndim != 3 or len(frames) < 2:
            raise ArgumentError(
                "frames: expected at least two, of shape (n, height, width), got "
                f"{_arguments.describe(frames)}"
            )
        chosen = choice(model, preset, k, knobs, full_scale_dn, law, seed)
        with shown(progress, "generate") as report:
            columns = _evrig.generate(
                frames,
                _arguments.times("t_us", t_us, len(frames)),
                chosen,
                _arguments.whole("threads", threads, 1, 1024),
                _arguments.whole("interpolate_us", interpolate_us, 1, 2**32 - 1),
                _arguments.number("row_us", row_us),
                report,
            )
        return _events(columns, (frames.shape[2], frames.shape[1]))
    generator = Generator(
        model=model, preset=preset, k=k, knobs=knobs, full_scale_dn=full_scale_dn, law=law,
        seed=seed, threads=threads, interpolate_us=interpolate_us, row_us=row_us,
    )
    parts: List[Events] = []
    rest, own_times = iter(frames), iter(t_us)
    with shown(progress, "generate") as report:
        for frame in rest:
            time = next(own_times, None)
            if time is None:
                raise ArgumentError(f"t_us: expected a time for each frame, got {len(parts)}")
            parts.append(generator.push(frame, int(time)))
            if report is not None:
                report("generate", len(parts), 0)
    if len(parts) < 2:
        raise ArgumentError(f"frames: expected at least two, got {len(parts)}")
    size = parts[0].size
    parts.append(generator.finish())
    t, x, y, p = (np.concatenate(column) for column in zip(*(part.columns for part in parts)))
    return Events(t, x, y, p, size)


def simulate_effects(
    frames: NDArray[Any],
    t_us: Union[NDArray[np.int64], Sequence[int]],
    effects: Union[Effects, Iterable[str]],
    *,
    preset: Optional[str] = None,
    k: Optional[Sequence[float]] = None,
    seed: int = 0,
    step_us: int = 1000,
    row_us: float = 0.0,
    frame_starts_us: Iterable[int] = (),
    progress: Progress = False,
) -> Events:
    """Events of a camera with physical effects, by the voltmeter's exact law on the log-intensity
    signal between the frames.

    Args:
        frames: Shape (n, height, width), as for :func:`generate`.
        t_us: Time of each frame, µs, ascending.
        effects: Effects by id, each with its parameters and a ``region`` where it is limited to one:
            ``{"refractory_period": {"refractory_us": 800}}``; or words as on the command line,
            ``["refractory_period:refractory_us=800"]``. :func:`effect_library` lists them.
        preset: The voltmeter's constants by name; ``DVS346`` by default.
        k: The voltmeter's constants k1 to k6 instead.
        step_us: Sampling step of the signal, µs, 10 to 100,000.
        row_us: Delay from row to row of a rolling shutter, µs; times are those of the first row.
        frame_starts_us: When the event camera took frames of its own, µs, for ``aps_coupling``.

    Returns:
        The events in ascending time.

    Raises:
        ArgumentError: An unknown effect, a parameter out of its range, or wrong frames.

    See docs/reference/effects.md for equations and sources.
    """
    if not isinstance(frames, np.ndarray) or frames.ndim != 3 or len(frames) < 2:
        raise ArgumentError(
            "frames: expected an array of at least two, of shape (n, height, width), got "
            f"{_arguments.describe(frames)}"
        )
    if k is not None and len(k) != 6:
        raise ArgumentError(f"k: expected six numbers k1 to k6, got {len(k)}")
    arguments = {
        "effects_json": effects_json(effects),
        "preset": preset,
        "k": None if k is None else [float(value) for value in k],
        "seed": _arguments.seed(seed),
        "step_us": _arguments.whole("step_us", step_us, 10, 100_000),
        "row_us": _arguments.number("row_us", row_us),
        "frame_starts_us": [int(start) for start in frame_starts_us],
    }
    with shown(progress, "simulate") as report:
        columns = _evrig.simulate_effects(
            frames, _arguments.times("t_us", t_us, len(frames)), arguments, report
        )
    return _events(columns, (frames.shape[2], frames.shape[1]))


def effect_library() -> Dict[str, List[str]]:
    """The ids of all physical effects, each with the keys of its parameters; a key ends in its
    unit."""
    return dict(_evrig.effect_library())
