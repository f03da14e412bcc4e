"""Sessions and their stages."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import os
import signal
import subprocess
import threading
import time
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

import evrig
from evrig import _evrig
from evrig._cli import find_program
from evrig._records import NotMeasured, key_of

from conftest import ROOT


def unknown_keys(kind: Any, value: Any, at: str = "") -> list[str]:
    """Keys of the library's JSON that the dataclasses do not have."""
    origin, arguments = get_origin(kind), get_args(kind)
    if value is None:
        return []
    if origin is Union:
        if isinstance(value, dict) and "not_measured" in value:
            return []
        kinds = [one for one in arguments if one not in (type(None), NotMeasured)]
        return unknown_keys(kinds[0], value, at)
    if origin is list:
        return [k for item in value for k in unknown_keys(arguments[0], item, at)]
    if origin is dict:
        return [k for item in value.values() for k in unknown_keys(arguments[1], item, at)]
    if not dataclasses.is_dataclass(kind):
        return []
    hints = get_type_hints(kind)
    fields = {key_of(field): hints[field.name] for field in dataclasses.fields(kind)}
    found = [f"{at}.{key}" for key in value if key not in fields]
    known = (key for key in value if key in fields)
    return found + [k for key in known for k in unknown_keys(fields[key], value[key], f"{at}.{key}")]


def test_a_session_states_its_streams(street):
    counts = {stream.name: stream.count for stream in street.streams}
    assert counts["real"] == 78830 and counts["aps"] == 59 and counts["imu"] == 2363
    assert street.size == (346, 260) and street.name == "street" and "real 78830" in repr(street)
    assert evrig.open(street.path).manifest == street.manifest


def test_frames_have_their_times(street):
    frames = street.frames()
    assert frames.images.shape == (59, 260, 346) and frames.images.dtype == np.uint8
    assert (np.diff(frames.t_us) > 0).all() and frames.clock == "davis"
    middle = frames.exposure_ns.mean(axis=1) / 1e3
    assert np.abs(middle - frames.t_us).max() <= 1
    first = next(street.iter_frames("aps"))
    assert np.array_equal(first.image, frames.images[0]) and first.t_us == frames.t_us[0]


def test_the_package_and_the_command_line_generate_the_same_events(street):
    frames = street.frames()
    ours = evrig.generate(frames.images, frames.t_us, preset="DVS346", seed=7, row_us=frames.row_us)
    arguments = ["generate", str(street.path), "--seed", "7", "--name", "cli"]
    subprocess.run([find_program(), *arguments], check=True, capture_output=True)
    theirs = street.events("cli")
    assert all(np.array_equal(a, b) for a, b in zip(ours.columns, theirs.columns))
    assert "cli" in street.generated


def test_a_comparison_has_measures_with_errors(street):
    simulated = street.generate("tests", seed=3, progress=False)
    comparison = street.compare("tests")
    assert comparison.n_simulated > 0 and comparison.n_real > 0
    ratio = comparison["count_ratio"].estimate
    assert ratio.ci90[0] < ratio.value < ratio.ci90[1] and ratio.standard_error > 0
    assert abs(ratio.value - comparison.n_simulated / comparison.n_real) < 1e-9
    assert comparison.maps["real_on"].shape == (260, 346) and "count" in str(comparison)
    assert street.comparison("tests").measures == comparison.measures
    with pytest.raises(KeyError, match="count_ratio"):
        comparison["none"]
    direct = evrig.compare(street.events(), simulated, window_us=comparison.window_us)
    assert direct["count_ratio"].estimate.value == pytest.approx(ratio.value)
    found = _evrig.compare_events(
        simulated.columns,
        simulated.columns,
        {"size": (346, 260), "window_us": None, "region": None, "seed": 0, "n_bootstrap": 20,
         "name": "same"},
    )
    assert unknown_keys(evrig.Comparison, json.loads(found[0])) == []


