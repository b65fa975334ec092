"""Validation of the project's files: documents by pydantic, arrays by a table, with nothing else beside them.

Each part of the program that is stored in a file has its own document and table next to where it is read.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ArgsKwargs

Rule = Callable[[NDArray[Any]], str]
"""Rule that returns what is wrong with an array beyond shape and range; empty if nothing is."""

FAR: Final = 1e9
"""Limit of all numbers except counts of pages and variances."""

# Strict: text and booleans are no numbers.
Number = Annotated[float, Field(strict=True, ge=-FAR, le=FAR, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, le=FAR, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, le=FAR, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, ge=0, le=1, allow_inf_nan=False)]
Chance = Annotated[float, Field(strict=True, gt=0, lt=1, allow_inf_nan=False)]
"""Probability strictly between 0 and 1."""
Count = Annotated[int, Field(strict=True, ge=0, le=10**9)]
Name = Annotated[str, Field(strict=True, min_length=1, max_length=255)]


class Misfit(ValueError):
    """Content that a file must not have; ``field`` is where, and ``what`` continues the sentence."""

    def __init__(self, field: str, what: str) -> None:
        self.field, self.what = field, what
        super().__init__(f"{field} {what}")


class Block(BaseModel):
    """A part of a document with known fields only, none of them converted by reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)


Document = TypeVar("Document", bound=Block)


def parsed(text: str) -> Any:
    """Parse JSON; Misfit if it is invalid."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Misfit("document", "is not JSON") from error


def checked(kind: type[Document], raw: Any, *, under: str = "") -> Document:
    """Validate a document as ``kind``; Misfit names the first wrong field. under: prefix of its name."""
    try:
        # From JSON, as it was written: there a list is as good as a tuple.
        return kind.model_validate_json(json.dumps(raw))
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False)[0]
        place = [str(part + 1) if isinstance(part, int) else part for part in fault["loc"]]
        field = under + ".".join(place) or "document"
        match fault["type"]:
            case "missing":
                raise Misfit(field, "is missing") from error
            case "extra_forbidden" | "unexpected_keyword_argument":
                raise Misfit(field, "is not known here") from error
            case "json_invalid":  # a lone surrogate: Python's own reader lets it pass
                raise Misfit(field, "is not JSON") from error
            case _:
                raise Misfit(field, _message(fault)) from error
    except (ValueError, RecursionError) as error:
        raise Misfit(under + "document", "is not JSON") from error


def _message(fault: Any) -> str:
    text = fault["msg"].removeprefix("Value error, ").removeprefix("Input ").replace("should", "must")
    given = fault["input"]
    suffix = "" if isinstance(given, dict | list | ArgsKwargs) else f", not {str(given)[:40]!r}"
    return f"{text[0].lower()}{text[1:]}{suffix}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ArraySpec:
    """Required type, shape and range of one array, which must also be finite."""

    dtype: str
    shape: tuple[int | str, ...]
    """Extents, or names of extents that must be equal wherever they occur."""
    low: float = -FAR
    high: float = FAR
    above: float | None = None
    """It must be greater than this."""
    rule: Rule | None = None
    absent: bool = False
    """Whether the array may be missing."""
    empty: bool = False
    """Whether the array may be empty."""


def check_arrays(
    arrays: Mapping[str, NDArray[Any]],
    table: Mapping[str, ArraySpec],
    sizes: Mapping[str, int],
    *,
    under: str = "",
) -> dict[str, int]:
    """Raise Misfit unless arrays are those of ``table``; return the extents, those taken from the arrays included.

    sizes: known extents by name.
    """
    extents = dict(sizes)
    for name in arrays:
        if name not in table:
            raise Misfit(under + name, "is not known here")
    for name, spec in table.items():
        if name in arrays:
            _check_array(under + name, arrays[name], spec, extents)
        elif not spec.absent:
            raise Misfit(under + name, "is missing")
    return extents


def _check_array(name: str, array: NDArray[Any], spec: ArraySpec, extents: dict[str, int]) -> None:
    if array.dtype.name != spec.dtype:
        raise Misfit(name, f"is of {array.dtype.name}, must be of {spec.dtype}")
    fits = array.ndim == len(spec.shape) and all(
        extent == (extents.setdefault(wanted, extent) if isinstance(wanted, str) else wanted)
        for extent, wanted in zip(array.shape, spec.shape, strict=True)
    )
    if not fits:
        raise Misfit(name, f"has {_times(array.shape)} numbers, must have {_worded(spec.shape, extents)}")
    if not array.size:
        if spec.empty:
            return
        raise Misfit(name, "is empty")
    # NaN goes through either.
    low, high = float(array.min()), float(array.max())
    if not (np.isfinite(low) and np.isfinite(high)):
        raise Misfit(name, "holds a value that is not a finite number")
    if spec.above is not None and low <= spec.above:
        raise Misfit(name, f"holds {low:.6g}, must be above {spec.above:g}")
    if low < spec.low or high > spec.high:
        wrong = low if low < spec.low else high
        raise Misfit(name, f"holds {wrong:.6g}, must be between {spec.low:g} and {spec.high:g}")
    if spec.rule is not None and (what := spec.rule(array)):
        raise Misfit(name, what)


def _times(extents: Iterable[int | str]) -> str:
    return " x ".join(map(str, extents)) or "one of"


def _worded(shape: tuple[int | str, ...], sizes: Mapping[str, int]) -> str:
    named = dict.fromkeys(one for one in shape if isinstance(one, str))
    suffix = f" ({', '.join(named)})" if named else ""
    return _times(sizes.get(one, one) if isinstance(one, str) else one for one in shape) + suffix


def part_of(arrays: Mapping[str, NDArray[Any]], under: str) -> dict[str, NDArray[Any]]:
    """Return the arrays whose names begin with ``under``, by the rest of their names."""
    return {name.removeprefix(under): array for name, array in arrays.items() if name.startswith(under)}


def rising(array: NDArray[Any]) -> str:
    """Return the fault of values that fall along the last axis; empty if none does."""
    return "must rise from value to value" if (np.diff(array) < 0).any() else ""
