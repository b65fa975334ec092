"""Wording: what an operator reads is right for each verdict."""

from __future__ import annotations

import pytest

from prooflight.detectors.matched_filter.glyphs.reporting import KINDS as GLYPH_KINDS
from prooflight.inspection.codes.reading import KIND as CODE
from prooflight.reporting.defect_phrases import KINDS
from prooflight.reporting.report import Counts, sentence
from prooflight.simulation.worlds import worlds


def test_every_kind_of_misprint_has_plain_words() -> None:
    kinds = {entry["kind"] for entry in worlds()["misprint"]}
    assert len(kinds) == 12
    named = kinds | {CODE, *GLYPH_KINDS, "blank-sheet", "deviation", "unknown"}
    for words in KINDS.values():
        assert set(words) == named
        assert len(set(words.values())) == len(named)


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
