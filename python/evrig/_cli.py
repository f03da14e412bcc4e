"""The command line ``evrig``, run by the library in this process."""

from __future__ import annotations

import signal
import sys
import sysconfig
from importlib import metadata
from pathlib import Path
from typing import NoReturn, Optional

from . import _evrig


def find_program() -> Optional[Path]:
    """The installed script ``evrig``, from which child processes are started."""
    try:
        files = metadata.files("evrig") or []
    except metadata.PackageNotFoundError:
        files = []
    scripts = [Path(str(f.locate())) for f in files if f.name in ("evrig", "evrig.exe")]
    scripts.append(Path(sysconfig.get_path("scripts")) / "evrig")
    return next((path.resolve() for path in scripts if path.is_file()), None)


def main() -> NoReturn:
    """Runs the command line of this process and exits with the command's code."""
    program = find_program()
    if program is not None:
        _evrig.set_program(program)
    # As in the program evrig: the library handles the interrupts that a command needs.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.stdout.flush()
    sys.exit(_evrig.run_command(["evrig", *sys.argv[1:]]))
