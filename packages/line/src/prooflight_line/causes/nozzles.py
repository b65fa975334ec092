"""Streaks: their place across the print with its uncertainty, and the nozzle that is there."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.inspection.common_cause import COLUMN_KINDS, NEAR_MM

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.press.parts import HeadBlock
    from prooflight_line.causes.marks import Mark

PLACE_SD_MM: Final = 0.06
"""Standard deviation of a streak's place on one sheet: register of its plane, warp of the print, and registration.
assumed: planes vary by 0.048 mm and the warp by 0.03 mm (``worlds.toml``)."""
MEDIAN: Final = 1.2533
"""Standard deviation of the median of many normal values over that of their mean: sqrt(pi / 2)."""
NARROW: Final = 1.5
"""Windows up to so many times as wide as the narrowest count for the place."""
SURE_SHARE: Final = 0.5
"""Share of a streak's marks that must name its ink. assumed: on a line thinner than a pixel, single marks were measured
to name another one."""
LEAST_SHEETS: Final = 2
"""Sheets from which on a streak has a cause of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Streak:
    """A streak on several sheets."""

    marks: tuple[Mark, ...]
    x_mm: float
    """Place from the left edge of the printed page."""
    sd_mm: float
    ink: str
    """Letter of the ink that most of its marks name; empty: there is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Nozzle:
    """A nozzle at the place of a streak."""

    head: str
    number: int
    """Most likely number of the nozzle, from 1."""
    sd: float
    """Standard deviation of the number, from that of the place. [nozzles]"""


def streaks_of(marks: Sequence[Mark], *, least_sheets: int = LEAST_SHEETS) -> list[Streak]:
    """Return the streaks of a run, those on most sheets first.

    A streak's place is the median over its sheets of the strongest of each sheet's narrow windows, which is about the
    streak's middle. Wider windows than needed were measured to be more often on one side; those whose edge is near a
    narrower streak belong to it.
    """
    own = sorted((mark for mark in marks if mark.kind in COLUMN_KINDS), key=lambda mark: mark.width_mm)
    groups: list[list[Mark]] = []
    for mark in own:  # the narrowest first: they are the surest places
        reach = NEAR_MM + mark.width_mm / 2
        near = next((group for group in groups if abs(group[0].x_mm - mark.x_mm) <= reach), None)
        groups.append([mark]) if near is None else near.append(mark)
    streaks = [_streak(group) for group in groups if len({one.sheet for one in group}) >= least_sheets]
    return sorted(streaks, key=lambda streak: -len(streak.marks))


def _streak(marks: Sequence[Mark]) -> Streak:
    most = NARROW * min(mark.width_mm for mark in marks)
    strongest: dict[int, Mark] = {}
    for mark in sorted(marks, key=lambda mark: mark.score):
        if mark.width_mm <= most:
            strongest[mark.sheet] = mark
    places = np.array([mark.x_mm for mark in strongest.values()])
    ink, times = Counter(mark.ink for mark in marks).most_common(1)[0]
    return Streak(
        marks=tuple(marks),
        x_mm=float(np.median(places)),
        sd_mm=MEDIAN * PLACE_SD_MM / float(np.sqrt(places.size)),
        ink=ink if times > SURE_SHARE * len(marks) else "",
    )


def nozzles_at(streak: Streak, heads: Sequence[HeadBlock]) -> list[Nozzle]:
    """Return the nozzle of each head that is at a streak; of the heads of its ink alone, where that is known."""
    nozzles = []
    for head in heads:
        if streak.ink and head.ink and head.ink != streak.ink:
            continue
        number = head.nozzle_at(streak.x_mm)
        if 0.5 <= number <= head.nozzles + 0.5:
            sd = streak.sd_mm * (head.nozzle_at(1.0) - head.nozzle_at(0.0))
            nearest = min(max(round(number), 1), head.nozzles)
            nozzles.append(Nozzle(head=head.name, number=nearest, sd=sd))
    return nozzles
