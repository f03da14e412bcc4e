"""Plots of results with matplotlib, as the report draws them. Needs ``matplotlib``.

Each function draws into ``ax``, or into a new figure, and returns the axes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Optional, Union

import numpy as np

from ._errors import ArgumentError
from ._records import NotMeasured
from .camera import CameraReport
from .comparison import Comparison
from .diagnosis import Diagnosis
from .events import Events
from .session import Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_REAL, _SIMULATED = "C0", "C1"


def _axes(ax: Optional[Axes]) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def events(stream: Events, ax: Optional[Axes] = None) -> Axes:
    """ON minus OFF events of each pixel."""
    ax = _axes(ax)
    image = stream.image(signed=True)
    bound = max(1.0, float(np.quantile(np.abs(image), 0.995)))
    drawn = ax.imshow(image, cmap="RdBu_r", vmin=-bound, vmax=bound, interpolation="nearest")
    ax.figure.colorbar(drawn, ax=ax, label="ON minus OFF events")
    ax.set(xlabel="x (pixels)", ylabel="y (pixels)")
    return ax


def measures(comparison: Comparison, ax: Optional[Axes] = None) -> Axes:
    """Each measure with its 90 % interval and, shaded, its healthy range."""
    ax = _axes(ax)
    for i, measure in enumerate(comparison.measures):
        estimate = measure.estimate
        if measure.healthy is not None:
            ax.fill_betweenx([i - 0.3, i + 0.3], *measure.healthy, color="C2", alpha=0.2, lw=0)
        if np.isfinite(estimate.value):
            ax.plot(estimate.ci90, [i, i], color=_SIMULATED)
            ax.plot(estimate.value, i, "o", color=_SIMULATED)
    ax.set_yticks(range(len(comparison.measures)), [m.name for m in comparison.measures])
    ax.invert_yaxis()
    ax.set_xlabel("value with 90 % interval; shaded: healthy range")
    return ax


def rates(comparison: Comparison, ax: Optional[Axes] = None) -> Axes:
    """Events per second over time, by polarity, each with its band."""
    ax = _axes(ax)
    curve = comparison.curves.rate
    bands = {
        ("recorded ON", _REAL, "-"): curve.real_on,
        ("recorded OFF", _REAL, "--"): curve.real_off,
        ("simulated ON", _SIMULATED, "-"): curve.simulated_on,
        ("simulated OFF", _SIMULATED, "--"): curve.simulated_off,
    }
    for (name, colour, style), band in bands.items():
        t_s = (np.arange(len(band.hz)) + 0.5) * curve.bin_us * 1e-6
        ax.plot(t_s, band.hz, style, color=colour, label=name)
        ax.fill_between(t_s, band.low_hz, band.high_hz, color=colour, alpha=0.15, lw=0)
    ax.set(xlabel="time (s)", ylabel="events per second")
    ax.legend()
    return ax


def intervals(comparison: Comparison, ax: Optional[Axes] = None) -> Axes:
    """Densities of the intervals between events of a pixel, with the fitted law."""
    ax = _axes(ax)
    curve = comparison.curves.intervals
    edges = np.asarray(curve.edges_us)
    if len(edges) > 1:
        middle = np.sqrt(edges[1:] * edges[:-1])
        for name, density, colour in (
            ("recorded", curve.real, _REAL),
            ("simulated", curve.simulated, _SIMULATED),
        ):
            ax.step(middle, density.per_decade, where="mid", color=colour, label=name)
            if density.fit is not None:
                law = density.fit.inverse_gaussian_per_decade
                ax.plot(middle, law, ":", color=colour, label=f"{name}, inverse Gaussian")
        ax.legend()
    ax.set(xscale="log", xlabel="interval (µs)", ylabel="probability per decade")
    return ax


def diagnosis(found: Diagnosis, ax: Optional[Axes] = None) -> Axes:
    """Strata in which the model misfits: excess in nats per event."""
    ax = _axes(ax)
    strata = found.mismatch.strata[:12]
    ax.barh(range(len(strata)), [stratum.excess_nats_per_event for stratum in strata], color=_REAL)
    names = [f"{s.covariate} {s.range[0]:.3g} to {s.range[1]:.3g}" for s in strata]
    ax.set_yticks(range(len(strata)), names)
    ax.invert_yaxis()
    ax.set(xlabel="excess (nats per event)", title=found.verdict.replace("_", " "))
    return ax


def frame_coupling(report: CameraReport, ax: Optional[Axes] = None) -> Axes:
    """Bursts of events after the camera's frames, along their rows.

    Raises:
        ArgumentError: The report holds no bursts.
    """
    coupling: Union[NotMeasured, object] = report.frame_coupling
    bursts = getattr(coupling, "bursts", [])
    if not bursts:
        raise ArgumentError("report: expected one with bursts that follow the frames, got none")
    ax = _axes(ax)
    for burst in bursts:
        middle = [0.5 * (b.from_us + b.to_us) for b in burst.profile]
        counts = [b.n_on if burst.polarity == "ON" else b.n_off for b in burst.profile]
        label = f"{burst.polarity}, {burst.delay_us.value:.0f} µs, {burst.row_us.value:.2f} µs/row"
        ax.step(middle, counts, where="mid", label=label)
    ax.set(xlabel="delay after the line of the burst (µs)", ylabel="events")
    ax.legend()
    return ax


def refractory(report: CameraReport, ax: Optional[Axes] = None) -> Axes:
    """Hazard of the next event by the interval since the last, by polarities."""
    ax = _axes(ax)
    for onset in report.refractory:
        if not isinstance(onset, NotMeasured):
            middle = [np.sqrt(max(b.from_us, 0.5) * b.to_us) for b in onset.hazard]
            label = f"{onset.after} to {onset.to}: {onset.shape}"
            ax.step(middle, [b.hz for b in onset.hazard], where="mid", label=label)
    ax.set(xscale="log", xlabel="interval (µs)", ylabel="events per second of waiting")
    if ax.has_data():
        ax.legend()
    return ax


def track(path: Track, ax: Optional[Axes] = None) -> Axes:
    """Centre of the target image over time, with its standard error."""
    ax = _axes(ax)
    t_s = (path.t_ns - path.t_ns[0]) * 1e-9
    for i, name in enumerate("xy"):
        centre = path.polygon[:, :, i].mean(axis=1)
        error = path.polygon_error[:, :, i].max(axis=1)
        ax.plot(t_s, centre, label=name)
        ax.fill_between(t_s, centre - error, centre + error, alpha=0.2, lw=0)
    ax.set(xlabel="time (s)", ylabel="centre of the target (pixels)")
    ax.legend()
    return ax
