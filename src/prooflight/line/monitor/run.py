"""What a run says that no page of it says: inks that drift, registers that wander, a streak that stays at one place.

Every page gives values for channels: amounts of ink, register, light, and the light of narrow columns. ``cusum`` sums
up their small deviations; an alarm is fitted as a drift or a step, carried on over the rest of the run, and weighed:
stop, reprint or go on, whichever is expected to cost least.

The null: a good run's pages are exchangeable in every channel. Then one run in so many raises a false alarm, by the
stated rate, which is shared out evenly: half among the drift channels, half among the columns.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np

from prooflight.line.monitor.channels import Channel, column_channels, drift_channels
from prooflight.line.monitor.cusum import PAGES, SequentialRanks, Sums, threshold_for
from prooflight.line.monitor.forecast import Change, expected_costs

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.cost import RunningCosts
    from prooflight.line.monitor.forecast import Advice

AnnouncementKind = Literal["drift", "step", "streak", "excursion"]

RECENT: Final = 256
"""Pages whose values are kept to fit what an alarm saw."""
LEAST_SHARE: Final = 0.1
"""Of the tolerance: a change that is certain but smaller is not worth a word."""
NEWS_SHARE: Final = 0.25
"""Of the tolerance: what was announced is announced again when it has grown by so much."""
APART_MM: Final = 3.0
"""Columns closer than this are one streak."""
FARTHEST: Final = 1e6
"""Beyond, a share or millimetres are a fault of reckoning, and no value."""
UNKNOWN_PAGES_LEFT: Final = 1000
"""assumed where nobody says how long the run is."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageEvidence:
    """What one page adds to its run."""

    values: Mapping[str, float] = field(default_factory=dict)
    """By channel; channels of which the page says nothing are missing."""
    columns: NDArray[np.float32] | None = None
    """(columns,) light over what was expected, less what is alike nearby [-]; None: nothing is known."""
    summary: NDArray[np.float64] | None = None
    """``inspection.promise.summary_of``."""

    @property
    def unsound(self) -> tuple[str, ...]:
        """Channels whose value is there and yet no number that a page can have."""
        return tuple(name for name, value in self.values.items() if not abs(value) <= FARTHEST)

    def sound(self) -> PageEvidence:
        """The same without them."""
        left_out = self.unsound
        if not left_out:
            return self
        kept = {name: value for name, value in self.values.items() if name not in left_out}
        return replace(self, values=kept)


