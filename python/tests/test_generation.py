"""Events from frames."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest

import evrig


def columns_equal(a: evrig.Events, b: evrig.Events) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a.columns, b.columns))


def test_events_are_typed_columns_in_ascending_time(pattern):
    frames, t_us = pattern
    events = evrig.generate(frames, t_us, seed=7)
    assert [column.dtype.str for column in events.columns] == ["<i8", "<u2", "<u2", "|b1"]
    assert len(events) > 1000 and events.size == (64, 48)
    assert (np.diff(events.t) >= 0).all() and t_us[0] < events.t[0] and events.t[-1] <= t_us[-1]
    assert 0.2 < events.n_on / len(events) < 0.8


def test_columns_own_the_memory_of_the_library(pattern):
    events = evrig.generate(*pattern)
    for column in events.columns:
        assert column.base is not None and not column.flags.owndata and column.flags.c_contiguous


@pytest.mark.parametrize("model", ["voltmeter", "esim", "v2e"])
def test_frame_by_frame_gives_the_same_events(pattern, model):
    frames, t_us = pattern
    at_once = evrig.generate(frames, t_us, model=model, seed=3)
    streamed = evrig.generate(iter(frames), iter(t_us), model=model, seed=3)
    generator = evrig.Generator(model=model, seed=3, threads=1)
    parts = [generator.push(frame, t) for frame, t in zip(frames, t_us)]
    assert len(parts[0]) == 0 and columns_equal(at_once, streamed)
    assert np.array_equal(np.concatenate([part.t for part in parts]), at_once.t)


def test_types_and_strides_of_frames_do_not_matter(pattern):
    frames, t_us = pattern
    expected = evrig.generate(frames, t_us)
    padded = np.zeros((40, 48, 96), np.uint8)
    padded[:, :, :64] = frames
    for same in (
        frames.astype(np.uint16),
        frames.astype(np.float32),
        frames.astype(np.float64),
        np.asfortranarray(frames),
        padded[:, :, :64],
        frames[::-1].copy()[::-1],
    ):
        assert columns_equal(evrig.generate(same, t_us), expected)


def test_a_seed_gives_its_own_events(pattern):
    assert columns_equal(evrig.generate(*pattern, seed=1), evrig.generate(*pattern, seed=1))
    assert not columns_equal(evrig.generate(*pattern, seed=1), evrig.generate(*pattern, seed=2))


def test_the_choice_of_a_model_acts(pattern):
    few = evrig.generate(*pattern, model="esim")
    assert len(few) != len(evrig.generate(*pattern, preset="DVS240"))
    k = (5.265, 20, 1e-4, 1e-7, 5e-9, 1e-5)
    assert columns_equal(evrig.generate(*pattern, k=k), evrig.generate(*pattern, preset="DVS346"))
    insensitive = evrig.generate(*pattern, knobs={"event-sensitivity": 1})
    sensitive = evrig.generate(*pattern, knobs={"event-sensitivity": 10})
    assert len(insensitive) < len(sensitive)


def test_rows_of_a_rolling_shutter_are_shifted(pattern):
    frames, t_us = pattern
    still = evrig.generate(frames, t_us)
    rolled = evrig.generate(frames, t_us, row_us=50.0)
    shift = np.rint((still.y.astype(float) - 24) * 50).astype(np.int64)
    assert len(rolled) == len(still)
    assert np.array_equal(np.sort(still.t + shift), rolled.t)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frames": np.zeros((3, 4), np.uint8)}, ["frames", "(3, 4)"]),
        ({"frames": np.zeros((3, 4, 5), np.int64)}, ["frames", "uint8", "int64"]),
        ({"frames": np.zeros((0, 4, 5), np.uint8)}, ["frames", "at least two"]),
        ({"frames": np.zeros((3, 0, 5), np.uint8)}, ["frames", "0 x 5"]),
        ({"frames": np.full((3, 4, 5), np.nan, np.float32)}, ["frames", "NaN", "(0, 0)"]),
        ({"frames": np.full((3, 4, 5), -1.0)}, ["frames", "-1"]),
        ({"t_us": [0, 1]}, ["t_us", "3 times", "got 2"]),
        ({"t_us": [0.0, 1.0, 2.0]}, ["t_us", "integers", "float64"]),
        ({"t_us": [0, 2, 1]}, ["frame 2", "not later"]),
        ({"t_us": np.array([[0, 1, 2]])}, ["t_us", "(1, 3)"]),
        ({"model": "voltmetre"}, ["voltmetre", "voltmeter"]),
        ({"preset": "DVS364"}, ["DVS364", "DVS346"]),
        ({"k": (1, 2)}, ["2 numbers", "six"]),
        ({"k": "1,2,3,4,5,6"}, ["k:", "text"]),
        ({"seed": -1}, ["seed", "-1"]),
        ({"seed": 1.5}, ["seed", "1.5"]),
        ({"threads": 0}, ["threads", "0"]),
        ({"row_us": float("nan")}, ["row_us", "nan"]),
        ({"interpolate_us": 1}, ["interpolate_us", "10"]),
        ({"progress": 3}, ["progress", "int"]),
    ],
)
def test_a_wrong_argument_is_named_with_what_was_expected_and_given(change, words):
    frames = np.ones((3, 4, 5), np.uint8)
    given = {"frames": frames, "t_us": [0, 1000, 2000], **change}
    with pytest.raises(evrig.ArgumentError) as caught:
        evrig.generate(given.pop("frames"), given.pop("t_us"), **given)
    for word in words:
        assert word in str(caught.value), caught.value
    assert isinstance(caught.value, ValueError) and isinstance(caught.value, evrig.Error)


def test_a_refused_frame_changes_nothing(pattern):
    frames, t_us = pattern
    generator, other = evrig.Generator(), evrig.Generator()
    generator.push(frames[0], t_us[0])
    other.push(frames[0], t_us[0])
    for wrong in (frames[1][:10], np.full((48, 64), np.nan)):
        with pytest.raises(evrig.ArgumentError):
            generator.push(wrong, int(t_us[1]))
    assert columns_equal(generator.push(frames[1], t_us[1]), other.push(frames[1], t_us[1]))


def test_progress_is_reported_in_order(pattern):
    seen = []
    evrig.generate(*pattern, progress=lambda *step: seen.append(step))
    assert seen == [("generate", i + 1, 40) for i in range(40)]


def test_an_exception_of_the_callback_stops_the_work(pattern):
    class Stopped(Exception):
        pass

    def stop(step, done, total):
        raise Stopped

    with pytest.raises(Stopped):
        evrig.generate(*pattern, progress=stop)


def test_other_threads_run_and_an_interrupt_stops_the_work():
    frame = np.random.default_rng(1).integers(0, 255, (400, 400), dtype=np.uint8)
    frames = np.broadcast_to(frame, (100_000, 400, 400))
    ran = []

    def interrupt():
        time.sleep(0.3)
        ran.append(True)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        evrig.generate(frames, np.arange(100_000) * 1000)
    thread.join()
    assert ran


def test_effects_act_as_their_parameters_say(pattern):
    frames, t_us = pattern
    plain = evrig.simulate_effects(frames, t_us, {}, seed=5)
    held = evrig.simulate_effects(
        frames, t_us, {"refractory_period": {"refractory_us": 20_000}}, seed=5
    )
    same = evrig.simulate_effects(frames, t_us, ["refractory_period:refractory_us=20000"], seed=5)
    assert columns_equal(held, same) and 0 < len(held) < len(plain)
    pixel = held.y.astype(int) * 64 + held.x
    order = np.lexsort((held.t, pixel))
    gaps = np.diff(held.t[order])[np.diff(pixel[order]) == 0]
    assert gaps.min() >= 20_000


def test_the_library_of_effects_lists_keys():
    library = evrig.effect_library()
    assert library["refractory_period"] == ["refractory_us"] and len(library) > 30


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ({"refractory": {"refractory_us": 1}}, ["effects", "refractory"]),
        ({"refractory_period": {"refractory_us": -1}}, ["refractory_us", "-1"]),
        ({"refractory_period": {"refractory_us": float("nan")}}, ["effects", "nan"]),
        (["refractory_period:refractory_us=x"], ["effects", "=x"]),
        ({"aps_coupling": {}}, ["aps_coupling"]),
    ],
)
def test_a_wrong_effect_is_named(pattern, effects, words):
    with pytest.raises(evrig.ArgumentError) as caught:
        evrig.simulate_effects(*pattern, effects)
    assert all(word in str(caught.value) for word in words), caught.value
