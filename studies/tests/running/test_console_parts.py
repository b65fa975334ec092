"""Journeys and searches of the console's study: what the page states of them, and a small journal that is searched."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from prooflight_studies.console.searches import RUNS, measure_searches
from prooflight_studies.harness.page import page_text

MADE_UP = Path(__file__).parents[1] / "harness" / "pages" / "console.json"


def page_with(**parts: Any) -> str:
    return page_text(json.loads(MADE_UP.read_text(encoding="utf-8")) | parts)


def test_journeys_are_stated_with_their_bounds() -> None:
    row = {"journey": "the defect of an alarm", "width": 390, "clicks": 1, "most_clicks": 1}
    row |= {"median_s": 0.81, "greatest_s": 1.02, "most_s": 5.0}
    journeys = {
        "rows": [row],
        "times": 5,
        "runs": 20,
        "sheets": 400,
        "seed": 547,
        "quick": False,
        "cores": 2,
        "load": 1.25,
    }
    page = page_with(journeys=journeys)
    assert "| the defect of an alarm | 390 px | 1 | 1 | 0.81 s | 1.02 s | 5 s |" in page
    assert "load 1.25 per core" in page
    assert "(seed 547)" in page


def test_a_small_journal_is_searched_and_its_figures_are_stated() -> None:
    figures = measure_searches(quick=True, progress=lambda _step: None)
    counts = {row["search"]: row["sheets"] for row in figures["rows"]}
    assert (figures["sheets"], figures["runs"]) == (20_000, RUNS)
    # One sheet in 5 is a misprint, one in 500 was not inspected: of 20,000, within four standard deviations.
    assert abs(counts["all that need review"] - 4040) < 4 * (20_000 * 0.2 * 0.8) ** 0.5
    assert 0 < counts["not inspected"] < 80
    assert 0 < counts["a kind in a week"] < counts["a kind"] < counts["all that need review"]
    assert counts["no hit: no such location"] == 0
    assert 0 < counts["within 2 mm of a point"] < counts["an ink"]
    page = page_with(search=figures | {"cores": 2, "load": 0.5})
    assert "## Searches over a large journal" in page
    assert f"| a kind | {counts['a kind']:,} |" in page
