"""Wording: what an operator reads is right for each verdict."""

from __future__ import annotations

import pytest

from prooflight.detectors.matched_filter.glyphs.reporting import KINDS as GLYPH_KINDS
from prooflight.detectors.verdict import Region, Verdict
from prooflight.inspection.codes.reading import KIND as CODE
from prooflight.reporting import wording
from prooflight.reporting.report import Counts, sentence
from prooflight.simulation.worlds import worlds

A4 = (210.0, 297.0)


def verdict(kind: str | None, *regions: Region) -> Verdict:
    return Verdict(page="p0001", verdict="misprint", kind=kind, regions=regions)


def region(x: float, y: float, width: float, height: float, kind: str) -> Region:
    return Region(x_mm=x, y_mm=y, width_mm=width, height_mm=height, score=20.0, kind=kind)


def test_every_kind_of_misprint_has_plain_words() -> None:
    kinds = {entry["kind"] for entry in worlds()["misprint"]}
    assert len(kinds) == 12
    assert kinds | {CODE, *GLYPH_KINDS} == set(wording.KINDS)
    assert len(set(wording.KINDS.values())) == 15


@pytest.mark.parametrize(
    ("regions", "kind", "words"),
    [
        ([], None, "Small deviations on the whole page"),
        ([region(82, 0, 2, 297, "streak")], "streak", "Streak in print direction at x = 83 mm"),
        (
            [region(1, 1, 208, 290, "missing-plane")],
            "missing-plane",
            "Missing or faded ink all over the page",
        ),
        (
            [region(-0.1, -0.1, 208, 90, "missing-plane")],
            "missing-plane",
            "Missing or faded ink from y = 0 to 90 mm",
        ),
        (
            [region(20, 30, 40, 60, "missing-content"), region(90, 90, 1, 1, "missing-content")],
            "missing-content",
            "Part of the page missing around x = 40 mm, y = 60 mm (40 × 60 mm), and 1 more place",
        ),
        ([region(20, 30, 4.22, 60, "scum")], "scum", "Ink on blank paper (scum) around x = 22 mm, "
         "y = 60 mm (4.2 × 60.0 mm)"),
    ],
)  # fmt: skip
def test_headlines(regions: list[Region], kind: str | None, words: str) -> None:
    assert wording.headline(verdict(kind, *regions), A4) == words


@pytest.mark.parametrize(
    ("good", "alarms", "stopped", "unseen", "words"),
    [
        (28, 0, 0, 0, "28 pages inspected: 28 passed as good, no misprint found."),
        (0, 1, 1, 0, "1 page inspected: 0 passed as good, 1 stopped as a misprint."),
        (20, 8, 8, 0, "28 pages inspected: 20 passed as good, 8 stopped as misprints."),
        (20, 8, 5, 0, "28 pages inspected: 20 passed as good, 8 found to be misprints, 3 of them accepted by the press "
         "file's costs."),
        (1, 0, 0, 2, "1 page inspected: 1 passed as good, no misprint found; 2 more pages had no scan and are "
         "held."),
    ],
)  # fmt: skip
def test_sentences(good: int, alarms: int, stopped: int, unseen: int, words: str) -> None:
    count = Counts(
        pages=good + alarms + unseen,
        good=good,
        alarms=alarms,
        stopped=stopped,
        not_inspected=unseen,
        misprints=0,
        caught=0,
        missed=0,
        false_alarms=0,
    )
    assert sentence(count) == words
