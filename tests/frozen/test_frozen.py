"""Verdicts, statistics, scans and artefacts of fixed cases are what they were, wherever the code for them lies.

Words and integer rasters must be the same, numbers nearly so: other processors, other numbers of threads and checks of
bounds add up in another order. ``python -m tests.frozen`` measures them anew, which is right only for a change that is
meant to change verdicts.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from tests.frozen.cases import CASES, figures_of, learns, needs_shared
from tests.stand_ins import SHARED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

FIGURES = Path(__file__).with_name("figures.json")


@dataclass(frozen=True, kw_only=True)
class Slack:
    """How far numbers may go."""

    relative: float
    of_norm: float
    """For sums with random signs, of their array's norm."""


SUMMED = Slack(relative=1e-3, of_norm=1e-5)
"""Single precision in sums of a million terms, and fits that go on from them."""
COUNTS = 8.0
"""Of histograms' sums: on the edge of a bin a last bit moves a pixel, which is 2 in a sum with signs; 2 was seen."""
LEARNED = Slack(relative=0.02, of_norm=0.01)
"""What a detector says that was taught on this processor by two dozen pages, which makes more of last bits: processors
with and without AVX-512 were 0.2 % apart in thresholds and scores, and 0.2 % of the norm in statistics."""


def differences(found: Any, frozen: Any, slack: Slack, where: str = "", norm: float = 0.0) -> Iterator[str]:
    """Where figures are not those that were frozen."""
    if isinstance(frozen, dict):
        if not isinstance(found, dict) or set(found) != set(frozen):
            yield f"{where}: {found!r} instead of {frozen!r}"
            return
        for name, one in frozen.items():
            yield from differences(found[name], one, slack, f"{where}/{name}", frozen.get("norm", 0.0))
    elif isinstance(frozen, list):
        if not isinstance(found, list | tuple) or len(found) != len(frozen):
            yield f"{where}: {found!r} instead of {frozen!r}"
            return
        for at, (one, other) in enumerate(zip(found, frozen, strict=True)):
            yield from differences(one, other, slack, f"{where}[{at}]", norm)
    elif isinstance(frozen, float) and isinstance(found, float | int):
        least = slack.of_norm * norm + (COUNTS if "histogram" in where else 1e-9)
        if not math.isclose(found, frozen, rel_tol=slack.relative, abs_tol=least):
            yield f"{where}: {found!r} instead of {frozen!r}"
    elif found != frozen:
        yield f"{where}: {found!r} instead of {frozen!r}"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_nothing_has_changed(case: Callable[..., Any], tmp_path: Path) -> None:
    if needs_shared(case) and not SHARED.is_dir():
        pytest.skip("needs the folder `shared` beside the repository")
    frozen = json.loads(FIGURES.read_text(encoding="utf-8"))[case.__name__]
    found = json.loads(json.dumps(figures_of(case, tmp_path)))
    assert not list(differences(found, frozen, LEARNED if learns(case) else SUMMED))[:8]


def test_a_change_is_seen() -> None:
    frozen = {"norm": 10.0, "mean": 1.0, "words": ["good", 2]}
    assert not list(differences({"norm": 10.0, "mean": 1.0000001, "words": ["good", 2]}, frozen, SUMMED))
    for other in (
        {"norm": 10.02, "mean": 1.0, "words": ["good", 2]},
        {"norm": 10.0, "mean": 1.01, "words": ["good", 2]},
        {"norm": 10.0, "mean": 1.0, "words": ["misprint", 2]},
        {"norm": 10.0, "mean": 1.0, "words": ["good", 3]},
        {"norm": 10.0, "mean": 1.0, "words": ["good"]},
        {"norm": 10.0, "mean": 1.0},
        {"norm": 10.0, "mean": None, "words": ["good", 2]},
    ):
        assert list(differences(other, frozen, SUMMED))
