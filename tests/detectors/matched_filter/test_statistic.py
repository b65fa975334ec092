"""Statistics and the keys by which artefacts and verdicts know them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.matched_filter.model import STATISTIC
from prooflight.detectors.matched_filter.statistics.statistic import (
    FLAT_AREAS,
    GOOD_PRINTS,
    OWN_PAGE,
    Reference,
    Statistic,
)

KEYS = {
    "box/gain-C+/8": Statistic("box", "gain", "C", "+", 8),
    "apart/void-/64": Statistic("box", "void", "", "-", 64, reference=OWN_PAGE),
    "flat/gain-all+/2": Statistic("box", "gain-all", "", "+", 2, reference=FLAT_AREAS),
    "calm/add-K/16/half": Statistic("streak", "add", "K", size=16, part="half", reference=FLAT_AREAS),
    "band/light/row": Statistic("wave", "light", part="row"),
    "wave/light/one": Statistic("wave", "light", part="one", reference=OWN_PAGE),
    "ghost/Y/1": Statistic("ghost", ink="Y", size=1),
    "swap/CM": Statistic("swap", ink="CM"),
    "moved/M/share": Statistic("moved", ink="M", part="share"),
    "fit/shape-most": Statistic("fit", "shape-most"),
    "place/plane-Y": Statistic("place", "plane", "Y"),
    "excess/32": Statistic("energy", size=32, reference=OWN_PAGE),
}


@pytest.mark.parametrize(("key", "statistic"), KEYS.items())
def test_a_key_says_what_is_looked_for_and_against_what(key: str, statistic: Statistic) -> None:
    assert Statistic.parse(key) == statistic
    assert statistic.key == key


@given(st.from_regex(STATISTIC, fullmatch=True))
def test_a_key_that_no_version_has_yet_keeps_its_letters(key: str) -> None:
    assert Statistic.parse(key).key == key


@pytest.mark.parametrize("reference", Reference)
def test_sizes_of_one_cause_are_told_together_and_references_apart(reference: Reference) -> None:
    few, many = (Statistic("box", "void", sign="+", size=size, reference=reference) for size in (2, 64))
    assert few.cause == many.cause
    others = {few._replace(reference=other).cause for other in Reference}
    assert len(others) == len((GOOD_PRINTS, OWN_PAGE, FLAT_AREAS))
