"""Verdicts, statistics, scans and artefacts of fixed cases are what they were, wherever the code for them lies.

Numbers may move as far as other processors and other numbers of threads move them, and a margin more (``comparison``).
``make freeze`` measures all of this again, which is right only for a change that is meant to change these figures.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from tests.frozen.cases import CASES, figures_of, learns, needs_shared
from tests.frozen.comparison import LEARNED, Spread, deviations
from tests.stand_ins import SHARED

if TYPE_CHECKING:
    from collections.abc import Callable

FIGURES = Path(__file__).with_name("figures.json")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_nothing_has_changed(case: Callable[..., Any], tmp_path: Path) -> None:
    if needs_shared(case) and not SHARED.is_dir():
        pytest.skip("needs the folder `shared` beside the repository")
    frozen = json.loads(FIGURES.read_text(encoding="utf-8"))[case.__name__]
    found = json.loads(json.dumps(figures_of(case, tmp_path)))
    spread = Spread.read(case.__name__, least=LEARNED if learns(case) else 0.0)
    changed = [str(one) for one in deviations(found, frozen) if not spread.allows(one)]
    assert not changed[:8]
