"""What good pages say of [variation]: pages printed by known amounts say these, and a press shows them."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.cli import run
from prooflight.commissioning.training.real_pages import REMEDY, stated_and_learned
from prooflight.commissioning.training.simulated_days import PressDay
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.variation import UNTOLD, learned_amounts, page_variation
from prooflight.press.blocks import VARIATION
from prooflight.rng import stream
from prooflight.simulation.worlds import amounts_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

DAYS, A_DAY = 6, 2
LOOSER: dict[str, Any] = {
    "lamp": {"flicker_percent": 0.6},
    "paper": {"cloudiness_percent": 0.8},
    "ink": {"gain_print_percent": 5.0, "dot_gain_percent": 5.0},
}


@dataclass(frozen=True, kw_only=True)
class Bare:
    """Designs whose left third is bare paper."""

    make: Callable[..., Page]

    def page(self, index: int) -> Page:
        page = self.make(1000 + index, number=index + 1)
        page.cmyk[:, : page.cmyk.shape[1] // 3] = 0
        return page


def told(press: Press, pages: Bare) -> NDArray[np.float32]:
    """``page_variation`` of twelve pages of six days, seed 3."""
    rows = []
    for first in range(0, 10 * DAYS, 10):
        day = PressDay.of(press, pages, seed=3, first=first)
        for index in range(first, first + A_DAY):
            good, known = day.design(index)
            scan = day.scan(good, stream(3, "training-print", index))
            rows.append(page_variation(known, day.analysed(known, scan)))
    return np.stack(rows)


@pytest.fixture(scope="module")
def looser(press: Press, make_page: Callable[..., Page]) -> tuple[Press, NDArray[np.float32]]:
    other = replace(press, variation=LOOSER)
    return other, told(other, Bare(make=make_page))


def test_what_a_press_was_drawn_with_comes_back(looser: tuple[Press, NDArray[np.float32]]) -> None:
    """Flicker has thousands of lines: within 15 %. Clouds are wider than these pages: 35 %. Inks are drawn 12 times:
    the interval of nine in ten, or 35 %, which are two standard deviations of what 12 pages of 4 inks scatter by."""
    press, rows = looser
    learned = {one.names[0]: one for one in learned_amounts(rows)}
    for name, within in (("lamp.flicker_percent", 0.15), ("paper.cloudiness_percent", 0.35)):
        block, amount = name.split(".")
        assert learned[name].value == pytest.approx(LOOSER[block][amount], rel=within)
    dot = learned["ink.dot_gain_percent"]
    assert dot.value == pytest.approx(5.0, rel=0.35)
    assert dot.low < 5.0 < dot.high
    # uniform within +- 0.76 mm, 24 draws: the root mean square is known to 9 %
    assert learned["page.shift_mm"].value == pytest.approx(amounts_of(press).page.shift_mm, rel=0.2)
    assert all(one.low <= one.value <= one.high for one in learned.values())


def test_a_press_shows_what_is_stated_beside_what_was_learned(
    trained_press: Press,
    looser: tuple[Press, NDArray[np.float32]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A press that is taken for a usual one, and prints more loosely, is told which amounts to state."""
    assert "matched_filter" in trained_press.detectors
    assert stated_and_learned(trained_press) == []
    pages = replace(model_of(trained_press).pages, variation=looser[1])
    learned = trained_press.with_detector("matched_filter", replace(model_of(trained_press), pages=pages))
    shown = stated_and_learned(learned)
    names = [name for row in shown for name in row.names]
    assert sorted(names) == sorted(
        f"{block}.{name}" for block, amounts in VARIATION.items() for name in amounts
    )
    by_name = {row.names[0]: row for row in shown}
    for name in ("lamp.flicker_percent", "paper.cloudiness_percent", "ink.dot_gain_percent"):
        assert by_name[name].remark == REMEDY
    assert by_name["page.shift_mm"].remark == ""
    assert by_name["page.shift_mm"].stated == 0.76
    assert all(by_name[name].learned is None and UNTOLD[name] in by_name[name].remark for name in UNTOLD)
    learned.save(tmp_path / "learned.press")
    assert run(["press", "show", str(tmp_path / "learned.press")]) == 0
    said = capsys.readouterr().out
    assert "+ ink.gain_print_percent" in said
    assert "register.plane_clip_um: not estimated: a limit" in said
    assert run(["press", "show", str(tmp_path / "learned.press"), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["learned"]
    assert [tuple(row["names"]) for row in rows] == [row.names for row in shown]
