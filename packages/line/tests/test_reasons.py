"""Reasons that runs, gate and reprint list store: each has a German form, and so has what earlier versions stored."""

from __future__ import annotations

import pytest

from prooflight.inspection import job, sheets
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


@pytest.mark.parametrize("text", STORED)
def test_a_stored_reason_has_a_german_form(text: str) -> None:
    assert reasons().contains(text)
