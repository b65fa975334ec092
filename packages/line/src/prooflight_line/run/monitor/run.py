"""Monitoring of a run for what no single page shows: drifting inks and registers, and stationary streaks.

Every page gives values for channels: amounts of ink, register, light, and the light of narrow columns. ``cusum``
accumulates their small deviations; at an alarm, a drift or a step is fitted and extrapolated over the rest of the
run, and the response of least expected cost is recommended: stop, reprint or go on.

Null hypothesis: a good run's pages are exchangeable in every channel. Runs then raise false alarms at the stated
rate, half of which is divided evenly among the drift channels and half among the columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np
from scipy import special

from prooflight_line.run.monitor.channels import Channel, column_channels, drift_channels
from prooflight_line.run.monitor.cusum import PAGES, SequentialRanks, Sums, threshold_for

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.cost import RunningCosts

AnnouncementKind = Literal["drift", "step", "streak", "excursion"]

RECENT: Final = 256
"""Number of last pages whose values are kept, to fit the change at an alarm."""
LEAST_SHARE: Final = 0.1
"""Least change that is announced, as a share of the tolerance, however certain it is."""
NEWS_SHARE: Final = 0.25
"""Growth after which an announced change is announced again, as a share of the tolerance."""
STREAK_SEPARATION_MM: Final = 3.0
"""Distance below which columns belong to one streak."""
FARTHEST: Final = 1e6
"""Limit of valid values: a share, or millimetres, beyond it is a numerical fault."""
UNKNOWN_PAGES_LEFT: Final = 1000
"""Number of pages assumed to remain if the run's length is unknown."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageEvidence:
    """Contribution of one page to the monitoring of its run."""

    values: Mapping[str, float] = field(default_factory=dict)
    """Values by channel; channels without a value on this page are missing."""
    columns: NDArray[np.float32] | None = None
    """(columns,) light relative to the expected, less the median of nearby columns [-]; None: unknown."""
    summary: NDArray[np.float64] | None = None
    """Summary for the test of the run, by ``inspection.guarantee.summary_of``."""

    @property
    def unsound(self) -> tuple[str, ...]:
        """Channels whose value is present but not valid."""
        return tuple(name for name, value in self.values.items() if not abs(value) <= FARTHEST)

    def sound(self) -> PageEvidence:
        """Return the same evidence without the values that are not valid."""
        left_out = self.unsound
        if not left_out:
            return self
        valid = {name: value for name, value in self.values.items() if name not in left_out}
        return replace(self, values=valid)


