"""Causes of a run's defects, named by the press's own parts: rollers, heads and nozzles, inks, paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from prooflight.inspection.common_cause import COLUMN_KINDS
from prooflight.press.parts import PartsBlock
from prooflight.reporting.wording import count
from prooflight_line.causes.marks import marks_of, sheet_distance_mm
from prooflight_line.causes.nozzles import nozzles_at, streaks_of
from prooflight_line.causes.repeats import repeats_of
from prooflight_line.causes.trends import trends_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.press.parts import RollerBlock
    from prooflight.scans.geometry import ScanGeometry
    from prooflight_line.causes.marks import Mark
    from prooflight_line.causes.nozzles import Streak
    from prooflight_line.causes.repeats import Repeat
    from prooflight_line.causes.trends import Trend
    from prooflight_line.journal.records import PageRecord

Kind = Literal["roller", "page", "streak", "density", "register", "paper", "single"]
MARK_SD_MM: Final = 0.45
"""Standard deviation of the place of a mark along the paper path. measured: docs/results/running/plant.md."""
FITS_SDS: Final = 3.0
"""Greatest difference of a distance from a circumference, in standard deviations of both."""
MOST_TURNS: Final = 10
"""Greatest number of turns a sheet by which a roller accounts for marks at one place of all sheets."""
NO_ROLLER: Final = "no roller of the press file"
AREA_MM: Final = 20.0
"""Greatest width and height of a mark that has a place along the paper path; larger ones are areas."""
PAPER_SHEETS: Final = 5
PAPER_SHARE: Final = 0.2
"""Least number of sheets, and their share from the first to the last of them, whose marks without another cause are
put down to the paper. assumed: ten times the false alarms of good sheets and more."""
OF_KINDS: Final[dict[Kind, tuple[str, ...]]] = {
    "density": ("density", "missing-plane"),
    "register": ("plane-register",),
}
"""Kinds of misprint that are of one cause whatever else is seen."""
OF_WHOLE: Final = 0.8
"""Least share of sheets with a cause that are off in density or register as a whole for that to account for it.
assumed."""
PAPER_WIDTH: Final = 10.0
"""Least standard deviation of such marks' places across: they are in no one column. assumed. [mm]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """One cause, and what it explains."""

    kind: Kind
    names: tuple[str, ...]
    """Parts of the press that fit, the best first; empty: none does, or the kind has none."""
    text: str
    """One line for people."""
    marks: int
    """Number of marks that it explains; 0 for a trend."""
    sheets: int
    """Number of sheets that it explains; those beyond the tolerance for a trend."""
    first_sheet: int
    last_sheet: int
    distance_mm: float | None = None
    distance_sd_mm: float | None = None
    x_mm: float | None = None
    x_sd_mm: float | None = None
    nozzle: int | None = None
    """Number of the nozzle on the first of ``names``."""
    nozzle_sd: float | None = None
    ink: str = ""
    change: float | None = None
    """Change of a density [-] or a register [mm]."""
    change_sd: float | None = None
    false_alarm_rate: float | None = None


