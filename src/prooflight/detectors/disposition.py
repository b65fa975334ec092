"""Dispositions: a verdict states what is known of a sheet, a disposition what is done with it.

A gate decides by the policy of its press file. Without a gate, a good sheet is accepted, a misprint stops the
press, and a sheet whose quality is unknown is held until a person has seen it. A misprint is accepted only
where the costs of the press file state that stopping costs more.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Verdict

Disposition = Literal["accept", "hold", "divert", "stop"]
"""accept: it joins the good sheets. hold: it is not released before a person has seen it. divert: it is
removed from the good sheets. stop: it is removed, and the press is stopped."""
DecidedBy = Literal["default", "costs", "gate"]
"""default: the rule above. costs: the costs of the press file, for a misprint. gate: the gate's policy."""
LEAST_FIRST: Final[tuple[Disposition, ...]] = ("accept", "hold", "divert", "stop")
NOT_WHOLE: Final = frozenset({"lost-lines", "extra-lines", "splice"})
"""Faults of a sheet that was not measured completely; two sheets that overlap have too many lines."""
NOT_ITS_PLACE: Final = frozenset({"repeated", "out-of-order"})
"""Faults of a sheet that may be well printed but does not belong where it came."""


def without_gate(verdict: Verdict, faults: Collection[str] = ()) -> tuple[Disposition, DecidedBy]:
    """Return the disposition of a sheet without a gate, and the rule that gives it.

    Parameters
    ----------
    verdict
        Of the sheet.
    faults
        Kinds of faults of the paper path and of the camera's lines on that sheet.
    """
    if verdict.verdict == "misprint":
        return ("accept", "costs") if verdict.stopping_costs_more else ("stop", "default")
    if verdict.verdict == "good" and not (NOT_WHOLE | NOT_ITS_PLACE) & set(faults):
        return "accept", "default"
    return "hold", "default"


def gravest(dispositions: Iterable[Disposition]) -> Disposition:
    """Return the most severe of several dispositions, ``accept`` if there is none."""
    return max(dispositions, key=LEAST_FIRST.index, default="accept")
