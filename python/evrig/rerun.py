"""Sessions and events in the viewer Rerun. Needs ``rerun-sdk``."""

from __future__ import annotations

from typing import Optional

import numpy as np
import rerun

from . import _arguments
from ._errors import ArgumentError
from .events import Events
from .session import Session

#: Name of the timeline: the events' clock from the first event on.
TIMELINE = "davis"


def log_events(
    events: Events, entity: str = "events", *, window_us: int = 10_000, start_us: Optional[int] = None
) -> int:
    """Logs images of events, one per window: red for ON, blue for OFF, white for none.

    Args:
        events: In ascending time.
        entity: Path in Rerun.
        window_us: Length of a window, µs.
        start_us: Time zero of the timeline; by default the first event.

    Returns:
        The number of images.

    Raises:
        ArgumentError: No events, or events of an unknown sensor.
    """
    width, height = events.sensor()
    if len(events) == 0:
        raise ArgumentError(f"{entity}: expected events, got none")
    window = _arguments.whole("window_us", window_us, 1, 2**62) or window_us
    zero = int(events.t[0]) if start_us is None else start_us
    n = 0
    for start in range(int(events.t[0]), int(events.t[-1]) + 1, window):
        part = events.between(start, start + window)
        image = np.full((height, width, 3), 255, np.uint8)
        image[part.y[~part.p], part.x[~part.p]] = (31, 119, 180)
        image[part.y[part.p], part.x[part.p]] = (214, 39, 40)
        rerun.set_time(TIMELINE, duration=(start - zero) * 1e-6)
        rerun.log(entity, rerun.Image(image))
        n += 1
    return n


def log_session(session: Session, *, window_us: int = 10_000) -> None:
    """Logs the recorded and generated events of a session, and the event camera's frames."""
    streams = [s.name for s in session.streams if s.kind == "events"] + session.generated
    real = session.events(streams[0])
    zero = int(real.t[0]) if len(real) else 0
    for name in streams:
        events = real if name == streams[0] else session.events(name)
        if len(events):
            log_events(events, f"events/{name}", window_us=window_us, start_us=zero)
    frames = session._handle.default_frames()
    if frames is not None:
        for frame in session.iter_frames(frames):
            rerun.set_time(TIMELINE, duration=(frame.t_us - zero) * 1e-6)
            rerun.log(f"frames/{frames}", rerun.Image(frame.image))
