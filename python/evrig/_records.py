"""Results of the library as dataclasses."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Any, Dict, Optional, Type, TypeVar, Union, get_args, get_origin, get_type_hints

R = TypeVar("R")


class Record:
    """A result of the library; every record is a dataclass."""

    def to_dict(self) -> Dict[str, Any]:
        """The result as plain values; what is unknown is NaN."""
        return dataclasses.asdict(self)  # type: ignore[call-overload, no-any-return]


@dataclass(frozen=True)
class Estimate(Record):
    """A value with its uncertainty.

    Attributes:
        value: The best value; NaN where there is none.
        standard_error: Its standard error; NaN where it is unknown.
        ci90: Interval that covers the truth in 90 % of repetitions.
        n: Number of samples.
    """

    value: float
    standard_error: float
    ci90: tuple[float, float]
    n: int

    def __str__(self) -> str:
        return f"{self.value:.4g} ± {self.standard_error:.2g}"


@dataclass(frozen=True)
class NotMeasured(Record):
    """Why something was not measured; false in a condition."""

    not_measured: str

    def __bool__(self) -> bool:
        return False


def read(kind: Type[R], text: str) -> R:
    """A result from the library's JSON."""
    return load(kind, json.loads(text))  # type: ignore[no-any-return]


def key_of(field: dataclasses.Field[Any]) -> str:
    """The key of a field in JSON."""
    return str(field.metadata.get("key", field.name))


def load(kind: Any, value: Any) -> Any:
    """A value of a type from plain values; an unknown number is NaN."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Union:
        return _one_of(arguments, value)
    if kind is float:
        return float("nan") if value is None else float(value)
    if origin is tuple:
        kinds = arguments * len(value) if len(set(arguments)) == 1 else arguments
        return tuple(load(one, item) for one, item in zip(kinds, value))
    if origin is list:
        return [load(arguments[0], item) for item in value]
    if origin is dict:
        return {key: load(arguments[1], item) for key, item in value.items()}
    if dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        given = {
            field.name: load(hints[field.name], value.get(key_of(field)))
            for field in dataclasses.fields(kind)
            if key_of(field) in value or not _has_default(field)
        }
        return kind(**given)  # type: ignore[operator]
    return value


def _has_default(field: dataclasses.Field[Any]) -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def _one_of(kinds: tuple[Any, ...], value: Any) -> Any:
    if value is None:
        return None
    if NotMeasured in kinds and "not_measured" in value:
        return NotMeasured(value["not_measured"])
    other = [kind for kind in kinds if kind not in (type(None), NotMeasured)]
    return load(other[0], value)


__all__ = ["Estimate", "NotMeasured", "Optional", "Record", "load", "read"]