@dataclass(frozen=True, slots=True, kw_only=True)
class Announcement:
    """A change that the run shows."""

    kind: AnnouncementKind
    channel: str
    sheet: int
    """At which it was announced."""
    since: int
    """Sheet from which it seems to go back to."""
    level: float
    """Now, off what was expected, in the channel's own unit: a share or millimetres."""
    slope_a_page: float
    tolerance: float
    pages_to_tolerance: int | None
    """Until the level leaves tolerance; 0: it has; None: it is not on its way."""
    pages_left: int
    costs_cents: Mapping[Advice, float]
    """Expected, of the three ways to go on."""
    action: Advice
    """The cheapest."""
    x_mm: float | None
    """Where across the page, of a streak."""
    text: str
    """One line for people."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunMonitor:
    """Evidence of one run so far; ``see`` every page in the order of the run. Its size does not grow."""

    channels: tuple[Channel, ...]
    """Drifts, then columns."""
    drifts: int
    costs: RunningCosts
    false_alarms: float
    """Stated, a 100,000 pages."""
    thresholds: NDArray[np.float64]
    """(channels,) [sd]"""
    ranks: SequentialRanks
    sums: Sums
    recent: NDArray[np.float32]
    """(RECENT, channels) of the last pages, in turn."""
    sheets: NDArray[np.int64]
    """(RECENT,) their numbers; -1: none yet."""
    standing: dict[int, Announcement]

    @classmethod
    def begin(
        cls,
        *,
        sensors: Sequence[str],
        columns_mm: Sequence[float] | NDArray[np.float64],
        costs: RunningCosts,
        false_alarms: float = 1.0,
    ) -> Self:
        """Before the first page. columns_mm: where columns lie on the page; false_alarms: a 100,000 pages."""
        drifts = drift_channels(sensors)
        columns = column_channels(columns_mm)
        channels = drifts + columns
        thresholds = np.empty(len(channels))
        for part in (slice(0, len(drifts)), slice(len(drifts), None)):
            tests = 2 * max(thresholds[part].size, 1)
            thresholds[part] = threshold_for(PAGES * tests / (false_alarms / 2))
        return cls(
            channels=channels,
            drifts=len(drifts),
            costs=costs,
            false_alarms=false_alarms,
            thresholds=thresholds,
            ranks=SequentialRanks.of(len(channels)),
            sums=Sums.of(len(channels)),
            recent=np.full((RECENT, len(channels)), np.nan, np.float32),
            sheets=np.full(RECENT, -1, np.int64),
            standing={},
        )

    def see(self, sheet: int, evidence: PageEvidence, *, pages_left: int | None = None) -> list[Announcement]:
        """Add a page; returns what is to be announced now. pages_left: after this page."""
        values = self._values(evidence)
        place = sheet % RECENT
        self.recent[place], self.sheets[place] = values, sheet
        self.sums.add(self.ranks.score(values), sheet)
        found = []
        for side, channel in np.argwhere(self.sums.total >= self.thresholds).tolist():
            since = int(self.sums.since[side, channel])
            found.append(
                (channel, self._told(channel, self._change(channel, since), since, sheet, pages_left))
            )
            self.sums.restart(side, channel, sheet)
        return self._news(found)

    def excursion(
        self, sheet: int, name: str, level: float, *, pages_left: int | None = None
    ) -> list[Announcement]:
        """What follows the press slowly has come to the end of what it may follow: that is evidence too."""
        channel = next(i for i, one in enumerate(self.channels) if one.name == name)
        change = Change(level=level, slope=0.0, scatter=self._change(channel, 0).scatter)
        told = self._told(channel, change, 0, sheet, pages_left, excursion=True)
        return self._news([(channel, told)])

    def _values(self, evidence: PageEvidence) -> NDArray[np.float32]:
        values = np.full(len(self.channels), np.nan)
        for index, channel in enumerate(self.channels[: self.drifts]):
            values[index] = evidence.values.get(channel.name, np.nan)
        if evidence.columns is not None:
            values[self.drifts :] = evidence.columns
        return np.where(np.abs(values) <= FARTHEST, values, np.nan).astype(np.float32)

    def _change(self, channel: int, since: int) -> Change:
        known = (self.sheets >= since) & np.isfinite(self.recent[:, channel])
        if not known.any():
            return Change(level=0.0, slope=0.0, scatter=0.0)
        return Change.fitted(self.sheets[known], self.recent[known, channel].astype(np.float64))

    def _told(
        self,
        index: int,
        change: Change,
        since: int,
        sheet: int,
        pages_left: int | None,
        *,
        excursion: bool = False,
    ) -> Announcement:
        channel = self.channels[index]
        left = UNKNOWN_PAGES_LEFT if pages_left is None else pages_left
        costs = expected_costs(
            change,
            tolerance=channel.tolerance,
            pages_since=min(sheet - since + 1, RECENT),
            pages_left=left,
            costs=self.costs,
        )
        action: Advice = min(costs, key=lambda way: costs[way])
        kind: AnnouncementKind = "excursion" if excursion else "drift" if change.slope else "step"
        if channel.x_mm is not None:
            kind = "streak"
        to_tolerance = change.pages_to(channel.tolerance)
        return Announcement(
            kind=kind,
            channel=channel.name,
            sheet=sheet,
            since=since,
            level=change.level,
            slope_a_page=change.slope,
            tolerance=channel.tolerance,
            pages_to_tolerance=to_tolerance,
            pages_left=left,
            costs_cents=costs,
            action=action,
            x_mm=channel.x_mm,
            text=_worded(channel, kind, change, since, to_tolerance, action),
        )

    def _news(self, found: list[tuple[int, Announcement]]) -> list[Announcement]:
        """What is worth a word: strongest first, nothing that is known, one of columns that are one streak."""
        news: list[Announcement] = []
        for index, told in sorted(found, key=lambda one: -abs(one[1].level) / one[1].tolerance):
            if told.kind != "excursion" and abs(told.level) < LEAST_SHARE * told.tolerance:
                continue
            before = [old for other, old in self.standing.items() if self._same(index, other)]
            grown = all(
                abs(told.level) - abs(old.level) >= NEWS_SHARE * told.tolerance
                or (old.action == "accept" and told.action != "accept")
                for old in before
            )
            if grown:
                self.standing[index] = told
                news.append(told)
        return news

    def _same(self, one: int, other: int) -> bool:
        x_mm, other_mm = self.channels[one].x_mm, self.channels[other].x_mm
        if x_mm is None or other_mm is None:
            return one == other
        return abs(x_mm - other_mm) < APART_MM


def _worded(
    channel: Channel,
    kind: AnnouncementKind,
    change: Change,
    since: int,
    to_tolerance: int | None,
    action: Advice,
) -> str:
    def shown(value: float) -> str:
        return f"{value * channel.scale:+.2g} {channel.unit}"

    within = f"tolerance {channel.tolerance * channel.scale:.2g} {channel.unit}"
    if kind == "excursion":
        return (
            f"{channel.what} is off by {shown(change.level)}, as far as it is followed ({within}): {action}"
        )
    moving = f", {shown(change.slope)} a page" if change.slope else ""
    ahead = ""
    if to_tolerance is not None:
        ahead = ", out of tolerance" if to_tolerance == 0 else f", leaves tolerance in {to_tolerance} pages"
    return f"{channel.what}: {shown(change.level)}{moving} since sheet {since}{ahead} ({within}): {action}"
