"""Detectors by the names that users call them: Prooflight's own, and those that other packages register.

A package registers one by an entry point of the group ``prooflight.detectors``: a function that takes a ``Press`` and
gives a ``Detector`` (``detectors.base``). examples/write_a_detector.py is one.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Final

from prooflight.detectors.matched_filter.detector import MatchedFilterDetector
from prooflight.detectors.paper.chi_square import ChiSquare
from prooflight.detectors.paper.detector import PaperDetector
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.detectors.base import Detector
    from prooflight.press.artefact import Press

    Factory = Callable[[Press], Detector]

GROUP: Final = "prooflight.detectors"


def chi_square(press: Press) -> Detector:
    """The paper's statistical detector, with the promise of the press."""
    test = ChiSquare(
        good_pages_per_false_alarm=press.good_pages_per_false_alarm, misprint_rate=press.costs.misprint_rate
    )
    return PaperDetector(station=press.station(), test=test)


def bayes(press: Press) -> Detector:
    """The paper's learned detector; RequestError: this press was not taught it."""
    if press.bayes is None:
        raise _untrained(press, "bayes", "`prooflight press build --detector full`")
    return PaperDetector(station=press.station(), test=press.bayes)


def matched_filter(press: Press) -> Detector:
    """Ours; RequestError: this press was not taught it."""
    if press.ours is None:
        raise _untrained(press, "ours", "`prooflight press build --detector quick`")
    return MatchedFilterDetector(station=press.station(), calibrated=press.ours)


BUILT_IN: Final[dict[str, Factory]] = {
    "chi-square": chi_square,
    "ours": matched_filter,
    "bayes": bayes,
    "matched-filter": matched_filter,
}


def detector(name: str | None, press: Press) -> Detector:
    """The detector that users call ``name``, with this press's promise; None: ours if this press was taught it.

    RequestError: there is no such detector, or this press was not taught it.
    """
    if name is None:
        name = "chi-square" if press.ours is None else "ours"
    known = BUILT_IN | _registered()
    if name not in known:
        raise RequestError("detector", f"there is no {name!r}", remedy=f"choose of {', '.join(known)}")
    return known[name](press)


@cache
def _registered() -> dict[str, Factory]:
    return {entry.name: entry.load() for entry in entry_points(group=GROUP)}


def _untrained(press: Press, name: str, how: str) -> RequestError:
    what = f"press {press.name} was not taught {name!r}"
    return RequestError("detector", what, remedy=f"build it with {how}, or choose chi-square")
