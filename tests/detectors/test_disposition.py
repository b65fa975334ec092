"""What becomes of a sheet where no gate decides."""

from __future__ import annotations

import pytest

from prooflight.detectors.disposition import NOT_ITS_PLACE, NOT_WHOLE, gravest, without_gate
from prooflight.detectors.verdict import Verdict

GOOD = Verdict(page="p", verdict="good")
MISPRINT = Verdict(page="p", verdict="misprint")


def test_a_sheet_is_accepted_only_if_it_is_good_whole_and_in_its_place() -> None:
    assert without_gate(GOOD) == ("accept", "default")
    assert without_gate(GOOD, ("slip", "stretch")) == ("accept", "default")
    for fault in NOT_WHOLE | NOT_ITS_PLACE:
        assert without_gate(GOOD, ("slip", fault)) == ("hold", "default"), fault


def test_what_was_not_inspected_is_held() -> None:
    assert without_gate(Verdict.skipped("p", "too late")) == ("hold", "default")


def test_a_misprint_stops_the_press_unless_the_costs_of_the_press_file_accept_it() -> None:
    assert without_gate(MISPRINT, ("lost-lines",)) == ("stop", "default")
    costly = Verdict(page="p", verdict="misprint", stopping_costs_more=True)
    assert without_gate(costly) == ("accept", "costs")


@pytest.mark.parametrize(
    ("several", "one"),
    [
        ((), "accept"),
        (("accept", "hold"), "hold"),
        (("divert", "hold"), "divert"),
        (("stop", "divert"), "stop"),
    ],
)
def test_the_gravest_of_several_counts(several: tuple[str, ...], one: str) -> None:
    assert gravest(several) == one  # type: ignore[arg-type]
