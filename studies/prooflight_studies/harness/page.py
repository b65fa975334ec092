"""The page of a study: its results stored as JSON, and rendered as Markdown by the template in the study's folder.

A template sees the JSON and nothing else, so a page can be rendered again without measuring. A name in the template
that the results lack is an error.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError

from prooflight.errors import InputError
from prooflight.files.atomic import whole_file
from prooflight_studies.harness.operating import BOUND_NOTE, counted, rate_below

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

TEMPLATE: Final = "page.md.j2"
STUDIES: Final = Path(__file__).resolve().parents[1]


def write_page(path: Path, study: str, findings: object) -> None:
    """Write the results next to ``path`` as JSON, and render ``path`` from them; each file whole or not at all.

    study: the folder whose template is rendered. findings: a dataclass or mapping that ``plain`` can convert.
    """
    results = {"study": study, **plain(findings)}
    text = json.dumps(results, indent=1, ensure_ascii=False, allow_nan=False)
    _write(path.with_suffix(".json"), text + "\n")
    _write(path, page_text(json.loads(text)))


def page_again(results: Path, page: Path | None = None) -> Path:
    """Render a page from results that ``write_page`` stored; returns its path, by default next to them.

    InputError: the file is not a study's results, or lacks a value that the page needs.
    """
    try:
        stored = json.loads(results.read_text(encoding="utf-8"))
        valid = isinstance(stored, dict) and (STUDIES / str(stored["study"]) / TEMPLATE).is_file()
    except (ValueError, KeyError, RecursionError) as error:
        raise _not_results(results) from error
    if not valid:
        raise _not_results(results)
    page = page or results.with_suffix(".md")
    try:
        _write(page, page_text(stored))
    except (TemplateError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        what = f"lacks a value that its page needs: {error}"
        raise InputError(results, what, remedy="run the study again") from error
    return page


def page_text(results: Mapping[str, Any]) -> str:
    """Return the page as text.

    UndefinedError: the template of ``results["study"]`` needs a value that the results lack.
    """
    return _environment().get_template(f"{results['study']}/{TEMPLATE}").render(results)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(STUDIES),
        undefined=StrictUndefined,
        autoescape=False,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.globals["bound"] = BOUND_NOTE
    environment.filters |= {
        "number": number,
        "short": short,
        "interval": interval,
        "slashed": slashed,
        "row": row,
        "counted": counted,
        "rate_below": rate_below,
    }
    return environment


def plain(value: Any) -> Any:
    """Convert a value to JSON types: dataclasses become objects, tuples and arrays lists, NaN and infinities null.

    TypeError: JSON has no such type.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            raise TypeError(f"keys of results are strings, not {list(value)}")
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int)):
        return value
    raise TypeError(f"results hold no {type(value).__name__}")


def number(value: float | None, spec: str, none: str = "-") -> str:
    """Format a number by a Python format specification; ``none`` stands for null.

    >>> number(1234.5, ",.2f"), number(0.1234, ".1%"), number(None, ".1f")
    ('1,234.50', '12.3%', '-')
    """
    return none if value is None else format(+value, spec)  # the sign lets what is not a number fail


def short(value: float | None) -> str:
    """Format a number with two or three digits, in as few characters as the tables need.

    >>> [short(v) for v in (0.0000123, 0.0123, 0.123, 1.234, 12.34, 0.0)]
    ['1.2e-05', '0.012', '0.123', '1.23', '12.3', '0']
    """
    if value == 0:
        return "0"
    if value is not None and value < 0.001:
        return number(value, ".1e")
    return number(value, ".2g" if value is not None and value < 0.1 else ".3g")


def interval(estimate: Mapping[str, float | None], spec: str | None = None, to: str = ", ") -> str:
    """Format an estimate with its interval; spec: as for ``number``; ``short`` formats it where there is none.

    >>> interval({"value": 0.5, "low": 0.25, "high": 1.0}, ".2f", "-")
    '0.50 [0.25-1.00]'
    """
    value, low, high = (
        short(estimate[name]) if spec is None else number(estimate[name], spec)
        for name in ("value", "low", "high")
    )
    return f"{value} [{low}{to}{high}]"


def slashed(values: Iterable[object]) -> str:
    """Join counts and words with slashes.

    >>> slashed([1000, 20, "many"])
    '1,000 / 20 / many'
    """
    return " / ".join(f"{value:,}" if isinstance(value, int) else str(value) for value in values)


def row(cells: Iterable[object]) -> str:
    """Return a table row, for templates that cannot know the number of cells.

    >>> row(["a", 1])
    '| a | 1 |'
    """
    return f"| {' | '.join(map(str, cells))} |"


def _write(path: Path, text: str) -> None:
    with whole_file(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def _not_results(path: Path) -> InputError:
    return InputError(
        path, "is not the results of a study", remedy="give the JSON file next to a study's page"
    )


# --- studies that are measured part by part ---


def stored_results(page: Path) -> dict[str, Any]:
    """Return the results that ``page.write_page`` stored beside a page; empty if there are none."""
    return {name: value for name, value in _read(page.with_suffix(".json")).items() if name != "study"}


def measure_parts(
    parts: Sequence[str],
    measure: Callable[[str], Any],
    stored: Path,
    *,
    again: bool,
    progress: Callable[[str], None],
    write: Callable[[dict[str, Any]], None],
) -> dict[str, Any]:
    """Measure the parts that are not stored yet, and return the figures of all stored parts.

    stored: file of the figures, written after each part. again: measure all parts named. write: writes the page from
    all figures, after each part as well.
    """
    for part in parts:
        if part in _read(stored) and not again:
            progress(f"{part}: known")
            continue
        progress(part)
        figures = {part: measure(part)}
        stored.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(stored) as unfinished:
            # Read again: another call may have measured other parts meanwhile.
            unfinished.write_text(json.dumps(_read(stored) | figures, indent=1))
        write(_read(stored))
    write(_read(stored))
    return _read(stored)


def _read(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}
