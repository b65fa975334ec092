"""Reasons that runs, gate and reprint list store: each has a German form, and so has what earlier versions stored."""

from __future__ import annotations

import re

import pytest

from prooflight.detectors.false_alarm_rate import Guarantee, Likeness
from prooflight.inspection import job, sheets
from prooflight.press.print_condition import PrintCondition
from prooflight.reporting.sentences import reasons
from prooflight_line.plant import reprinting
from prooflight_line.plant.gate import deciding, resuming
from prooflight_line.run import pace, runner
from prooflight_line.run.sheets import readings

STORED = (
    *deciding.CODE_TEXTS.values(),
    *(reprinting.NEVER, reprinting.NOT_PRINTED, reprinting.UNCONFIRMED, reprinting.CONTESTED),
    *(reprinting.NOT_SEEN_WHOLE, reprinting.TAKE_OUT, reprinting.OF_ITS_SET),
    *sorted(pace.OUT_OF_TIME),
    *(runner.BEGUN_WITHIN, runner.CUT_SHORT, readings.UNSEEN, readings.UNWATCHED, resuming.LOST),
    *(sheets.NEVER, f"{job.MISSING} (looked for p0003.tif in scans)"),
)


WARNED = (
    "p0003: the font Univers is not embedded, and another is drawn in its place: embed it",
    "p0003: image Im1 (object 7), 20 x 30 mm at 5, -2 mm from the top left, lacks its last samples, which print as 0: "
    "export it again",
    "spot ink Gold: it is opaque (0.95), and predicted as transparent where it overprints other inks",
    *PrintCondition(name="FOGRA39", brand="A", weight_gsm=80.0).differences(
        PrintCondition(name="FOGRA51", brand="B", weight_gsm=120.0)
    ),
)
LIKE, UNLIKE = (Likeness(p_value=value, pages=60) for value in (0.4, 0.001))
ALL_KINDS = (("text", 40), ("mixed", 20), ("photo", 4), ("sparse", 0))
GUARANTEES = (
    Guarantee(rate=0.01, simulated=8, reference=1480),
    Guarantee(rate=0.02, simulated=40, requested_rate=0.01),
    Guarantee(rate=0.001, simulated=40, conformal=False),
    Guarantee(rate=0.01, simulated=20, real=30, reference=1480),
    Guarantee(rate=0.01, simulated=0, real=60, reference=1480, likeness=LIKE, kinds=ALL_KINDS),
    Guarantee(rate=0.02, simulated=0, real=60, requested_rate=0.01, likeness=UNLIKE, kinds=ALL_KINDS[:2]),
    Guarantee(
        rate=0.01,
        simulated=0,
        real=90,
        label_source="90 sampled pages and 2 false alarms, labelled by people in 3 runs",
    ),
)


@pytest.mark.parametrize("text", [*WARNED, *map(str, GUARANTEES)])
def test_a_warning_and_a_guarantee_have_a_german_form(text: str) -> None:
    assert reasons().contains(text)
    german = reasons().of(text, "de")
    assert not set(re.findall(r"[a-z]+", german)) & {"the", "of", "and", "is", "by", "pages", "not", "it"}


def test_a_reason_has_the_same_values_in_both_languages() -> None:
    for row in reasons().rows:
        (names, *others) = (set(pattern.groupindex) for pattern in row.patterns)
        assert all(one <= names for one in others), row.texts["en"]
        row.texts["de"].format(**dict.fromkeys(names, "7"))


@pytest.mark.parametrize("text", STORED)
def test_a_stored_reason_has_a_german_form(text: str) -> None:
    assert reasons().contains(text)
