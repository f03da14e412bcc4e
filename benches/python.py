"""Overhead of the Python package against the library, in one run of the installed wheel.

usage: python benches/python.py [--events N] [--repeats N] [--clip FRAMES.npy]

1. The voltmeter model on one thread: the library (`cargo bench --bench generate -- --clip`), with
   the memory of the events reused and with all events kept, against the generator within
   `evrig generate` and against `evrig.generate`, on the same 16-bit frames at 120 frames/s.
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
from typing import Callable, Dict, List

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


def of_library(frames: np.ndarray, folder: Path) -> Callable[[], Dict[str, float]]:
    """Builds the benchmark of the library; the result runs it on the frames."""
    samples = folder / "frames.raw"
    frames.astype("<u2").tofile(samples)
    height, width = frames.shape[1:]
    size = [str(width), str(height)]
    command = ["cargo", "bench", "--locked", "--quiet", "--bench", "generate", "--", "--clip", samples, *size]

    def run() -> Dict[str, float]:
        done = subprocess.run(
            command, cwd=Path(__file__).parents[1], check=True, stdout=subprocess.PIPE
        )
        return json.loads(done.stdout)

    run()
    return run


def generation(folder: Path, frames: np.ndarray, repeats: int) -> None:
    t_us = np.rint(np.arange(len(frames)) * 1e6 / 120).astype(np.int64)
    session = evrig.create_session(folder / "frames", frames, t_us)
    program = [find_program(), "generate", str(session.path), "--preset", "Raw2DVS346"]
    program += ["--force", "--json", "--name", "cli"]
    one_thread = {**os.environ, "RAYON_NUM_THREADS": "1"}
    library = of_library(frames, folder)
    seconds: Dict[str, List[float]] = {}
    for _ in range(repeats):
        alone = library()
        done = subprocess.run(program, check=True, capture_output=True, env=one_thread)
        times = {
            "library, memory reused": alone["reused_s"],
            "library, events kept": alone["kept_s"],
            "evrig generate": json.loads(done.stdout)["speed"]["seconds"],
            "evrig.generate": timed(lambda: evrig.generate(frames, t_us, preset="Raw2DVS346", threads=1)),
        }
        for name, time_s in times.items():
            seconds.setdefault(name, []).append(time_s)
    events = evrig.generate(frames, t_us, preset="Raw2DVS346", threads=1)
    same = session.events("cli")
    assert all(np.array_equal(a, b) for a, b in zip(events.columns, same.columns))
    n, height, width = frames.shape
    print(f"{n} frames of {width} x {height}, {len(events)} events, one thread")
    for name, against in [
        ("library, memory reused", "library, memory reused"),
        ("library, events kept", "library, memory reused"),
        ("evrig generate", "library, memory reused"),
        ("evrig.generate", "library, events kept"),
    ]:
        ns = 1e9 * median(seconds[name]) / (n * width * height)
        ratio = median(a / b for a, b in zip(seconds[name], seconds[against]))
        print(f"{name:24} {ns:6.2f} ns per pixel and frame, {ratio:.3f} of {against}")


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
            f"{1e3 * median(times):.2f} ms, 99 % {1e3 * np.quantile(times, 0.99):.2f} ms, longest "
            f"{1e3 * max(times):.2f} ms per frame (8.33 ms at 120 frames per second)"
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
    parser.add_argument("--clip", type=Path, help="frames, n x height x width, uint16")
    options = parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        frames = np.load(options.clip) if options.clip else moving_frames(300, 346, 260, 1023)
        generation(Path(folder), np.rint(frames).astype(np.uint16), options.repeats)
        streaming(options.repeats)
        reading(Path(folder), int(options.events), options.repeats)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GB")


main()
