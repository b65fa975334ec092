"""What a file of ours may hold: numbers of its document by pydantic, its arrays by a table, nothing else beside them.

Each part of the program that is kept in a file has its own document and table next to where it is read.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from numpy.typing import NDArray

    Rule = Callable[[NDArray[Any]], str]
    """What is wrong with an array beyond shape and range; empty: nothing."""

FAR: Final = 1e9
"""No number of ours is larger, but for counts of pages and variances."""

# Strict: text and booleans are no numbers.
Number = Annotated[float, Field(strict=True, ge=-FAR, le=FAR, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, le=FAR, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, le=FAR, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, ge=0, le=1, allow_inf_nan=False)]
Chance = Annotated[float, Field(strict=True, gt=0, lt=1, allow_inf_nan=False)]
"""A probability of what may happen and may not."""
Count = Annotated[int, Field(strict=True, ge=0, le=10**9)]
Name = Annotated[str, Field(strict=True, min_length=1, max_length=255)]


class Misfit(ValueError):
    """What a file holds and must not; ``field`` is where, ``what`` goes on from there."""

    def __init__(self, field: str, what: str) -> None:
        self.field, self.what = field, what
        super().__init__(f"{field} {what}")


class Block(BaseModel):
    """A part of a document: every field known, none changed by being read."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


Document = TypeVar("Document", bound=Block)


def parsed(text: str) -> Any:
    """What JSON says; Misfit: it is none."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Misfit("document", "is not JSON") from error


def checked(kind: type[Document], raw: Any, *, under: str = "") -> Document:
    """A document as ``kind`` knows it; Misfit names the first field that is wrong. under: where it stands."""
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
            case "extra_forbidden":
                raise Misfit(field, "is not known here") from error
            case "json_invalid":  # a lone surrogate: Python's own reader lets it pass
                raise Misfit(field, "is not JSON") from error
            case _:
                raise Misfit(field, _said(fault)) from error
    except (ValueError, RecursionError) as error:
        raise Misfit(under + "document", "is not JSON") from error


def _said(fault: Any) -> str:
    text = fault["msg"].removeprefix("Value error, ").removeprefix("Input ").replace("should", "must")
    given = fault["input"]
    told = "" if isinstance(given, dict | list) else f", not {str(given)[:40]!r}"
    return f"{text[0].lower()}{text[1:]}{told}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """What one array must be; finite it must be anyway."""

    dtype: str
    shape: tuple[int | str, ...]
    """An extent, or the name of one that is the same wherever it stands."""
    low: float = -FAR
    high: float = FAR
    above: float | None = None
    """It must be greater than this."""
    rule: Rule | None = None
    absent: bool = False
    """Whether it may be."""
    empty: bool = False
    """Whether it may be."""


def check_arrays(
    arrays: Mapping[str, NDArray[Any]],
    table: Mapping[str, Kept],
    sizes: Mapping[str, int],
    *,
    under: str = "",
) -> dict[str, int]:
    """Misfit unless arrays are those of ``table``; returns the extents, those that only the arrays told among them.

    sizes: extents by name, as far as they are known.
    """
    known = dict(sizes)
    for name in arrays:
        if name not in table:
            raise Misfit(under + name, "is not known here")
    for name, kept in table.items():
        if name in arrays:
            _check_array(under + name, arrays[name], kept, known)
        elif not kept.absent:
            raise Misfit(under + name, "is missing")
    return known


def _check_array(name: str, array: NDArray[Any], kept: Kept, known: dict[str, int]) -> None:
    if array.dtype.name != kept.dtype:
        raise Misfit(name, f"is of {array.dtype.name}, must be of {kept.dtype}")
    fits = array.ndim == len(kept.shape) and all(
        extent == (known.setdefault(wanted, extent) if isinstance(wanted, str) else wanted)
        for extent, wanted in zip(array.shape, kept.shape, strict=True)
    )
    if not fits:
        raise Misfit(name, f"has {_times(array.shape)} numbers, must have {_worded(kept.shape, known)}")
    if not array.size:
        if kept.empty:
            return
        raise Misfit(name, "is empty")
    # NaN goes through either.
    low, high = float(array.min()), float(array.max())
    if not (np.isfinite(low) and np.isfinite(high)):
        raise Misfit(name, "holds a value that is not a finite number")
    if kept.above is not None and low <= kept.above:
        raise Misfit(name, f"holds {low:.6g}, must be above {kept.above:g}")
    if low < kept.low or high > kept.high:
        wrong = low if low < kept.low else high
        raise Misfit(name, f"holds {wrong:.6g}, must lie between {kept.low:g} and {kept.high:g}")
    if kept.rule is not None and (what := kept.rule(array)):
        raise Misfit(name, what)


def _times(extents: Iterable[int | str]) -> str:
    return " x ".join(map(str, extents)) or "one of"


def _worded(shape: tuple[int | str, ...], known: Mapping[str, int]) -> str:
    named = dict.fromkeys(one for one in shape if isinstance(one, str))
    told = f" ({', '.join(named)})" if named else ""
    return _times(known.get(one, one) if isinstance(one, str) else one for one in shape) + told


def part_of(arrays: Mapping[str, NDArray[Any]], under: str) -> dict[str, NDArray[Any]]:
    """Arrays whose names begin with ``under``, by the rest of their names."""
    return {name.removeprefix(under): array for name, array in arrays.items() if name.startswith(under)}


def rising(array: NDArray[Any]) -> str:
    """A rule: values must not fall along the last axis."""
    return "must rise from value to value" if (np.diff(array) < 0).any() else ""
