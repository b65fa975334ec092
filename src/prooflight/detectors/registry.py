"""Detectors by the names that users select them by: Prooflight's own, and those that other packages register.

A package registers one by an entry point of the group ``prooflight.detectors``: an ``Entry``
(``detectors.entry``), or, for a detector that needs no training, a function that takes a press and gives a
``Detector`` (``detectors.base``). examples/write_a_detector.py is one. None can take the name of another; only
the selected one is loaded, also among Prooflight's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.metadata import entry_points
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight.files.given import shortly

if TYPE_CHECKING:
    from prooflight.detectors.base import Detector
    from prooflight.detectors.entry import DetectorPress, Entry, Train

GROUP: Final = "prooflight.detectors"
PREFERRED: Final = "matched_filter"
"""Detector of a press that was trained with it, where the user names none."""
UNTRAINED: Final = "chi-square"
"""Detector of any other press; every press has it."""
BUILT_IN: Final = {
    UNTRAINED: "prooflight.detectors.paper.entry:CHI_SQUARE",
    PREFERRED: "prooflight.detectors.matched_filter.entry:ENTRY",
    "bayes": "prooflight.detectors.paper.entry:BAYES",
    "golden": "prooflight.detectors.golden.entry:ENTRY",
}
"""Entries of Prooflight's own, which are imported as those of other packages are: by name."""


def names() -> tuple[str, ...]:
    """Return the names of all detectors: Prooflight's own, and those that packages have registered."""
    others = {entry.name for entry in entry_points(group=GROUP)}
    return (*BUILT_IN, *sorted(others - {*BUILT_IN}))


def entry(name: str) -> Entry:
    """Return the entry of a detector by its name; RequestError: there is none, or it cannot be loaded."""
    if name in BUILT_IN:
        return resolve_name(BUILT_IN[name])
    if name not in names():
        raise RequestError(
            "detector", f"there is no {shortly(name)!r}", remedy=f"choose from {', '.join(names())}"
        )
    return _registered(name)


def detector(name: str | None, press: DetectorPress) -> Detector:
    """Return the detector of the user's ``name``, with this press's false-alarm rate; None: the press's default.

    RequestError: there is no such detector, it cannot be loaded, or this press was not trained with it.
    """
    name = default_name(press) if name is None else name
    registered = entry(name)
    if registered.model is not None and name not in press.detectors:
        what = f"press {press.name} was not trained for {name!r}"
        remedy = f"build it with `prooflight press build --detector {name}`, or choose {UNTRAINED}"
        raise RequestError("detector", what, remedy=remedy)
    return registered.detector(press)


def default_name(press: DetectorPress) -> str:
    """Return the matched-filter detector if this press was trained with it, else the paper's statistical one."""
    return PREFERRED if PREFERRED in press.detectors else UNTRAINED


def promises(press: DetectorPress) -> dict[str, str]:
    """Return the stated guarantee of each detector that this press was trained with, and of the statistical one."""
    has = [name for name in names() if name == UNTRAINED or name in press.detectors]
    return {name: detector(name, press).guarantee for name in has}


def family_text(name: str, family: str) -> str | None:
    """Describe a family of evidence of a detector; None: it cannot, or is not installed here."""
    try:
        return entry(name).family_text(family)
    except RequestError:
        return None


def training_functions(names: Sequence[str]) -> dict[Train, list[str]]:
    """Return the functions that train detectors, each with the names of those that it trains.

    RequestError: there is no such detector, or one that needs no training.
    """
    functions: dict[Train, list[str]] = {}
    for name in names:
        if not (train := entry(name).train):
            raise RequestError("detector", f"{name!r} needs no training", remedy="build with --detector none")
        functions.setdefault(resolve_name(train), []).append(name)
    return functions


@cache
def _registered(name: str) -> Entry:
    from prooflight.detectors.entry import Entry

    entry_point, *more = entry_points(group=GROUP, name=name)
    if more:
        where = " and ".join(one.value for one in (entry_point, *more))
        raise RequestError("detector", f"{name!r} is registered by {where}", remedy="uninstall all but one")
    try:
        loaded = entry_point.load()
    except Exception as error:
        what = f"{name!r} ({entry_point.value}) cannot be loaded: {type(error).__name__}: {error}"
        raise RequestError("detector", what, remedy="ask its author, or uninstall it") from error
    return loaded if isinstance(loaded, Entry) else Entry(detector=loaded)