def named_causes(
    records: Sequence[PageRecord], *, geometry: ScanGeometry, parts: PartsBlock | None = None
) -> list[Cause]:
    """Return the causes of a run's defects, that of most sheets first.

    Marks on sheets whose density or register is off as a whole are mostly places where that is seen best: a cause of
    which most sheets are such comes after all others.

    records: all of the run, good ones too, since drifts show on these as well. parts: of the press file.
    """
    parts = parts or PartsBlock()
    marks = marks_of(records, geometry)
    streaks = streaks_of(marks)
    placed_causes = [(_of_streak(streak, parts), _sheets(streak.marks)) for streak in streaks]
    others = [mark for mark in marks if mark.kind not in COLUMN_KINDS]
    placed = [mark for mark in others if max(mark.width_mm, mark.height_mm) <= AREA_MM]
    distance = sheet_distance_mm(records, geometry)
    sheet_mm = distance or max((mark.y_mm for mark in marks), default=1.0)
    repeats = repeats_of(placed, sheet_mm=sheet_mm, sd_mm=MARK_SD_MM)
    placed_causes += [(_of_repeat(repeat, parts), _sheets(repeat.marks)) for repeat in repeats]
    explained = {id(mark) for repeat in repeats for mark in repeat.marks}
    rest = [mark for mark in others if id(mark) not in explained]
    placed_causes += [(cause, _sheets(rest)) for cause in _of_rest(rest)]
    trends = trends_of(records)
    of_trends = list(map(_of_trend, trends))
    named = {cause.kind for cause in of_trends if cause.sheets}
    of_kinds = [cause for cause in _of_kinds(records) if cause.kind not in named]
    whole = {sheet for trend in trends if trend.beyond for sheet in trend.near}
    kinds = {kind for cause in [*of_trends, *of_kinds] if cause.sheets for kind in OF_KINDS[cause.kind]}
    whole |= {one.sheet for one in records if one.verdict.kind in kinds}
    shares = [(cause, _share(cause_sheets, whole)) for cause, cause_sheets in placed_causes]
    after = [cause for cause, share in shares if share >= OF_WHOLE]
    first = [cause for cause, share in shares if share < OF_WHOLE] + of_trends + of_kinds
    return [*sorted(first, key=_most_sheets), *sorted(after, key=_most_sheets)]


def _sheets(marks: Sequence[Mark]) -> set[int]:
    return {mark.sheet for mark in marks}


def _share(sheets: set[int], others: set[int]) -> float:
    """Return the share of sheets that are among others."""
    return len(sheets & others) / max(len(sheets), 1)


def _most_sheets(cause: Cause) -> int:
    return -cause.sheets


def _fitting(repeat: Repeat, rollers: Sequence[RollerBlock]) -> list[RollerBlock]:
    """Return the rollers of which the circumference is the distance of a repeat, the nearest first.

    Marks at one place of all sheets recur with the sheets, so that a roller that turns a whole number of times a
    sheet accounts for them as well.
    """
    if repeat.distance_mm is None:
        return []
    off: list[tuple[float, int]] = []
    for at, roller in enumerate(rollers):
        turns = max(round(repeat.distance_mm / roller.circumference_mm), 1) if repeat.on_page else 1
        sd = np.hypot(repeat.sd_mm, turns * roller.tolerance_mm)
        deviation = abs(repeat.distance_mm - turns * roller.circumference_mm) / sd
        if deviation <= FITS_SDS and turns <= MOST_TURNS:
            off.append((float(deviation), at))
    return [rollers[at] for _, at in sorted(off)]


def _of_repeat(repeat: Repeat, parts: PartsBlock) -> Cause:
    rollers = [roller.name for roller in _fitting(repeat, parts.rollers)]
    x = f"{repeat.x_mm:.0f} mm from the left"
    number = len(repeat.marks)
    kind: Kind = "page" if repeat.on_page else "roller"
    distance = f"{repeat.distance_mm:.2f} mm (+- {2 * repeat.sd_mm:.2f})" if repeat.distance_mm else ""
    if repeat.on_page:
        also = f"; {' or '.join(rollers)} would repeat at the same distance" if rollers else ""
        y = float(np.median([mark.y_mm for mark in repeat.marks]))
        text = (
            f"{count(number, 'mark')} {x} and {y:.0f} mm from the top of each sheet: page data or plate{also}"
        )
    else:
        text = f"{count(number, 'mark')} every {distance}, {x}: {' or '.join(rollers) or NO_ROLLER}"
    return Cause(
        kind=kind,
        names=tuple(rollers),
        text=text,
        distance_mm=repeat.distance_mm,
        distance_sd_mm=repeat.sd_mm if repeat.distance_mm else None,
        x_mm=repeat.x_mm,
        false_alarm_rate=repeat.false_alarm_rate,
        **_extent(repeat.marks),
    )