def test_a_wrong_comparison_is_refused(street):
    real = street.events()
    for arguments, word in [
        ((real, real[::-1]), "simulated: expected ascending times"),
        ((real, real.between(0, 1)), "overlap"),
        ((real, 3), "simulated: expected Events"),
    ]:
        with pytest.raises(evrig.ArgumentError, match=word):
            evrig.compare(*arguments)
    with pytest.raises(evrig.ArgumentError, match="region"):
        evrig.compare(real, real, region=np.ones((2, 2), bool))
    with pytest.raises(evrig.ArgumentError, match="on the sensor of 10 x 10"):
        evrig.compare(real, real, size=(10, 10))


def test_the_camera_report_is_that_of_the_command_line(recording, street):
    report = evrig.camera_report(recording)
    done = subprocess.run(
        [find_program(), "camera-report", str(recording), "--json"], capture_output=True, text=True
    )
    theirs = json.loads(done.stdout)
    assert unknown_keys(evrig.CameraReport, {k: v for k, v in theirs.items()
                                             if k not in ("name", "notes")}) == []
    assert report.n_events == theirs["n_events"] == 78830
    assert len(report.frame_coupling.bursts) == len(theirs["frame_coupling"]["bursts"]) > 0
    assert report.frame_coupling.bursts[0].row_us.value == pytest.approx(
        theirs["frame_coupling"]["bursts"][0]["row_us"]["value"]
    )
    assert "rows" in str(report) or "row" in str(report)
    assert evrig.camera_report(street).rates == report.rates
    assert evrig.camera_report(street.path).frame_coupling == report.frame_coupling


def test_a_calibration_has_constants_with_errors(street):
    calibration = street.calibrate(evaluations=0)
    assert len(calibration.k) == 6 and calibration.passages.k[0].standard_error > 0
    assert street.calibration() == calibration
    text = street._handle.calibration("aps")
    assert unknown_keys(evrig.Calibration, json.loads(text)) == []
    tuned = street.generate("tuned", k="@calibrated", progress=False)
    assert len(tuned) > 0


def test_frames_and_events_in_memory_become_a_session(tmp_path, pattern):
    frames, t_us = pattern
    events = evrig.generate(frames, t_us, seed=1)
    session = evrig.create_session(tmp_path / "s", frames, t_us, events)
    assert np.array_equal(session.frames().images, frames)
    assert np.array_equal(session.frames().t_us, t_us)
    assert np.array_equal(session.events().t, events.t)
    with pytest.raises(evrig.FileError, match="not empty"):
        evrig.create_session(tmp_path / "s", frames, t_us)
    with pytest.raises(evrig.ArgumentError, match="uint8 or uint16"):
        evrig.create_session(tmp_path / "t", frames.astype(float), t_us)
    with pytest.raises(evrig.ArgumentError, match="mixture"):
        evrig.diagnose(session, events=events)


def test_errors_have_the_text_of_the_command_line(tmp_path, street):
    for call, arguments, kind in [
        (lambda: evrig.open(tmp_path / "none"), ["info", tmp_path / "none"], evrig.SessionError),
        (
            lambda: street.compare("none"),
            ["compare", street.path, "--stream", "none"],
            evrig.SessionError,
        ),
        (
            lambda: street.generate(preset="DVS364"),
            ["generate", street.path, "--preset", "DVS364"],
            evrig.ArgumentError,
        ),
        (
            lambda: evrig.import_(tmp_path, tmp_path / "out", fps=1),
            ["import", "frames", tmp_path, "--fps", "1", "--out", tmp_path / "out"],
            evrig.FileError,
        ),
    ]:
        with pytest.raises(kind) as caught:
            call()
        words = [find_program(), *map(str, arguments)]
        done = subprocess.run(words, capture_output=True, text=True)
        assert done.stderr.strip() == f"error: {caught.value}"


def test_a_missing_stream_names_those_there_are(street):
    with pytest.raises(evrig.SessionError, match="real"):
        street.events("none")
    with pytest.raises(evrig.SessionError, match="aps"):
        street.frames("none")
    with pytest.raises(evrig.ArgumentError, match="name a stream"):
        street.generate("a/b")
    with pytest.raises(evrig.ArgumentError, match="baseline"):
        street.diagnose(baseline="none")
    assert street.diagnosis() is None and street.clock_map() is None and street.track() is None
    assert len(street.poses()) == 0


