"""The result of a comparison of two event streams."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Dict, List, Optional, Tuple

import numpy as np
from numpy.typing import NDArray

from ._records import Estimate, Record, read

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Measure(Record):
    """One measure of a comparison, with its error.

    Attributes:
        id: Its key, as in docs/reference/measures.md.
        name: Its name.
        formula: Its definition.
        source: Where the definition comes from.
        unit: Its unit; empty for a number.
        estimate: Value, standard error, 90 % interval, and number of resampled clusters.
        unknown_because: Why there is no value.
        clusters: What was resampled: ``time_block`` or ``tile``.
        numerical_error: Error of the computation, where it is not negligible.
        chance_level: The value that two samples of one law would have.
        healthy: Range of a good simulation.
        real: The quantity of the real stream alone.
        simulated: The quantity of the simulated stream alone.
    """

    id: str
    name: str
    formula: str
    source: str
    unit: str
    estimate: Estimate
    unknown_because: Optional[str]
    clusters: str
    numerical_error: Optional[float] = None
    chance_level: Optional[float] = None
    healthy: Optional[Tuple[float, float]] = None
    real: Optional[float] = None
    simulated: Optional[float] = None

    @property
    def is_healthy(self) -> Optional[bool]:
        """Whether the value lies in the healthy range; None without a range or a value."""
        value = self.estimate.value
        if self.healthy is None or not np.isfinite(value):
            return None
        return self.healthy[0] <= value <= self.healthy[1]


@dataclass(frozen=True)
class IntervalFit(Record):
    """Laws fitted to the intervals between events of a pixel (µs)."""

    mean_us: Estimate
    shape_us: Estimate
    levy_scale_us: Estimate
    inverse_gaussian_over_levy_nats: Estimate
    inverse_gaussian_per_decade: List[float]
    levy_per_decade: List[float]


@dataclass(frozen=True)
class IntervalDensity(Record):
    """Probability per decade of the interval, by bin, with its standard error."""

    n: int
    n_zero: int
    per_decade: List[float]
    standard_error: List[float]
    fit: Optional[IntervalFit]


@dataclass(frozen=True)
class IntervalCurve(Record):
    """Distribution of the intervals between events of a pixel; edges of the bins in µs."""

    edges_us: List[float]
    distance_decades: Estimate
    real: IntervalDensity
    simulated: IntervalDensity


@dataclass(frozen=True)
class RateBand(Record):
    """Events per second in each bin with the ends of its band, and the index of dispersion."""

    hz: List[float]
    low_hz: List[float]
    high_hz: List[float]
    dispersion: float


@dataclass(frozen=True)
class RateCurve(Record):
    """Rates over time: start of the first bin and width of a bin in µs."""

    start_us: int
    bin_us: float
    real_on: RateBand
    real_off: RateBand
    simulated_on: RateBand
    simulated_off: RateBand


@dataclass(frozen=True)
class RateMapError(Record):
    """Difference of the pixels' rates: root mean square in events per second, and correlation."""

    rmse_hz: Estimate
    correlation: Estimate
    mean_real_hz: float


@dataclass(frozen=True)
class FrameCorrelation(Record):
    """Correlation of signed counts with the change of log intensity between two frames (µs)."""

    t_us: Tuple[int, int]
    real: Estimate
    simulated: Estimate


@dataclass(frozen=True)
class ContrastCorrelation(Record):
    """The same over all frame intervals, and for each."""

    real: Estimate
    simulated: Estimate
    per_interval: List[FrameCorrelation]


@dataclass(frozen=True)
class Curves(Record):
    """Curves of a comparison."""

    intervals: IntervalCurve
    rate: RateCurve
    rate_map: RateMapError
    contrast_correlation: Optional[ContrastCorrelation]


@dataclass(frozen=True)
class Comparison(Record):
    """Real against simulated events.

    Errors come from a bootstrap over time blocks or tiles of pixels, since events are not
    independent (docs/reference/measures.md).

    Attributes:
        window_us: The time that was compared, µs, end exclusive.
        n_pixels: Pixels that were compared.
        n_real: Real events in it.
        n_simulated: Simulated events in it.
        seed: Seed of the resampling.
        n_bootstrap: Number of resamplings.
        measures: The measures.
        curves: Curves.
        maps: Number of events of each pixel, uint32, shape (height, width), by ``real_on``,
            ``real_off``, ``simulated_on``, ``simulated_off``.
    """

    schema: str
    window_us: Tuple[int, int]
    n_pixels: int
    n_real: int
    n_simulated: int
    seed: int
    n_bootstrap: int
    measures: List[Measure]
    curves: Curves
    maps: Dict[str, NDArray[np.uint32]] = field(default_factory=dict, repr=False)
    text: str = field(default="", repr=False)

    def __getitem__(self, id: str) -> Measure:
        """The measure with this id, as ``comparison["count_ratio"]``."""
        for measure in self.measures:
            if measure.id == id:
                return measure
        raise KeyError(f"{id}; there are {', '.join(measure.id for measure in self.measures)}")

    def __str__(self) -> str:
        return self.text

    def to_pandas(self) -> pandas.DataFrame:
        """A row per measure with value, standard_error, low, high (90 %), healthy, real and
        simulated."""
        import pandas

        rows = [
            {
                "id": measure.id,
                "value": measure.estimate.value,
                "standard_error": measure.estimate.standard_error,
                "low": measure.estimate.ci90[0],
                "high": measure.estimate.ci90[1],
                "unit": measure.unit,
                "healthy": measure.is_healthy,
                "real": measure.real,
                "simulated": measure.simulated,
                "unknown_because": measure.unknown_because,
            }
            for measure in self.measures
        ]
        return pandas.DataFrame(rows).set_index("id")


def comparison_of(
    found: Tuple[str, str, Tuple[NDArray[np.uint32], ...]], size: Optional[Tuple[int, int]]
) -> Comparison:
    """The result of the library with its maps on the pixel grid."""
    text, words, maps = found
    names = ("real_on", "real_off", "simulated_on", "simulated_off")
    shape = (-1,) if size is None or maps[0].size != size[0] * size[1] else (size[1], size[0])
    shaped = {name: counts.reshape(shape) for name, counts in zip(names, maps)}
    return replace(read(Comparison, text), maps=shaped, text=words)
