"""Compares the metadata of exported events with the files of the session: exposure times and event
ranges of the images, poses of the tag and its detections, clocks, seeds.

usage: read_side.py SESSION FOLDER   with {real,scene}.{npz,h5,parquet,aedat4,mcap} and their FILE.json
"""

import json
import sys
from pathlib import Path

import h5py
import numpy as np
from mcap.reader import make_reader

session, folder = Path(sys.argv[1]), Path(sys.argv[2])
ENDINGS = ["npz", "h5", "parquet", "aedat4", "mcap"]


def beside(stream, ending):
    return json.loads((folder / f"{stream}.{ending}.json").read_text())


def column(side, image, name):
    values = side["images"][image]["columns"][name]
    return np.array([np.nan if v is None else v for v in values] if not isinstance(values[0], list) else
                    [[np.nan if v is None else v for v in row] for row in values])


def same(a, b):
    return a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


def apply(h, place):
    x, y, w = h.reshape(3, 3) @ [*place, 1.0]
    return np.array([x / w, y / w])


def on_events_clock(stream, stamps_ns):
    """The Pi's timestamps mapped by the result of `evrig sync`."""
    clock = json.loads((session / "derived/sync/clock.json").read_text())
    segments = clock["davis_from_sensor"]["segments"]
    late = {one["stream"]: (one["delay_us"] or {}).get("value", 0.0) for one in clock.get("stream_delays", [])}
    mapped = []
    for stamp in stamps_ns:
        inside = [s for s in segments if stamp <= s["last"]] or [segments[-1]]
        m = inside[0]["map"]
        mapped.append(m["a0"] + (stamp - m["b0"]) * (1 + m["skew"]) + late.get(stream, 0.0) * 1e3)
    return np.array(mapped) / 1e3


def check_tables(stream):
    """The same numbers inside the files that can hold them, and in the JSON file of each."""
    sides = {ending: beside(stream, ending) for ending in ENDINGS}
    npz = np.load(folder / f"{stream}.npz")
    t = npz["events"][:, 0]
    with h5py.File(folder / f"{stream}.h5") as h5:
        for number, image in enumerate(sides["npz"]["images"]):
            for name in image["columns"]:
                wanted = column(sides["npz"], number, name)
                for ending in ENDINGS:
                    assert same(column(sides[ending], number, name), wanted), (ending, name)
                assert same(npz[f"{image['stream']}_{name}"].reshape(wanted.shape), wanted), name
                inside = h5["images"][image["stream"]][name][:]
                assert same(inside.reshape(wanted.shape), wanted), name
            first = column(sides["npz"], number, "first_event")
            times = column(sides["npz"], number, "t_us")
            assert np.array_equal(first, np.searchsorted(t, times, side="left")), image["stream"]
    for side in sides.values():
        assert side["clocks"] == sides["npz"]["clocks"] and side["session_files"]
    return sides["npz"]


def check_tracks(side):
    n_seen = 0
    for number, image in enumerate(side["images"]):
        track = json.loads((session / f"derived/track-{image['stream']}/track.json").read_text())["track"]
        assert track["lens"]["distortion"] == [0.0] * 5, "the test's lens is perfect"
        tag, picture_mm, gap = (track["plane"][f"{part}_mm"] for part in ("tag_side", "picture_side", "gap"))
        # From the centre of the target, down positive: image, gap, tag.
        right, bottom = (picture_mm + gap + tag) / 2, max(picture_mm, tag) / 2
        corners = [[right - tag, bottom], [right, bottom], [right, bottom - tag], [right - tag, bottom - tag]]
        assert image["corner_rms_px"] == track["quality"]["corner_rms_px"]
        homographies = column(side, number, "ideal_px_from_target_mm")
        residuals = column(side, number, "corner_residual_px")
        sightings = {one["frame"]: one for one in track["detections"]}
        own = []
        for row, (h, residual) in enumerate(zip(homographies, residuals)):
            if row not in sightings:
                assert np.isnan(residual), row
                continue
            detected = np.array(sightings[row]["corners_px"])
            if np.isnan(residual):
                # The path begins with the first detection and ends with the last, at the tag's middle row.
                assert row in (min(sightings), max(sightings)), row
                continue
            own.append(residual)
            if np.isnan(h).any():
                continue
            n_seen += 1
            # The homography is at the time of the middle row, each corner at that of its own row; the
            # target moves little in between on this rig.
            apart = np.array([apply(h, corner) for corner in corners]) - detected
            off = np.sqrt(np.mean(np.sum(apart**2, 1)))
            assert off < residual + 1.0, (image["stream"], row, off, residual)
            if image["stream"] == "aps":
                # Global shutter: both are the same number.
                assert abs(off - residual) < 1e-6, (row, off, residual)
        rms = np.sqrt(np.mean(np.square(own)))
        assert abs(rms / image["corner_rms_px"] - 1) < 0.05, (image["stream"], rms, image["corner_rms_px"])
        picture = column(side, number, "picture_px")
        errors = column(side, number, "picture_error_px")
        known = ~np.isnan(picture).any(1)
        assert known.any() and (errors[known] > 0).all()
    return n_seen


