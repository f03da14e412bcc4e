"""Helpers for other packages; each test is skipped where its package is not installed."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import evrig


def test_plots_draw_what_they_are_given(street, recording):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from evrig import plot

    street.generate("plotted", seed=3, progress=False)
    comparison = street.compare("plotted")
    report = evrig.camera_report(recording)
    events = street.events()
    image = plot.events(events).images[0].get_array()
    assert int(np.asarray(image).sum()) == 2 * events.n_on - len(events)
    assert len(plot.measures(comparison).get_yticks()) == len(comparison.measures)
    curve = plot.rates(comparison).lines[0].get_ydata()
    assert np.allclose(curve, comparison.curves.rate.real_on.hz)
    assert len(plot.intervals(comparison).lines) == 4
    assert len(plot.frame_coupling(report).lines) == len(report.frame_coupling.bursts)
    known = [onset for onset in report.refractory if onset]
    assert len(plot.refractory(report).lines) == len(known)


def test_a_report_without_bursts_has_no_plot_of_them(pattern):
    pytest.importorskip("matplotlib")
    from evrig import plot

    with pytest.raises(evrig.ArgumentError, match="bursts"):
        plot.frame_coupling(evrig.camera_report(evrig.generate(*pattern)))


def test_a_dataset_of_windows_serves_workers(street, tmp_path):
    torch = pytest.importorskip("torch")
    from evrig.torch import EventsDataset

    dataset = EventsDataset(street.path.parent, 100_000)
    events = street.events()
    first = dataset[0]
    assert first["t"].dtype == torch.int64 and first["p"].dtype == torch.bool
    within = events.between(int(events.t[0]), int(events.t[0]) + 100_000)
    assert torch.equal(first["x"], torch.from_numpy(within.x.astype(np.int32)))
    counted = EventsDataset(street.path.parent, 100_000, transform=len)
    loader = torch.utils.data.DataLoader(counted, batch_size=None, num_workers=2)
    counts = [int(count) for count in loader]
    assert counts == [counted[i] for i in range(len(counted))] and sum(counts) > 0
    assert sum(counts) <= len(events) and len(pickle.loads(pickle.dumps(counted))) == len(counted)
    with pytest.raises(evrig.SessionError, match="none"):
        EventsDataset(street.path, 1000, stream="none")
    with pytest.raises(evrig.ArgumentError, match="window_us"):
        EventsDataset(street.path, 0)


def test_transforms_of_tonic_take_the_events(street):
    transforms = pytest.importorskip("tonic.transforms")
    events = street.events().between(*street.events().t[[0, 5000]].tolist())
    frame = transforms.ToFrame(sensor_size=(346, 260, 2), event_count=len(events))(events.to_tonic())
    assert frame.shape == (1, 2, 260, 346) and int(frame.sum()) == len(events)


def test_rerun_logs_every_window(street, tmp_path):
    rerun = pytest.importorskip("rerun")
    from evrig.rerun import log_events, log_session

    rerun.init("evrig_test")
    path = tmp_path / "street.rrd"
    rerun.save(path)
    events = street.events()
    n = log_events(events, window_us=100_000)
    assert n == (events.t[-1] - events.t[0]) // 100_000 + 1
    log_session(street, window_us=200_000)
    rerun.disconnect()
    assert path.stat().st_size > 100_000
    with pytest.raises(evrig.ArgumentError, match="got none"):
        log_events(events[:0])
