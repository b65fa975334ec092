"""Detectors by the names that users select them by: Prooflight's own, and those that other packages register.

A package registers one by an entry point of the group ``prooflight.detectors``: a function that takes a
``Press`` and gives a ``Detector`` (``detectors.base``). examples/write_a_detector.py is one. None can take
the name of another; only the selected one is loaded, also among Prooflight's own.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight.files.given import shortly

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.detectors.base import Detector
    from prooflight.press.artefact import Press

    Factory = Callable[[Press], Detector]

GROUP: Final = "prooflight.detectors"


def chi_square(press: Press) -> Detector:
    """Return the paper's statistical detector, with the press's target false-alarm rate."""
    from prooflight.detectors.paper.chi_square import ChiSquare
    from prooflight.detectors.paper.detector import PaperDetector

    test = ChiSquare(
        good_pages_per_false_alarm=press.good_pages_per_false_alarm, misprint_rate=press.costs.misprint_rate
    )
    return PaperDetector(press_context=press.press_context(), test=test)


def bayes(press: Press) -> Detector:
    """Return the paper's learned detector; RequestError: this press was not trained with it."""
    if press.bayes is None:
        raise _untrained(press, "bayes", "`prooflight press build --detector full`")
    from prooflight.detectors.paper.detector import PaperDetector

    return PaperDetector(press_context=press.press_context(), test=press.bayes)


def matched_filter(press: Press) -> Detector:
    """Return the matched-filter detector; RequestError: this press was not trained with it."""
    if press.ours is None:
        raise _untrained(press, "ours", "`prooflight press build --detector quick`")
    from prooflight.detectors.matched_filter.detector import MatchedFilterDetector

    return MatchedFilterDetector(press_context=press.press_context(), calibrated=press.ours)


BUILT_IN: Final[dict[str, Factory]] = {
    "chi-square": chi_square,
    "ours": matched_filter,
    "bayes": bayes,
    "matched-filter": matched_filter,
}


def detector(name: str | None, press: Press) -> Detector:
    """Return the detector of the user's ``name``, with this press's false-alarm rate.

    None: the matched-filter detector if this press was trained with it, else the paper's statistical one.
    RequestError: there is no such detector, it cannot be loaded, or this press was not trained with it.
    """
    if name is None:
        return default_detector(press)
    if name in BUILT_IN:
        return BUILT_IN[name](press)
    if name not in names():
        raise RequestError(
            "detector", f"there is no {shortly(name)!r}", remedy=f"choose of {', '.join(names())}"
        )
    return _registered(name)(press)


def names() -> tuple[str, ...]:
    """Return the names of all detectors: Prooflight's own, and those that packages have registered."""
    others = {entry.name for entry in entry_points(group=GROUP)}
    return (*BUILT_IN, *sorted(others - set(BUILT_IN)))


def default_detector(press: Press) -> Detector:
    """Return the matched-filter detector if this press was trained with it, else the paper's statistical one."""
    return chi_square(press) if press.ours is None else matched_filter(press)


def promises(press: Press) -> dict[str, str]:
    """Return the stated guarantee of each of Prooflight's own detectors that this press has, by name."""
    trained = {"ours": press.ours, "bayes": press.bayes}
    has = ["chi-square", *(name for name, model in trained.items() if model is not None)]
    return {name: detector(name, press).guarantee for name in has}


@cache
def _registered(name: str) -> Factory:
    entry, *more = entry_points(group=GROUP, name=name)
    if more:
        where = " and ".join(one.value for one in (entry, *more))
        raise RequestError("detector", f"{name!r} is registered by {where}", remedy="uninstall all but one")
    try:
        factory: Factory = entry.load()
    except Exception as error:
        what = f"{name!r} ({entry.value}) cannot be loaded: {type(error).__name__}: {error}"
        raise RequestError("detector", what, remedy="ask whoever wrote it, or uninstall it") from error
    return factory


def _untrained(press: Press, name: str, how: str) -> RequestError:
    what = f"press {press.name} was not taught {name!r}"
    return RequestError("detector", what, remedy=f"build it with {how}, or choose chi-square")
