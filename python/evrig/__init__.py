"""evrig: events from frames, and where simulated and recorded events differ.

Events are NumPy columns that own the library's memory; long work releases Python's lock and ends at
Ctrl-C. Times are integers in microseconds unless a name ends in another unit. Every exception is an
:class:`evrig.Error` with the text of the command line.
"""

from ._errors import AnalysisError, ArgumentError, Error, FileError, SessionError
from ._evrig import __version__
from ._records import Estimate, NotMeasured
from .analysis import (
    calibrate,
    camera_report,
    compare,
    create_session,
    diagnose,
    import_,
    read_events,
)
from .calibration import Calibration
from .camera import CameraReport
from .comparison import Comparison, Measure
from .diagnosis import Diagnosis, FittedEffect
from .events import Events
from .frames import Frame, Frames
from .generation import Generator, effect_library, generate, simulate_effects
from .session import ClockMap, Poses, Processed, Session, Stream, Track, open

__all__ = [
    "AnalysisError",
    "ArgumentError",
    "Calibration",
    "CameraReport",
    "ClockMap",
    "Comparison",
    "Diagnosis",
    "Error",
    "Estimate",
    "Events",
    "FileError",
    "FittedEffect",
    "Frame",
    "Frames",
    "Generator",
    "Measure",
    "NotMeasured",
    "Poses",
    "Processed",
    "Session",
    "SessionError",
    "Stream",
    "Track",
    "__version__",
    "calibrate",
    "camera_report",
    "compare",
    "create_session",
    "diagnose",
    "effect_library",
    "generate",
    "import_",
    "open",
    "read_events",
    "simulate_effects",
]
