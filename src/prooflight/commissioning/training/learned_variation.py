"""Estimates of ``[variation]`` from a press's own good pages, next to the values that its press file states."""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Final

from prooflight.detectors.matched_filter.entry import NAME, model_of
from prooflight.detectors.matched_filter.variation import UNTOLD, learned_amounts
from prooflight.press.blocks import VARIATION
from prooflight.simulation.worlds import amounts_of

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.variation import Learned
    from prooflight.press.artefact import Press
    from prooflight.simulation.worlds import Amounts

WIDE: Final = 1.5
"""assumed: this factor on a stated value is a wide margin.

The amounts themselves are known to some ten per cent.
"""
REMEDY: Final = (
    "more than stated: state it in [variation] and build again; the promise already holds by press learn"
)
FEW: Final = "not estimated: too few pages tell it"


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedAndLearned:
    """One amount of ``[variation]``, or several that pages of one session show combined, as independent ones add up."""

    names: tuple[str, ...]
    stated: float
    learned: Learned | None
    """Estimate; None: not estimated."""
    remark: str
    """Remedy, or the reason why it was not estimated; mostly empty."""


def stated_and_learned(press: Press) -> list[StatedAndLearned]:
    """Return every amount of ``[variation]``.

    The list is empty where the press was trained on no real page that shows them.
    """
    pages = None if NAME not in press.detectors else model_of(press).pages.variation
    if pages is None or not len(pages):
        return []
    amounts, learned = amounts_of(press), learned_amounts(pages)
    rows = [_row(one.names, amounts, one, "") for one in learned]
    estimated = {name for one in learned for name in one.names}
    for block, fields in VARIATION.items():
        for name in (f"{block}.{field}" for field in fields):
            if name not in estimated:
                reason = f"not estimated: {UNTOLD[name]}" if name in UNTOLD else FEW
                rows.append(_row((name,), amounts, None, reason))
    return rows


def _row(names: tuple[str, ...], amounts: Amounts, learned: Learned | None, remark: str) -> StatedAndLearned:
    each = [attrgetter(name)(amounts) for name in names]
    stated = math.hypot(*(max(one) if isinstance(one, tuple) else one for one in each))
    if learned is not None:
        far = stated**WIDE if names[0] == "camera.sigma_error" else WIDE * stated
        remark = REMEDY if learned.low > far else ""
    return StatedAndLearned(names=names, stated=stated, learned=learned, remark=remark)
