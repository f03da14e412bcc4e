"""Overhead of the Python package against the library, in one run of the installed wheel.

usage: python benches/python.py [--events N] [--repeats N]

1. `evrig.generate` against the time that the library reports for its generator alone, on the same
   frames (`evrig generate --json`).
2. `evrig.Generator.push`, per frame of 692 x 520 in 16 bits, as a Raspberry Pi's camera gives them.
3. `evrig.read_events` with `evrig.camera_report` against `evrig camera-report` on the same file.

Repetitions of both sides alternate; medians are printed.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

import evrig
from evrig._cli import find_program


def moving_frames(n: int, width: int, height: int, white: int) -> np.ndarray:
    """A smooth random texture that moves by some pixels per frame."""
    rng = np.random.default_rng(1)
    texture = rng.normal(size=(height, width + 4 * n))
    spectrum = np.fft.rfft2(texture)
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(texture.shape[1])[None])
    texture = np.fft.irfft2(spectrum * np.exp(-((frequency / 0.05) ** 2)), texture.shape)
    texture = white * (0.5 + 0.15 * texture / texture.std()).clip(0.02, 1)
    return np.stack([texture[:, 4 * i : 4 * i + width] for i in range(n)])


def timed(work) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def generation(folder: Path, repeats: int) -> None:
    frames = np.rint(moving_frames(120, 346, 260, 255)).astype(np.uint8)
    t_us = np.arange(len(frames), dtype=np.int64) * 8_333
    session = evrig.create_session(folder / "frames", frames, t_us)
    command = [find_program(), "generate", str(session.path), "--force", "--json", "--name", "cli"]
    library, package = [], []
    for _ in range(repeats):
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        library.append(json.loads(done.stdout)["speed"]["seconds"])
        package.append(timed(lambda: evrig.generate(frames, t_us)))
    events = evrig.generate(frames, t_us)
    same = session.events("cli")
    assert all(np.array_equal(a, b) for a, b in zip(events.columns, same.columns))
    ratio = median(package) / median(library)
    print(
        f"generate, {len(frames)} frames of 346 x 260, {len(events)} events: library "
        f"{median(library):.3f} s, package {median(package):.3f} s, ratio {ratio:.3f}"
    )


def streaming(repeats: int) -> None:
    frames = np.rint(moving_frames(120, 692, 520, 1023)).astype(np.uint16)
    for threads in (1, None):
        times = []
        for _ in range(repeats):
            generator = evrig.Generator(preset="Raw2DVS346", threads=threads)
            pushed = [timed(lambda: generator.push(frame, i * 8_333)) for i, frame in enumerate(frames)]
            times += pushed[1:]
        print(
            f"push, 692 x 520 x uint16, {threads or 'all'} threads: median "
            f"{1e3 * median(times):.2f} ms, 99 % {1e3 * np.quantile(times, 0.99):.2f} ms per frame "
            "(8.33 ms at 120 frames per second)"
        )


def reading(folder: Path, n: int, repeats: int) -> None:
    recording = Path(__file__).parents[1] / "tests/data/davis346-street.aedat4"
    base = evrig.read_events(recording)
    tiles = -(-n // len(base))
    span = int(base.t[-1] - base.t[0]) + 1
    t = np.concatenate([base.t + i * span for i in range(tiles)])[:n]
    x, y, p = (np.tile(column, tiles)[:n] for column in base.columns[1:])
    path = folder / "events.npz"
    evrig.Events(t, x, y, p, base.size).save(path)
    command = [find_program(), "camera-report", str(path), "--size", "346x260", "--json"]
    program, package, read = [], [], []
    for _ in range(repeats):
        program.append(timed(lambda: subprocess.run(command, capture_output=True, check=True)))
        begun = time.perf_counter()
        events = evrig.read_events(path, size=base.size)
        read.append(time.perf_counter() - begun)
        evrig.camera_report(events)
        package.append(time.perf_counter() - begun)
    assert len(events) == n
    print(
        f"camera report of {n} events: program {median(program):.2f} s, package "
        f"{median(package):.2f} s (of them read_events {median(read):.2f} s), ratio "
        f"{median(package) / median(program):.3f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--events", type=float, default=20e6)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        generation(Path(folder), options.repeats)
        streaming(options.repeats)
        reading(Path(folder), int(options.events), options.repeats)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GB")


main()
