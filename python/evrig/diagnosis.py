"""The result of a diagnosis; log-likelihoods are in nats per event on held-out cells."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple

from ._records import Record

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Interval(Record):
    """An estimate with the ends of its 90 % interval; None where an end is unknown."""

    value: float
    ci90: Tuple[Optional[float], Optional[float]]


@dataclass(frozen=True)
class MisfitStratum(Record):
    """A range of a covariate in which the model misfits.

    Attributes:
        covariate: The covariate.
        range: Its range.
        excess_nats_per_event: Gain of a recalibration there, per event of all events.
        innovation_thresholds: Mean change of the signal beyond the threshold: positive for late
            events.
        ratio: Recorded over simulated events, where their numbers are compared.
        n_events: Events in it.
        description: The finding in a sentence.
    """

    covariate: str
    range: Tuple[float, float]
    excess_nats_per_event: float
    innovation_thresholds: Optional[float]
    n_events: int
    description: str
    ratio: Optional[float] = None


@dataclass(frozen=True)
class Mismatch(Record):
    """Misfit of a model: upper bound minus its score, the chance of such a gain without a mismatch,
    and the strata, largest excess first."""

    excess_nats_per_event: float
    p_value: float
    strata: List[MisfitStratum] = field(metadata={"key": "where"})


@dataclass(frozen=True)
class CompetingHypothesis(Record):
    """Another effect fitted in place of a named one, and its gain."""

    id: str
    heldout_gain_nats_per_event: float


@dataclass(frozen=True)
class FittedEffect(Record):
    """A named effect.

    Attributes:
        id: Its key (docs/reference/effects.md).
        name: Its name.
        equation: Its equation.
        description: The finding in a sentence.
        parameters: Estimates by key; the key ends in the unit.
        heldout_gain_nats_per_event: Gain over the model with the effects before it.
        heldout_gain_error: Standard error of the gain.
        p_value: Chance of such a gain without the effect, for the size of the library.
        indistinguishable: Effects that are not significantly worse in its place.
        competing_hypotheses: Effects tried in its place, best first.
    """

    id: str
    name: str
    equation: str
    description: str
    parameters: Dict[str, Interval]
    heldout_gain_nats_per_event: float
    heldout_gain_error: float
    p_value: float
    indistinguishable: List[str]
    competing_hypotheses: List[CompetingHypothesis]


@dataclass(frozen=True)
class HeldOutScores(Record):
    """Held-out log-likelihoods of baseline and final model, and their upper bound."""

    baseline: float
    final: float
    upper_bound: float
    upper_bound_source: str


@dataclass(frozen=True)
class FitReport(Record):
    """Improvement of the model; the share is None without an excess."""

    heldout_nats_per_event: HeldOutScores
    share_of_excess_removed: Optional[float]
    forward_simulation: Dict[str, Dict[str, Any]]


@dataclass(frozen=True)
class ResidualStructure(Record):
    """Classifier two-sample test between recorded and simulated events (log-loss gain)."""

    nats_per_event: float
    error: float
    accuracy: float
    top_features: List[str]
    nats_without_light_features: Optional[float] = None


@dataclass(frozen=True)
class ResidualStructureReport(Record):
    """Residual structure of both models."""

    baseline: ResidualStructure
    final: ResidualStructure


@dataclass(frozen=True)
class RejectedEffect(Record):
    """An effect with a gain that failed a test, and which."""

    id: str
    heldout_gain_nats_per_event: float
    because: str


@dataclass(frozen=True)
class ProposedTerm(Record):
    """A term outside the library that would reduce the residual mismatch."""

    enters: str
    depends_on: str
    curve: List[List[float]]
    heldout_gain_nats_per_event: float


@dataclass(frozen=True)
class UntestableEffect(Record):
    """An effect that the session cannot test, and why."""

    id: str
    because: str


@dataclass(frozen=True)
class Diagnosis(Record):
    """Which physical effects the model of a recording lacks (docs/explanation/diagnosis.md).

    Attributes:
        verdict: ``no_mismatch``, ``minor_mismatch``, ``explained``, ``partly_explained`` or
            ``unexplained``.
        mismatch: Misfit of the model without effects.
        effects: Named effects in the order in which they were accepted.
        nuisances: Constants of the final model.
        at_range_end: Nuisances at an end of their ordinary range.
        fit: Improvement of the model.
        residual_mismatch: Misfit of the final model.
        proposed_term: A term outside the library that would help.
        next_recording: A recording that would separate indistinguishable effects.
        cannot_judge: Effects that this recording cannot test.
        rejected_effects: Effects with a gain that failed a test.
        stamp_step_us: Grid of the time stamps, µs; None without one.
        structure: Classifier two-sample test of both models.
        n_pixels: Pixels analysed.
        n_events: Their events.
    """

    schema: str
    verdict: str
    mismatch: Mismatch
    effects: List[FittedEffect]
    nuisances: Dict[str, Interval]
    fit: FitReport
    residual_mismatch: Mismatch
    proposed_term: Optional[ProposedTerm]
    next_recording: Optional[str]
    cannot_judge: List[UntestableEffect]
    n_pixels: int
    n_events: int
    at_range_end: List[str] = field(default_factory=list)
    rejected_effects: List[RejectedEffect] = field(default_factory=list)
    stamp_step_us: Optional[float] = None
    structure: Optional[ResidualStructureReport] = None

    def __str__(self) -> str:
        scores = self.fit.heldout_nats_per_event
        lines = [
            self.verdict.replace("_", " "),
            "held-out log-likelihood, nats per event: baseline "
            f"{scores.baseline:.3f}, final {scores.final:.3f}, "
            f"upper bound {scores.upper_bound:.3f}",
        ]
        for effect in self.effects:
            lines.append(f"{effect.name}: {effect.description}")
            for key, estimate in effect.parameters.items():
                low, high = estimate.ci90
                ends = "" if low is None or high is None else f" (90 % {low:.4g} to {high:.4g})"
                lines.append(f"  {key} = {estimate.value:.4g}{ends}")
        lines += [f"where: {stratum.description}" for stratum in self.mismatch.strata[:3]]
        return "\n".join(lines)

    def to_pandas(self) -> pandas.DataFrame:
        """A row per parameter of the named effects: effect, parameter, value, low and high (90 %)."""
        import pandas

        rows = [
            {
                "effect": effect.id,
                "parameter": key,
                "value": estimate.value,
                "low": estimate.ci90[0],
                "high": estimate.ci90[1],
                "gain_nats_per_event": effect.heldout_gain_nats_per_event,
            }
            for effect in self.effects
            for key, estimate in effect.parameters.items()
        ]
        columns = ["effect", "parameter", "value", "low", "high", "gain_nats_per_event"]
        return pandas.DataFrame(rows, columns=columns)
