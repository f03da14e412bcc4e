"""What events show of their camera; a section is :class:`NotMeasured` where the events are too few."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Dict, List, Optional, Tuple, Union

from ._records import Estimate, NotMeasured, Record


@dataclass(frozen=True)
class SensorGap(Record):
    """A time without events that chance does not explain, µs."""

    begin_us: int
    length_us: int
    mean_interval_us: float
    false_alarm_probability: float


@dataclass(frozen=True)
class StreamRates(Record):
    """First and last stamp (µs), duration, rates (events per second) and gaps."""

    first_us: int
    last_us: int
    duration_s: float
    on_hz: Estimate
    off_hz: Estimate
    per_pixel_hz: float
    gaps: List[SensorGap]
    longest_gap_us: int


@dataclass(frozen=True)
class StampStep(Record):
    """Common step of the time stamps, µs, and how well they agree with it."""

    step_us: float
    is_exact: bool
    coherence: float


@dataclass(frozen=True)
class StampTies(Record):
    """Events with equal stamps, and the order of readout that they show."""

    share: Estimate
    share_by_chance: float
    same_row_share: Estimate
    row_order: str
    column_order: str


@dataclass(frozen=True)
class HotPixel(Record):
    """A pixel with far more events than its neighbours."""

    x: int
    y: int
    rate_hz: Estimate
    neighbour_events: int
    on_share: float
    false_alarm_probability: float


@dataclass(frozen=True)
class PixelOutliers(Record):
    """Hot and silent pixels."""

    hot: List[HotPixel]
    hot_share: Estimate
    silent: List[Tuple[int, int]]
    n_without_events: int
    n_testable: int
    n_pixels: int


@dataclass(frozen=True)
class ProfileBin(Record):
    """ON and OFF events in a bin of the delay after a frame, µs."""

    from_us: float
    to_us: float
    n_on: int
    n_off: int


@dataclass(frozen=True)
class BurstWake(Record):
    """Missing share of the rate after a burst, and the time constant of its recovery (µs)."""

    depth: Estimate
    recovery_us: Estimate
    z: float


@dataclass(frozen=True)
class CouplingBurst(Record):
    """A burst of events that follows the camera's frames, row after row (delays in µs)."""

    polarity: str
    delay_us: Estimate
    row_us: Estimate
    width_us: Estimate
    share: Estimate
    other_polarity_share: Estimate
    z: float
    frames_z: float
    false_alarm_probability: float
    halves: List[Estimate] = field(repr=False)
    halves_z: List[float] = field(repr=False)
    wake: Optional[BurstWake]
    window_us: Tuple[float, float]
    profile: List[ProfileBin] = field(repr=False)


@dataclass(frozen=True)
class RejectedBurst(Record):
    """A candidate that chance does not explain and a check rejects, and which."""

    polarity: str
    delay_us: float
    row_us: float
    reason: str


@dataclass(frozen=True)
class FrameCoupling(Record):
    """Events that follow the camera's own frames; period in µs, events ON and OFF."""

    reference: str
    frame_period_us: float
    n_frames: int
    n_events: Tuple[int, int]
    n_trials: float
    bursts: List[CouplingBurst]
    rejected: List[RejectedBurst]


@dataclass(frozen=True)
class HazardBin(Record):
    """Events per second of waiting, in a range of the interval (µs)."""

    from_us: float
    to_us: float
    n: int
    hz: float


@dataclass(frozen=True)
class RefractoryOnset(Record):
    """Onset of the interval between two events of a pixel, by their polarities (µs).

    Attributes:
        after: What begins the interval: ``on``, ``off`` or ``frame_burst``.
        to: Polarity of the event that ends it.
        shape: ``absent``, ``hard`` or ``soft``.
        period_us: Interval at which the hazard is half of its highest value.
        width_us: Time in which it rises from 10 to 90 %.
        is_stable: Whether halves of time and pixels agree.
        upper_bound_us: Largest period that the data allow where they show none.
    """

    after: str
    to: str
    n_intervals: int
    shortest_us: List[float]
    shape: str
    period_us: Estimate
    width_us: Estimate
    rise_us: Tuple[float, float]
    is_stable: bool
    upper_bound_us: Optional[float]
    z: float
    false_alarm_probability: float
    halves_us: List[Estimate] = field(repr=False)
    hazard: List[HazardBin] = field(repr=False)


@dataclass(frozen=True)
class IsolatedEventRates(Record):
    """Rates of events without others near them, per pixel and second."""

    on_hz: Estimate
    off_hz: Estimate
    window_us: float
    empty_share: float


@dataclass(frozen=True)
class RateLine(Record):
    """A periodic change of the rate; the tile is column and row in a 4 x 4 grid."""

    frequency_hz: Estimate
    amplitude: Estimate
    series: str
    tile: Optional[Tuple[int, int]]
    false_alarm_probability: float


@dataclass(frozen=True)
class RateLines(Record):
    """Flicker, and how weak a line could be found."""

    lines: List[RateLine]
    resolution_hz: float
    max_hz: float
    n_trials: float
    detectable_amplitude: float
    spectrum: List[Tuple[float, float]] = field(repr=False)


@dataclass(frozen=True)
class ReadoutLimits(Record):
    """Highest rates, and a ceiling where the readout has one."""

    max_per_ms: int
    mean_per_ms: float
    scatter_at_peak: Estimate
    ceiling_hz: Optional[Estimate]
    service_us: Optional[Estimate]


@dataclass(frozen=True)
class ThresholdRatio(Record):
    """Balance of ON and OFF thresholds over the busiest pixels."""

    on_over_off: Estimate
    n_pixels: int
    on_share: float


@dataclass(frozen=True)
class CameraReport(Record):
    """What the events alone show of the camera (docs/how-to/camera-report.md).

    Attributes:
        n_events: Events of the stream.
        size: ``width`` and ``height`` of the sensor.
        rates: Duration, rates and gaps.
        stamp_step: Common step of the stamps.
        stamp_ties: Equal stamps and the order of readout.
        pixels: Hot and silent pixels.
        frame_coupling: Events that follow the camera's own frames.
        refractory: Onset of the interval between two events, by their polarities.
        background: Rates of isolated events.
        rate_lines: Flicker.
        readout: Limits of the readout.
        threshold_ratio: Balance of ON and OFF.
    """

    schema: str
    n_events: int
    size: Dict[str, int]
    rates: StreamRates
    stamp_step: Union[StampStep, NotMeasured]
    stamp_ties: Union[StampTies, NotMeasured]
    pixels: Union[PixelOutliers, NotMeasured]
    frame_coupling: Union[FrameCoupling, NotMeasured]
    refractory: List[Union[RefractoryOnset, NotMeasured]]
    background: Union[IsolatedEventRates, NotMeasured]
    rate_lines: Union[RateLines, NotMeasured]
    readout: Union[ReadoutLimits, NotMeasured]
    threshold_ratio: Union[ThresholdRatio, NotMeasured]
    text: str = field(default="", repr=False)

    def __str__(self) -> str:
        return self.text