@dataclass(frozen=True, slots=True, kw_only=True)
class Announcement:
    """A change of the run, announced to the operator."""

    kind: AnnouncementKind
    channel: str
    sheet: int
    since: int
    """Sheet at which the change is estimated to have begun."""
    level: float
    """Present deviation from the expected value, in the channel's own unit: a share or millimetres."""
    slope_a_page: float
    tolerance: float
    pages_to_tolerance: int | None
    """Pages until the level leaves the tolerance; 0: it has; None: it does not approach it."""
    pages_left: int
    costs_cents: Mapping[Advice, float]
    """Expected costs of the three responses."""
    action: Advice
    """Response of least expected cost."""
    x_mm: float | None
    """Position across the page, for a streak."""
    text: str
    """Message in one line."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunMonitor:
    """Accumulated evidence of one run; call ``see`` with every page in order. Its memory does not grow."""

    channels: tuple[Channel, ...]
    """Channels: drifts, then columns."""
    drifts: int
    costs: RunningCosts
    false_alarms: float
    """Stated number of false alarms per 100,000 pages."""
    thresholds: NDArray[np.float64]
    """(channels,) [sd]"""
    ranks: SequentialRanks
    sums: Sums
    recent: NDArray[np.float32]
    """(RECENT, channels) values of the last pages, as a ring buffer."""
    sheets: NDArray[np.int64]
    """(RECENT,) numbers of these pages; -1: none yet."""
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
        """Return the state before the first page.

        columns_mm: positions of the columns on the page. false_alarms: stated number per 100,000 pages.
        """
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
        """Add a page; return the changes to announce now. pages_left: number of pages after this one."""
        values = self._values(evidence)
        place = sheet % RECENT
        self.recent[place], self.sheets[place] = values, sheet
        self.sums.add(self.ranks.score(values), sheet)
        candidates = []
        for side, channel in np.argwhere(self.sums.total >= self.thresholds).tolist():
            since = int(self.sums.since[side, channel])
            candidates.append(
                (channel, self._announcement(channel, self._change(channel, since), since, sheet, pages_left))
            )
            self.sums.restart(side, channel, sheet)
        return self._news(candidates)

    def excursion(
        self, sheet: int, name: str, level: float, *, pages_left: int | None = None
    ) -> list[Announcement]:
        """Announce that an adapted amount has reached its bound (``run.following``), which is evidence too."""
        channel = next(i for i, one in enumerate(self.channels) if one.name == name)
        change = Change(level=level, slope=0.0, scatter=self._change(channel, 0).scatter)
        announcement = self._announcement(channel, change, 0, sheet, pages_left, excursion=True)
        return self._news([(channel, announcement)])

    def _values(self, evidence: PageEvidence) -> NDArray[np.float32]:
        values = np.full(len(self.channels), np.nan)
        for index, channel in enumerate(self.channels[: self.drifts]):
            values[index] = evidence.values.get(channel.name, np.nan)
        if evidence.columns is not None:
            values[self.drifts :] = evidence.columns
        return np.where(np.abs(values) <= FARTHEST, values, np.nan).astype(np.float32)

    def _change(self, channel: int, since: int) -> Change:
        valid = (self.sheets >= since) & np.isfinite(self.recent[:, channel])
        if not valid.any():
            return Change(level=0.0, slope=0.0, scatter=0.0)
        return Change.fitted(self.sheets[valid], self.recent[valid, channel].astype(np.float64))

    def _announcement(
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

    def _news(self, candidates: list[tuple[int, Announcement]]) -> list[Announcement]:
        """Select the changes to announce: largest first, without known ones, and one for the columns of one streak."""
        news: list[Announcement] = []
        for index, candidate in sorted(candidates, key=lambda one: -abs(one[1].level) / one[1].tolerance):
            if candidate.kind != "excursion" and abs(candidate.level) < LEAST_SHARE * candidate.tolerance:
                continue
            earlier = [old for other, old in self.standing.items() if self._same(index, other)]
            grown = all(
                abs(candidate.level) - abs(old.level) >= NEWS_SHARE * candidate.tolerance
                or (old.action == "accept" and candidate.action != "accept")
                for old in earlier
            )
            if grown:
                self.standing[index] = candidate
                news.append(candidate)
        return news

    def _same(self, one: int, other: int) -> bool:
        x_mm, other_mm = self.channels[one].x_mm, self.channels[other].x_mm
        if x_mm is None or other_mm is None:
            return one == other
        return abs(x_mm - other_mm) < STREAK_SEPARATION_MM


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


# --- the change over the rest of the run, and the expected cost of each response ---

Advice = Literal["accept", "stop", "reprint"]
"""Response to a change: accept it, stop the run, or stop and print the doubtful pages again."""
SLOPE_SDS: Final = 2.0
"""Least significance of a slope, in standard errors: below it, the change counts as a step."""
LEAST_PAGES: Final = 12
"""Least number of pages to which a slope is fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Linear model of a channel since its change, with the scatter of single pages."""

    level: float
    """Level at the last page."""
    slope: float
    """Change per page; 0 if it is not significant."""
    scatter: float
    """Standard deviation of pages about the line."""

    @classmethod
    def fitted(cls, pages: NDArray[np.integer], values: NDArray[np.floating]) -> Self:
        """Fit a line by least squares to the pages since the estimated start of the change; (n,) each, n at least 1."""
        level, slope = float(np.median(values)), 0.0
        off = values - level
        if values.size >= LEAST_PAGES and np.ptp(pages) > 0:
            x = pages - pages.mean()
            trend = float(x @ values / (x @ x))
            about = values - values.mean() - trend * x
            sd = float(np.sqrt(about @ about / (values.size - 2) / (x @ x)))
            if abs(trend) > SLOPE_SDS * sd:
                level, slope, off = float(values.mean() + trend * x.max()), trend, about
        return cls(level=level, slope=slope, scatter=float(off.std()))

    def pages_to(self, tolerance: float) -> int | None:
        """Return the number of pages until the level leaves +-tolerance; 0: it has; None: it does not approach it."""
        if abs(self.level) >= tolerance:
            return 0
        if self.slope == 0:
            return None
        return math.ceil((tolerance - math.copysign(1, self.slope) * self.level) / abs(self.slope))

    def outside(self, pages: NDArray[np.integer], tolerance: float) -> NDArray[np.float64]:
        """Return the probability that pages (n,), counted from the last, are beyond +-tolerance."""
        level, scatter = self.level + self.slope * pages, max(self.scatter, 1e-9 * tolerance)
        beyond = special.ndtr((level - tolerance) / scatter) + special.ndtr(-(level + tolerance) / scatter)
        return np.asarray(beyond)


def expected_costs(
    change: Change, *, tolerance: float, pages_since: int, pages_left: int, costs: RunningCosts
) -> dict[Advice, float]:
    """Return the expected costs of going on, of stopping now, and of stopping and reprinting doubtful pages. [cent]

    A delivered misprint costs c_m, a stop c_f, and a reprinted page c_f, the cost of a false alarm. A slow drift
    is assumed to pass page by page; stopping removes the cause.
    """
    miss, stop = costs.missed_misprint_cents, costs.false_alarm_cents
    printed = change.outside(-np.arange(pages_since), tolerance)
    to_come = change.outside(np.arange(1, pages_left + 1), tolerance)
    delivered = miss * printed
    return {
        "accept": float(delivered.sum() + miss * to_come.sum()),
        "stop": float(stop + delivered.sum()),
        "reprint": float(stop + np.minimum(delivered, stop).sum()),
    }
