"""A small event simulator in numpy, run by `evrig generate --variants`.

usage: threshold_crossings.py FRAMES TIMES OUT [THRESHOLD]

The log intensity of each pixel runs linearly from frame to frame. An event is emitted, and the
reference level moved by the threshold, each time it has changed by the threshold (in natural log
units, 0.2 by default) since the pixel's last event.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image


def read_log_intensity(path):
    # Of 8 or 16 bits; one digital unit keeps a black pixel's logarithm finite.
    return np.log(np.asarray(Image.open(path), dtype=np.float64) + 1.0)


def crossings(before, after, reference, times, threshold):
    """Events between two frames and the new reference levels."""
    n = np.trunc((after - reference) / threshold).astype(int)
    y, x = np.nonzero(n)
    counts = np.abs(n[y, x])
    sign = np.repeat(np.sign(n[y, x]), counts)
    y, x = np.repeat(y, counts), np.repeat(x, counts)
    # 1, 2, ... within each pixel.
    number = np.arange(len(x)) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    level = reference[y, x] + sign * number * threshold
    change = after[y, x] - before[y, x]
    # A level that rounding left for the next interval is crossed at once.
    part = np.divide(level - before[y, x], change, out=np.zeros(len(x)), where=change != 0)
    t = times[0] + np.clip(part, 0.0, 1.0) * (times[1] - times[0])
    return np.column_stack([t, x, y, sign > 0]), reference + n * threshold


def main(frames, times, out, threshold=0.2):
    paths = sorted(Path(frames).glob("*.png"))
    seconds = np.loadtxt(times)
    before = read_log_intensity(paths[0])
    reference, made = before.copy(), []
    for i, path in enumerate(paths[1:], start=1):
        after = read_log_intensity(path)
        events, reference = crossings(
            before, after, reference, seconds[i - 1 : i + 1], float(threshold)
        )
        made.append(events)
        before = after
    events = np.concatenate(made)
    events = events[np.argsort(events[:, 0], kind="stable")]
    t_us = np.round(events[:, 0] * 1e6).astype(np.int64)
    x, y, p = events[:, 1:].astype(np.int64).T
    # The reader takes the unit from the column's name.
    np.savez(out, t_us=t_us, x=x, y=y, p=p)
    print(f"{len(t_us)} events from {len(paths)} frames")


if __name__ == "__main__":
    main(*sys.argv[1:])
