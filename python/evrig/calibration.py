"""The result of a calibration of the voltmeter's constants."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Dict, List, Optional, Tuple

from ._records import Record

if TYPE_CHECKING:
    import pandas

K = Tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Constant(Record):
    """One constant with its standard error and its 90 and 95 % intervals.

    The units of k1 to k6 are those of the event model (docs/reference/generators.md)."""

    value: float
    standard_error: float
    ci90: Tuple[float, float]
    n: int
    ci95: Tuple[float, float]


@dataclass(frozen=True)
class CandidateConstants(Record):
    """Constants with their objective on training and on held-out tiles; less is better."""

    name: str
    k: K
    train: Optional[float]
    held_out: Optional[float]


@dataclass(frozen=True)
class PixelSplit(Record):
    """Training and held-out pixels."""

    how: str
    n_train_pixels: int
    n_held_out_pixels: int
    n_unusable_pixels: int


@dataclass(frozen=True)
class PassageFit(Record):
    """The fit over whole passages between events, unbiased under the model.

    Attributes:
        k: k1 to k6.
        drift_correlation: Correlations of the errors of k1, k2, k4 and k5.
        diffusion_correlation: Correlation of the errors of k3 and k6.
        n_used: Passages used.
        n_open: Passages left out because they might not have ended within the recording.
        variance_ratio: Residual variance over that of the model; 1 where the model holds.
        share_far: Share of passages with a residual above half a threshold.
    """

    k: List[Constant]
    drift_correlation: List[List[float]]
    diffusion_correlation: float
    n_used: int
    n_open: int
    variance_ratio: float
    share_far: float


@dataclass(frozen=True)
class BinFit(Record):
    """First-passage law of the samples in a bin of brightness (DN) and its change (DN/µs)."""

    mean_dn: float
    change_dn_per_us: float
    n: float
    law: str
    drift_per_us: float
    sigma_per_sqrt_us: float


@dataclass(frozen=True)
class RegressionLine(Record):
    """A line of the first regression: thresholds per DN, and per µs."""

    mean_dn: float
    slope: float
    intercept_per_us: float
    n: float


@dataclass(frozen=True)
class Histogram(Record):
    """Intervals of a bin: edges in µs, probability per decade."""

    point: int
    edges_us: List[float]
    per_decade: List[float]


@dataclass(frozen=True)
class Regressions(Record):
    """The published procedure: three regressions over first-passage laws of bins."""

    k: List[Constant]
    k1_prime: Constant
    agreement: Constant
    points: List[BinFit] = field(repr=False)
    lines: List[RegressionLine] = field(repr=False)
    histograms: List[Histogram] = field(repr=False)


@dataclass(frozen=True)
class Preparation(Record):
    """How frames have to be prepared for the constants to hold."""

    colour: str = "mosaic"
    subtract_black: bool = False
    divide_exposure: bool = False


@dataclass(frozen=True)
class Calibration(Record):
    """Constants k1 to k6 fitted to recorded events, with errors.

    Attributes:
        k: The constants to generate with: the best candidate on the training tiles.
        source: Which candidate that is: ``published``, ``regressions``, ``passages`` or ``search``.
        objective: What was minimised.
        n_evaluations: Evaluations of the search.
        candidates: All candidates.
        split: Training and held-out pixels.
        passages: The fit over whole passages, with errors.
        regressions: The published regressions; None where too few bins were filled.
        without_regressions: Why there are none.
        preparation: How frames have to be prepared for the constants to hold.
    """

    schema: str
    k: K
    source: str = field(metadata={"key": "from"})
    objective: str
    n_evaluations: int
    candidates: List[CandidateConstants]
    split: PixelSplit
    passages: PassageFit
    regressions: Optional[Regressions]
    without_regressions: Optional[str]
    preparation: Preparation = field(default_factory=Preparation)

    def to_pandas(self) -> pandas.DataFrame:
        """A row per constant: value, standard_error, low95 and high95 of the passage fit, and k."""
        import pandas

        rows: List[Dict[str, object]] = [
            {
                "constant": f"k{i + 1}",
                "value": constant.value,
                "standard_error": constant.standard_error,
                "low95": constant.ci95[0],
                "high95": constant.ci95[1],
                "used": self.k[i],
            }
            for i, constant in enumerate(self.passages.k)
        ]
        return pandas.DataFrame(rows).set_index("constant")
