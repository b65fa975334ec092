"""Names of kinds from names of statistics."""

from __future__ import annotations

import pytest

from prooflight.detectors.matched_filter.naming import UNKNOWN, kind_of, named
from prooflight.detectors.matched_filter.statistics.statistic import Observed, Statistic
from prooflight.simulation.misprints.kinds import KINDS

SAID = {
    "box/add-C+/4": "spots-voids",
    "apart/add-C+/64": "scum",
    "flat/gain-M-/32": "missing-plane",
    "box/void+/16": "missing-content",
    "box/blur-/8": "local-blur",
    "line/void/2/full": "streak",
    "calm/gain-K/1/half": "streak",
    "swell/light/one": "banding",
    "double/K/1": "ghost-smear",
    "swap/CM": "swapped-planes",
    "fit/gain-C": "density",
    "place/plane-Y": "plane-register",
    "place/unlike": "wrong-page",
    "place/foreign": "wrong-page",
    "place/lost": "unknown",
    "place/shift": "unknown",
    "place/residual": "unknown",
    "energy/8": UNKNOWN,
}


@pytest.mark.parametrize(("name", "kind"), SAID.items())
def test_every_family_has_a_kind(name: str, kind: str) -> None:
    assert kind_of(Statistic.parse(name)) == kind


def test_every_kind_can_be_said() -> None:
    assert set(SAID.values()) - {UNKNOWN} == set(KINDS)


def test_the_first_that_is_known_names_the_page_and_unlike_tiles_only_if_nothing_else_does() -> None:
    nameless = "energy/8", Observed(statistic=Statistic("energy", size=8), value=30.0)
    unlike = "place/unlike", Observed(statistic=Statistic("place", "unlike"), value=20.0)
    inked = "fit/gain-C", Observed(statistic=Statistic("fit", "gain", "C"), value=9.0)
    assert named([nameless, unlike, inked]) == "density"
    assert named([nameless, unlike]) == "wrong-page"
    assert named([nameless]) == named([]) == UNKNOWN