def check_exposures(side):
    import dv_processing as dv

    reader = dv.io.MonoCameraRecording(str(session / "davis.aedat4"))
    frames = []
    while (frame := reader.getNextFrame()) is not None:
        frames.append((frame.timestamp, frame.exposure))
    streams = [image["stream"] for image in side["images"]]
    number = streams.index("aps")
    starts, ends = (column(side, number, f"exposure_{end}_us") for end in ("start", "end"))
    assert len(frames) == len(starts) > 5
    for (stamp, exposure), start, end in zip(frames, starts, ends):
        micros = exposure.total_seconds() * 1e6
        assert abs((end - start) - micros) <= 1 and start <= stamp <= end, (stamp, start, end, micros)
    for stream in ("raw", "rgb"):
        number = streams.index(stream)
        own = {}
        with open(session / "rig.mcap", "rb") as f:
            for _, _, message in make_reader(f).iter_messages(topics=["/pi/metadata"]):
                value = json.loads(message.data)
                own[value["sensor_timestamp_ns"]] = value["exposure_ns"] / 1e3
        stamps = column(side, number, "stamp_ns")
        starts, ends = (column(side, number, f"exposure_{end}_us") for end in ("start", "end"))
        for stamp, start, end in zip(stamps, starts, ends):
            assert abs((end - start) - own[int(stamp)]) < 2, (stream, stamp)
        # The middle of an exposure is between its ends, on the clock of the events.
        middle = column(side, number, "t_us")
        assert ((starts < middle) & (middle < ends + 20_000)).all()
        mapped = on_events_clock(stream, stamps)
        assert (np.abs(mapped - middle) < 20_000).all() and np.ptp(mapped - middle) < 2, stream
    return len(frames)


def check_seeds(side):
    stage = json.loads((session / "derived/generate-scene/stage.json").read_text())
    assert side["made_by"]["parameters"] == stage["parameters"]
    assert side["made_by"]["parameters"]["generator"]["seed"] == 77
    with h5py.File(folder / "scene.h5") as h5:
        assert json.loads(h5["evrig"][()])["made_by"] == side["made_by"]
    import pyarrow.parquet as pq

    about = json.loads(pq.read_schema(folder / "scene.parquet").metadata[b"evrig"])
    assert about["made_by"] == side["made_by"] and about["clocks"] == side["clocks"]


def check_clock(side):
    clock = json.loads((session / "derived/sync/clock.json").read_text())
    assert side["clocks"]["davis_from_sensor"] == clock["davis_from_sensor"]


real, made = check_tables("real"), check_tables("scene")
assert [image["stream"] for image in real["images"]] == [image["stream"] for image in made["images"]]
n_seen = check_tracks(real)
n_frames = check_exposures(real)
check_clock(real)
check_seeds(made)
print(f"{n_seen} homographies, {n_frames} exposures of the DAVIS, clocks and seeds: as in the session")
