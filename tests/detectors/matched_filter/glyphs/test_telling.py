"""Which evidence names a page that alarms by its glyphs and otherwise too: the strongest of the whole page."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from prooflight.detectors.matched_filter.glyphs.reporting import FEW, glyphs_name
from prooflight.detectors.matched_filter.glyphs.scoring import ScoredGlyph
from prooflight.detectors.placing import WRONG_PAGE_KIND
from prooflight.detectors.verdict import Region

GLYPHS: Any = SimpleNamespace(box_mm=np.array([[10.0 + 3 * at, 20.0, 1.5, 2.0] for at in range(9)]))


def wrong(*deviations: float) -> list[ScoredGlyph]:
    return [
        ScoredGlyph(glyph=at, ratio=one**2 / 2, deviation=one, missing=False)
        for at, one in enumerate(deviations)
    ]


def place(score: float, *box: float) -> Region:
    return Region(x_mm=box[0], y_mm=box[1], width_mm=box[2], height_mm=box[3], score=score, kind="streak")


def named(deviations: tuple[float, ...], *places: Region, kind: str = "streak") -> bool:
    return glyphs_name(GLYPHS, wrong(*deviations), places, kind=kind)


@pytest.mark.parametrize(("score", "by_glyphs"), [(20.0, True), (60.0, False)])
def test_the_stronger_names_the_page(score: float, *, by_glyphs: bool) -> None:
    streak = place(score, 11.0, 0.0, 1.0, 297.0)
    assert named((40.0, 30.0, 10.0), streak) is by_glyphs
    assert named((40.0,), streak) is by_glyphs
    assert named((40.0,), place(5.0, 50.0, 50.0, 2.0, 2.0), streak) is by_glyphs


def test_a_lone_glyph_is_what_stands_out_at_its_place_and_a_spot_over_four_is_a_spot() -> None:
    at_glyph = place(90.0, 10.2, 20.3, 1.7, 1.7)
    assert named((30.0,), at_glyph)
    assert named((30.0, 28.0), at_glyph)
    assert not named((30.0, 28.0, 20.0, 11.0), at_glyph)
    assert not named((30.0,), place(90.0, 100.0, 20.3, 1.7, 1.7))


def test_many_glyphs_or_another_page_are_no_exchange() -> None:
    weak = place(1.0, 10.0, 20.0, 1.0, 1.0)
    assert named((9.0,) * FEW, weak)
    assert not named((9.0,) * (FEW + 1), weak)
    assert not named((9.0,), weak, kind=WRONG_PAGE_KIND)
    assert not named((), weak)
