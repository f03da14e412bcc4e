"""Windows of events for PyTorch, from a folder of sessions. Needs ``torch``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np
from torch.utils.data import Dataset

from . import _arguments
from ._arguments import PathLike
from ._errors import ArgumentError, SessionError
from .events import Events
from .session import Session

#: What an item is made of: the events of a window, and the session's name.
Transform = Callable[[Events], Any]


def tensors(events: Events) -> Dict[str, Any]:
    """The columns as tensors t (int64, µs), x, y (int32) and p (bool), without a copy of t and p."""
    import torch

    return {
        "t": torch.from_numpy(events.t),
        "x": torch.from_numpy(events.x.astype(np.int32)),
        "y": torch.from_numpy(events.y.astype(np.int32)),
        "p": torch.from_numpy(events.p),
    }


class EventsDataset(Dataset[Any]):  # type: ignore[misc, unused-ignore]
    """Windows of equal length of an event stream, over all sessions of a folder.

    Sessions are read where they are needed, so that the workers of a ``DataLoader`` read different
    ones; the last session of each worker is kept in memory. Windows of one session follow each other:
    shuffle sessions rather than windows where they are long.

    Args:
        folder: A session, or a folder that holds sessions, at any depth.
        window_us: Length of a window, µs.
        stream: Name of the event stream; sessions without it are left out.
        stride_us: Time from window to window, µs; by default their length.
        transform: Makes an item of a window's :class:`evrig.Events`; by default :func:`tensors`.
            ``lambda events: own(events.to_tonic())`` applies a transform of tonic.

    Raises:
        ArgumentError: A window or stride below 1 µs.
        SessionError: No session in the folder has the stream.
    """

    def __init__(
        self,
        folder: PathLike,
        window_us: int,
        *,
        stream: str = "real",
        stride_us: Optional[int] = None,
        transform: Transform = tensors,
    ) -> None:
        longest = 2**62
        window = _arguments.whole("window_us", window_us, 1, longest)
        stride = _arguments.whole("stride_us", stride_us, 1, longest) or window
        if window is None or stride is None:
            raise ArgumentError("window_us: expected an integer, got None")
        self.window_us, self.stream, self.transform = window, stream, transform
        root = Path(_arguments.path("folder", folder))
        found = sorted(path.parent for path in root.rglob("session.json"))
        #: Session and start (µs) of each window.
        self.windows: List[Tuple[Path, int]] = []
        for path in found:
            session = Session(path)
            span = _span(session, stream)
            if span is not None:
                first, last = span
                starts = range(first, max(last - window + 2, first + 1), stride)
                self.windows += [(path, start) for start in starts]
        if not self.windows:
            raise SessionError(
                f"{root} holds no events of a stream `{stream}` in {len(found)} sessions; expected a "
                "session, or a folder of sessions with that stream"
            )
        self._read: Optional[Tuple[Path, Events]] = None

    def __len__(self) -> int:
        return len(self.windows)

    def __getitem__(self, index: int) -> Any:
        path, start = self.windows[index]
        if self._read is None or self._read[0] != path:
            self._read = (path, Session(path).events(self.stream))
        return self.transform(self._read[1].between(start, start + self.window_us))

    def __getstate__(self) -> Dict[str, Any]:
        # A worker reads for itself.
        return {**self.__dict__, "_read": None}


def _span(session: Session, stream: str) -> Optional[Tuple[int, int]]:
    """First and last event, µs; None without events."""
    for entry in session.streams:
        if entry.name == stream and entry.kind == "events":
            first, last = entry.first_us, entry.last_us
            return None if first is None or last is None else (first, last)
    if stream not in session.generated:
        return None
    t = session.events(stream).t
    return (int(t[0]), int(t[-1])) if len(t) else None
