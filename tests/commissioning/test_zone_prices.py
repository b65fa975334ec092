"""How the prints of a price are made: page by page, and told in the order in which they were asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.commissioning.zones.price import _page_by_page, careful_share
from prooflight.detectors.matched_filter.zones import LEARNING, MatchedFilterPricing, ZonedJudge
from prooflight.errors import RequestError
from prooflight.pages.zones.zones_file import CAREFUL_SHARE, JobZones, ZoneEntry

if TYPE_CHECKING:
    from collections.abc import Iterable

PAGES = [3, 1, 2, 3, 1, 1, 2]


@dataclass
class Made:
    """Stands in for prints: says what it was asked for, and keeps in which order."""

    pages: list[int] = field(default_factory=list)

    def __call__(self, asked: int) -> str:
        self.pages.append(PAGES[asked])
        return f"print {asked}"


def test_prints_are_made_page_by_page_and_told_as_they_were_asked_for() -> None:
    made, told = Made(), list[Any]()

    def shown(items: Iterable[Any], total: int, what: str) -> Iterable[Any]:
        told.append((total, what))
        return items

    work: Any = made
    found = _page_by_page(work, range(len(PAGES)), PAGES, 1, shown, "printing")
    assert found == [f"print {at}" for at in range(len(PAGES))]
    assert made.pages == sorted(PAGES)
    assert told == [(len(PAGES), "printing")]


@pytest.mark.parametrize("rate", [0.1, 0.02, 0.009, 0.001])
def test_the_fewest_prints_are_enough_for_each_to_be_judged_by_the_others(rate: float) -> None:
    entry = ZoneEntry(name="face", kind="careful", pages="all", rectangle_mm=(10, 10, 30, 30))
    pricing = MatchedFilterPricing(calibrated=SimpleNamespace(ranking_rate=rate))  # type: ignore[arg-type]
    prints = pricing.fewest_prints(careful_share(JobZones.create([entry], [(100.0, 100.0)])))
    others = prints - -(-prints // LEARNING) - 1
    _judge(others).rates(rate)
    if prints > 12:
        with pytest.raises(RequestError, match="too few for careful areas"):
            _judge(others - 2).rates(rate)


def _judge(calibrating: int) -> ZonedJudge:
    scores = np.linspace(0.0, 1.0, calibrating)
    return ZonedJudge(page_good=scores, careful_good=scores, baseline=np.zeros((2, 1)), share=CAREFUL_SHARE)
