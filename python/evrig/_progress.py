"""Progress of long work: a bar in a terminal or in Jupyter, or a function of the caller."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import Any, Callable, Iterator, Optional, Union

from ._errors import ArgumentError

#: Takes the step's name, what is done of it, and how much that is in all (0: not known).
ProgressFunction = Callable[[str, int, int], Any]

#: ``None``: a bar where somebody watches; ``True``, ``False``: always, never; or a function.
Progress = Union[None, bool, ProgressFunction]


@contextmanager
def shown(progress: Progress, what: str) -> Iterator[Optional[ProgressFunction]]:
    """The function to report to while the block runs; ``None`` where nobody watches."""
    if progress is None:
        progress = sys.stderr.isatty() or "ipykernel" in sys.modules
    if callable(progress):
        yield progress
        return
    if not isinstance(progress, bool):
        got = type(progress).__name__
        raise ArgumentError(f"progress: expected None, a bool or a function, got {got}")
    if not progress:
        yield None
        return
    from tqdm.auto import tqdm

    with tqdm(desc=what, leave=False) as bar:

        def report(step: str, done: int, total: int) -> None:
            bar.total = total or None
            bar.n = done
            bar.set_description_str(step, refresh=False)
            bar.update(0)
            bar.refresh()

        yield report
