"""Events as columns, and files of events."""

from __future__ import annotations

import numpy as np
import pytest

import evrig

T, X, Y, P = [10, 20, 20], [0, 1, 2], [2, 1, 0], [1, 0, 1]


def test_columns_of_the_right_types_are_taken_as_they_are():
    t, x, y = np.arange(3), np.zeros(3, np.uint16), np.zeros(3, np.uint16)
    p = np.ones(3, bool)
    events = evrig.Events(t, x, y, p, (4, 4))
    assert all(a is b for a, b in zip(events.columns, (t, x, y, p)))
    assert np.shares_memory(events[1:].t, t)


def test_forms_of_events_are_the_same_events():
    events = evrig.Events(T, X, Y, P, (3, 3))
    for form in (events.to_structured(), events.to_array(), events.to_tonic()):
        again = evrig.Events.of(form)
        assert all(np.array_equal(a, b) for a, b in zip(again.columns, events.columns))
    signed = evrig.Events(T, X, Y, [1, -1, 1])
    assert signed.p.tolist() == [True, False, True] and signed.n_on == 2


def test_pandas_and_xarray_hold_the_columns():
    events = evrig.Events(T, X, Y, P, (3, 3))
    pandas = pytest.importorskip("pandas")
    table = events.to_pandas()
    assert isinstance(table, pandas.DataFrame) and table["t"].tolist() == T
    assert np.array_equal(evrig.Events.of(table).x, X)
    pytest.importorskip("xarray")
    dataset = events.to_xarray()
    assert dataset.sizes["event"] == 3 and dataset.attrs["width"] == 3


def test_images_count_events_per_pixel():
    events = evrig.Events(T, X, Y, P, (3, 3))
    assert events.image().sum() == 3 and events.image(signed=True).sum() == 1
    assert events.image(signed=True)[1, 1] == -1
    with pytest.raises(evrig.ArgumentError, match="size"):
        evrig.Events(T, X, Y, P).image()


def test_windows_and_masks():
    events = evrig.Events(T, X, Y, P, (3, 3))
    assert len(events.between(10, 20)) == 1 and len(events.between(20, 21)) == 2
    assert events[events.p].n_on == 2 and len(events[np.array([2])]) == 1


def test_sorting_keeps_the_order_within_a_microsecond():
    events = evrig.Events([5, 3, 5, 3], [0, 1, 2, 3], [0] * 4, [1] * 4)
    assert events.sorted().x.tolist() == [1, 3, 0, 2]
    with pytest.raises(evrig.ArgumentError, match="index 1"):
        events.check()


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ((T, X, Y, P[:2]), ["one length", "'p': 2"]),
        (([0.5, 1, 2], X, Y, P), ["t:", "integers", "float64"]),
        ((T, [-1, 0, 1], Y, P), ["x:", "0 to 65535", "-1"]),
        ((T, X, [0, 1, 70_000], P), ["y:", "70000"]),
        ((T, X, Y, [0, 1, 2]), ["p:", "[0, 1, 2]"]),
        ((T, X, Y, [0.0, 1.0, 1.0]), ["p:", "float64"]),
        ((T, X, Y, np.array([0, 1, 2], np.uint8).view(bool)), ["p:", "bytes"]),
        ((np.zeros((3, 1), int), X, Y, P), ["t:", "(3, 1)"]),
    ],
)
def test_a_wrong_column_is_named(columns, words):
    with pytest.raises(evrig.ArgumentError) as caught:
        evrig.Events(*columns)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize("form", [3, "text", [1, 2], np.zeros((3, 3)), {"t": [1]}])
def test_what_is_no_events_is_refused(form):
    with pytest.raises(evrig.ArgumentError, match="events: expected Events"):
        evrig.Events.of(form)


def test_an_empty_stream_is_a_stream():
    empty = evrig.Events([], [], [], [], (3, 3))
    assert len(empty) == 0 and empty.image().sum() == 0 and len(empty.to_array()) == 0
    with pytest.raises(evrig.ArgumentError, match="no events"):
        evrig.camera_report(empty)


def test_files_give_the_events_that_were_saved(tmp_path, street):
    events = street.events()
    assert len(events) == 78830 and events.size == (346, 260)
    path = tmp_path / "events.npz"
    events.save(path)
    again = evrig.read_events(path, size=(346, 260))
    assert all(np.array_equal(a, b) for a, b in zip(again.columns, events.columns))


def test_a_recording_gives_events_and_the_times_of_its_frames(recording):
    events = evrig.read_events(recording)
    assert len(events) == 78830 and len(events.frame_starts_us) == 59
    assert events.frame_reference == "exposure_start"
    assert not events.t.flags.owndata


@pytest.mark.parametrize("content", [b"", b"hello", b"\x93NUMPY\x01\x00broken"])
@pytest.mark.parametrize("ending", ["npz", "txt", "aedat4", "h5", "parquet", "xyz"])
def test_a_file_of_another_kind_is_refused_by_name(tmp_path, content, ending):
    path = tmp_path / f"file.{ending}"
    path.write_bytes(content)
    with pytest.raises(evrig.FileError, match=f"file.{ending}"):
        evrig.read_events(path)


def test_a_missing_file_and_a_wrong_option_are_named(tmp_path, recording):
    with pytest.raises(evrig.FileError, match="none.npz"):
        evrig.read_events(tmp_path / "none.npz")
    with pytest.raises(evrig.ArgumentError, match="time_unit"):
        evrig.read_events(recording, time_unit="weeks")
    with pytest.raises(evrig.ArgumentError, match="size"):
        evrig.read_events(recording, size=(0, 3))
    with pytest.raises(evrig.ArgumentError, match="path: expected a path"):
        evrig.read_events(3)
