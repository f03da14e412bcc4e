"""Fixtures: the recording in tests/data, and frames of a moving pattern."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest

import evrig

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def interrupts():
    """Ctrl-C raises, also where the shell that started the tests ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def recording() -> Path:
    return ROOT / "tests/data/davis346-street.aedat4"


@pytest.fixture(scope="session")
def street(recording, tmp_path_factory) -> evrig.Session:
    """The recording as a session."""
    out = tmp_path_factory.mktemp("sessions") / "street"
    return evrig.import_(recording, out, progress=False)


@pytest.fixture(scope="session")
def pattern() -> tuple[np.ndarray, np.ndarray]:
    """A sine pattern that moves by a pixel per frame: uint8 (40, 48, 64), and times in µs."""
    x = np.arange(64)[None, None, :]
    y = np.arange(48)[None, :, None]
    i = np.arange(40)[:, None, None]
    wave = 120 + 90 * np.sin(2 * np.pi * (x + i) / 16) * np.cos(2 * np.pi * y / 48)
    return wave.astype(np.uint8), np.arange(40, dtype=np.int64) * 8_333