def test_an_interrupt_stops_a_diagnosis(street):
    def interrupt():
        time.sleep(1.0)
        os.kill(os.getpid(), signal.SIGINT)

    seen = []
    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        street.diagnose(progress=lambda *step: seen.append(step))
    thread.join()
    assert street.diagnosis() is None


def test_the_report_is_written(tmp_path, street):
    path = street.report(tmp_path / "report.html")
    assert path.read_text().rstrip().endswith("</html>")


#: Half a second of motion.
TRAJECTORY = """
schema = "evrig.trajectory/2"
name = "short"
plane = "image"
start = { x_mm = 240.0, y_mm = 0.0, z_mm = 100.0, r_deg = 90.0 }
rates = { speed_mm_per_s = 50.0, acceleration_mm_per_s2 = 200.0 }

[[segment]]
kind = "dwell"
label = "lead-in"
duration_s = 0.1

[[segment]]
kind = "line"
label = "there"
by_mm = [16.0, 0.0]

[[segment]]
kind = "dwell"
label = "tail"
duration_s = 0.1
"""


def test_a_recording_on_the_simulated_rig_is_read(tmp_path):
    rig = (ROOT / "rig/sim.toml").read_text()
    small = rig.replace("size_px = [692, 520]", "size_px = [160, 120]").replace("rgb = true", "rgb = false")
    assert small != rig
    (tmp_path / "rig.toml").write_text(small)
    (tmp_path / "short.toml").write_text(TRAJECTORY)
    out = tmp_path / "recorded"
    words = ["record", tmp_path / "rig.toml", tmp_path / "short.toml", "--out", out]
    done = subprocess.run([find_program(), *map(str, words)], capture_output=True, text=True)
    # A machine that is too slow for the arm's deadlines ends the recording early, and seals it too.
    assert (out / "session.json").exists(), done.stderr
    session = evrig.open(out)
    poses = session.poses()
    assert len(poses) > 3 and (np.diff(poses.t_ns) >= 0).all()
    commanded = session.poses(commanded=True)
    assert len(commanded) > 3 and np.isfinite(commanded.x_mm).all()
    frame = next(session.iter_frames("raw"))
    assert frame.image.shape == (120, 160) and frame.image.dtype == np.uint16
    assert frame.bits == 10 and frame.mosaic is not None and frame.exposure_ns is not None
    assert session.frames("raw").clock == "pi-sensor"


def test_the_guard_of_the_arm_is_a_process_of_the_package(tmp_path):
    """The guard owns the serial port, and stops the arm when its evrig is gone."""
    journal = tmp_path / "arm.jsonl"
    words = [find_program(), "emulate", "arm", "--homed", "--journal", str(journal)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as emulator:
        try:
            port = emulator.stdout.readline().strip()
            rig = (ROOT / "rig/sim.toml").read_text()
            rig = rig.replace('[arm]\nport = "sim"', f'[arm]\nport = "{port}"')
            assert port in rig
            (tmp_path / "rig.toml").write_text(rig)
            check = [find_program(), "check", str(tmp_path / "rig.toml"), "line"]
            done = subprocess.run(check, capture_output=True, text=True)
            assert "identity  evrig simulated arm" in done.stdout, done.stdout + done.stderr
            names = [json.loads(line)["name"] for line in journal.read_text().splitlines()]
            assert names[-2:].count("QUEUE_FORCE_STOP") + names[-2:].count("QUEUE_CLEAR") == 2
        finally:
            emulator.send_signal(signal.SIGINT)


def numbers_of_samples(path: str) -> tuple[int, int]:
    session = evrig.open(path)
    return len(session.events()), len(session.frames("aps"))


def test_a_forked_process_has_threads_of_its_own(street):
    """Workers of a DataLoader are forks of a process that used its threads before."""
    path = str(street.path)
    here = numbers_of_samples(path)
    with multiprocessing.get_context("fork").Pool(1) as workers:
        there = workers.apply_async(numbers_of_samples, (path,)).get(timeout=60)
    assert there == here
