"""A press taught by simulated prints; tiny, so that only the plumbing is seen: what it catches is a study's matter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.rehearse import PressDay, fitted
from prooflight.commissioning.teach import FEWEST, Plan
from prooflight.errors import RequestError
from prooflight.press import Press

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page


@pytest.mark.parametrize("designs", [FEWEST, 64, 1000])
def test_no_design_teaches_and_calibrates(designs: int) -> None:
    plan = Plan.of(designs)
    every = [*plan.pilot, *plan.learn, *plan.tune]
    assert every == list(range(designs))
    assert min(len(plan.pilot), len(plan.learn), len(plan.tune)) >= 6
    assert abs(len(plan.tune) - len(plan.learn)) <= 1


def test_too_few_designs_are_refused() -> None:
    with pytest.raises(RequestError, match=f"ask for {FEWEST} or more"):
        Plan.of(FEWEST - 1)


def test_a_taught_press_comes_back_from_its_file(taught_press: Press, tmp_path: Path) -> None:
    path = tmp_path / "taught.press"
    assert taught_press.save(path) == taught_press.digest
    again = Press.load(path)
    assert again.digest == taught_press.digest
    assert again.ours is not None
    assert taught_press.ours is not None
    assert again.ours.promise == taught_press.ours.promise
    assert again.ours.threshold == taught_press.ours.threshold
    assert again.bayes is None
    assert again.ours.promise.simulated == len(Plan.of(24).tune)
    assert again.ours.promise.conformal


def test_a_design_wider_than_the_field_is_cut_to_it(press: Press, make_page: Callable[..., Page]) -> None:
    wide = fitted(make_page(1, width_mm=100, height_mm=120), press.geometry)
    assert press.geometry.field_mm - 0.1 < wide.width_mm <= press.geometry.field_mm
    assert wide.height_mm < 1.5 * wide.width_mm
    small = make_page(1)
    assert fitted(small, press.geometry) is small


def test_days_differ_and_a_day_repeats(press: Press, page: Page) -> None:
    scans = []
    for first, seed in ((0, 1), (0, 1), (4, 1)):
        day = PressDay.of(press, _One(page), seed=1, first=first)
        scans.append(day.scan(day.room.good(page), np.random.default_rng(seed)))
    np.testing.assert_array_equal(scans[0], scans[1])
    assert (scans[0] != scans[2]).mean() > 0.5


class _One:
    def __init__(self, page: Page) -> None:
        self._page = page

    def page(self, index: int) -> Page:
        return self._page