def _of_streak(streak: Streak, parts: PartsBlock) -> Cause:
    nozzles = nozzles_at(streak, parts.heads)
    place = f"streak {streak.x_mm:.2f} mm (+- {2 * streak.sd_mm:.2f}) from the left"
    named = " or ".join(f"{one.head}, nozzle {one.number} (+- {2 * one.sd:.1f})" for one in nozzles)
    missing = "no head of the press file prints there" if parts.heads else "the press file states no heads"
    return Cause(
        kind="streak",
        names=tuple(one.head for one in nozzles),
        text=f"{place}: {named or missing}",
        x_mm=streak.x_mm,
        x_sd_mm=streak.sd_mm,
        nozzle=nozzles[0].number if nozzles else None,
        nozzle_sd=nozzles[0].sd if nozzles else None,
        ink=streak.ink,
        **_extent(streak.marks),
    )


def _of_rest(marks: Sequence[Mark]) -> list[Cause]:
    """Return the cause of marks that nothing else explains: the paper, if many sheets have them, or none in common."""
    if not marks:
        return []
    sheets = {mark.sheet for mark in marks}
    often = len(sheets) >= max(PAPER_SHEETS, PAPER_SHARE * (max(sheets) - min(sheets) + 1))
    areas = sum(max(mark.width_mm, mark.height_mm) > AREA_MM for mark in marks)
    if often and (2 * areas > len(marks) or np.std([mark.x_mm for mark in marks]) > PAPER_WIDTH):
        text = (
            f"{count(len(marks), 'mark')} anywhere on the sheets, at no constant distance: paper, or toning"
        )
        return [Cause(kind="paper", names=(), text=text, **_extent(marks))]
    text = f"{count(len(marks), 'mark')} without a common cause"
    return [Cause(kind="single", names=(), text=text, **_extent(marks))]


def _of_kinds(records: Sequence[PageRecord]) -> list[Cause]:
    """Return the causes of misprints that were judged wrong as a whole, on as many sheets as for paper.

    Where amounts are recorded in part or not at all no trend may show; which ink it is is then not known.
    """
    causes = []
    for kind, kinds in OF_KINDS.items():
        sheets = [one.sheet for one in records if one.verdict.kind in kinds]
        if sheets and len(sheets) >= max(PAPER_SHEETS, PAPER_SHARE * (sheets[-1] - sheets[0] + 1)):
            text = f"{count(len(sheets), 'sheet')} with a deviation in {kind}; the ink is unknown"
            causes.append(
                Cause(
                    kind=kind,
                    names=(),
                    text=text,
                    marks=0,
                    sheets=len(sheets),
                    first_sheet=sheets[0],
                    last_sheet=sheets[-1],
                )
            )
    return causes


def _of_trend(trend: Trend) -> Cause:
    channel = trend.channel
    kind: Kind = "density" if channel.name.startswith("gain-") else "register"
    ink = channel.name.split("-")[1]
    change, sd = channel.scale * trend.change, channel.scale * trend.sd
    amount = f"{change:+.2f} {channel.unit} (+- {2 * sd:.2f})"
    text = f"{channel.what} stepped by {amount} at sheet {trend.sheet}"
    if trend.shape == "drift":
        text = f"{channel.what} drifted by {amount}"
    return Cause(
        kind=kind,
        names=(ink,),
        text=text,
        marks=0,
        sheets=len(trend.beyond),
        first_sheet=trend.sheet,
        last_sheet=trend.last_sheet,
        ink=ink,
        change=trend.change,
        change_sd=trend.sd,
    )


def _extent(marks: Sequence[Mark]) -> dict[str, Any]:
    sheets = {mark.sheet for mark in marks}
    return {
        "marks": len(marks),
        "sheets": len(sheets),
        "first_sheet": min(sheets),
        "last_sheet": max(sheets),
    }
