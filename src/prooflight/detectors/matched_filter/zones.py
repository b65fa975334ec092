"""Zones in the matched-filter detector: ignored areas are excluded, careful areas are also tested separately.

Ignored areas have no weight in fit and sums, like what is off the page, and contain no landmark; so they can
neither alarm nor hide anything outside.

For careful areas, the extremes of the boxes and streaks of the screening pass are taken there alone. The
greatest deviation of these from good prints of the same pages is the area's score. The page as a whole may
use (1 - w) of the guaranteed rate of false alarms, careful areas w. Theorem: let p be a page's p-value, and q
that of its careful areas, each at most u with probability at most u on good prints. Then min(p / (1 - w), q /
w) is at most u with probability at most u (Bonferroni, weighted; Genovese, Roeder and Wasserman 2006):
however the two depend on each other, the guarantee holds for the page. q is conformal: from prints that are
exchangeable with those of the run, of pages with these zones, scored with a mean and a standard deviation
that were estimated on others (Vovk et al. 2005, chapter 4). p is that of the press as it was trained, or that
of a press whose own good pages are the same prints with zones in force, whichever is greater: the ranking's
training pages determine the tail of the scores, and these prints how often such pages reach into it
(``PressScores``). Their own tail is not extrapolated: it would be that of few prints of few pages, whose
scores may be clustered. Once there are enough of them they decide by count, alone.

All pages have a score on one scale, with zones or without: the press's trained threshold, plus the excess of
the page or of its careful areas over theirs. So labels of pages with zones calibrate it like any other
(``CalibratedDetector.decided``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from prooflight.detectors.base import Inspection, StoredArrays
from prooflight.detectors.false_alarm_rate import FURTHEST, GoodScores, PressScores
from prooflight.detectors.matched_filter.calibrated import WRONG_PAGE, CalibratedDetector
from prooflight.detectors.matched_filter.glyphs.scoring import NONE
from prooflight.detectors.matched_filter.statistics.boxes import boxes, cells_of
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    BASELINE_MM,
    WIDTHS,
    Scatter,
    Sums,
    t_statistic,
    without_common,
)
from prooflight.detectors.matched_filter.statistics.statistic import (
    GOOD_PRINTS,
    SCREEN_MODES,
    Observed,
    Statistic,
    mode_and_ink,
    values_of,
)
from prooflight.errors import RequestError
from prooflight.pages.zones.zone import Calibration, PageZones

if TYPE_CHECKING:
    from prooflight.detectors.optional import GoodPrint
    from prooflight.detectors.verdict import Decision

STREAK_TILES: Final = (1, 2, 4)
"""Widths of the streaks that are computed for careful areas, 0.5 to 2 mm. [tiles]"""
SPAN: Final = 0
"""Index of the span whose scatter they have: streaks over a quarter of the page."""
LEAST_SD: Final = 0.05
"""Minimum standard deviation of a statistic on good prints; assumed: otherwise one that hardly varies would
decide alone."""
MOST_OF_RATE: Final = 0.5
"""Maximum share of the guaranteed rate that careful areas may use."""
TOO_FEW: Final = "price the zones by more prints: `prooflight zones price --prints`"
LEARNING: Final = 3
"""Number of prints of which one measures the usual statistics of careful areas; the others calibrate them."""
FEWEST_PRINTS: Final = 12
LUCK: Final = 1.5
"""Factor on the number of prints where only some pages have a careful area, since fewer may be drawn than expected."""


def careful_statistics(sums: Sums, scatter: Scatter, careful: NDArray[np.bool_]) -> list[Observed]:
    """Return extremes of boxes whose middle is in a careful area (lines, pixels), and of streaks through it.

    Their order is fixed. sums: of ``SCREEN_MODES`` at least.
    """
    own, of_own = sums.of_modes(SCREEN_MODES), scatter.of_modes(SCREEN_MODES)
    side = round(own.tile_mm / own.pixel_mm)
    rows, columns = own.tiles.shape[-2:]
    cut = careful[: rows * side, : columns * side].reshape(rows, side, columns, side)
    within = cut.mean(axis=(1, 3), dtype=np.float32) >= 0.5
    return [*_of_boxes(own, of_own, within), *_of_streaks(own, of_own, within)]


def _of_boxes(sums: Sums, scatter: Scatter, within: NDArray[np.bool_]) -> Iterator[Observed]:
    for place, cells in enumerate(cells_of(sums, scatter.light)):
        step = cells.size // 2
        middles = [
            np.minimum((np.arange(extent) + 1) * step, tiles - 1)
            for extent, tiles in zip(cells.sums.shape[-2:], within.shape, strict=True)
        ]
        there, maps = within[np.ix_(*middles)], boxes(cells)
        for index, name in enumerate(sums.modes):
            own, power, edges = (one[index] for one in maps)
            t = np.where(there, t_statistic(own, power, edges, scatter.boxes[index, place]), 0)
            for sign, signed in (("+", t), ("-", -t)):
                row, column = np.unravel_index(int(signed.argmax()), t.shape)
                which = Statistic("box", *mode_and_ink(name), sign, cells.size, "", GOOD_PRINTS)
                box = cells.box_mm(sums, int(row), int(column))
                yield Observed(statistic=which, value=float(signed[row, column]), box=box)


def _of_streaks(sums: Sums, scatter: Scatter, within: NDArray[np.bool_]) -> Iterator[Observed]:
    """Yield streaks along the travel, over the careful part of each column's height.

    The level about them is removed.
    """
    own, power, edges = without_common(
        (sums.tiles[:, : len(sums.modes)] * within).sum(axis=-2, dtype=np.float32), sums.prior.place
    )
    wide = round(BASELINE_MM / sums.tile_mm) | 1
    push, sure = (ndimage.uniform_filter1d(one, wide, mode="constant") for one in (own, power))
    own = own - push / np.maximum(sure, 1e-6) * power
    rows = np.flatnonzero(within.any(axis=1))
    top, bottom = (int(rows[0]), int(rows[-1]) + 1) if rows.size else (0, 1)
    for tiles in STREAK_TILES:
        parts = [
            np.asarray(ndimage.uniform_filter1d(one, tiles, mode="constant") * tiles)
            for one in (own, power, edges)
        ]
        width = WIDTHS.index(2 * tiles)
        for index, name in enumerate(sums.modes):
            pushed, information, at_edges = (one[index] for one in parts)
            t = t_statistic(pushed, information, at_edges, scatter.streaks[index, width, SPAN])
            for sign, signed in (("+", t), ("-", -t)):
                column = int(signed.argmax())
                which = Statistic("streak", *mode_and_ink(name), sign, 2 * tiles, "careful", GOOD_PRINTS)
                left = (column - (tiles - 1) / 2) * sums.tile_mm + sums.left_mm
                box = (
                    left,
                    top * sums.tile_mm + sums.top_mm,
                    tiles * sums.tile_mm,
                    (bottom - top) * sums.tile_mm,
                )
                yield Observed(statistic=which, value=float(signed[column]), box=box)


def baseline_of(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return mean and standard deviation on good prints (prints, statistics): (2, statistics)."""
    return np.stack([values.mean(axis=0), np.maximum(values.std(axis=0, ddof=1), LEAST_SD)]).astype(
        np.float64
    )


def careful_scores(values: NDArray[np.floating], baseline: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the greatest deviation of each print (prints, statistics), (prints,)."""
    return np.asarray(((values - baseline[0]) / baseline[1]).max(axis=1), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ZonedJudge:
    """Decision rule for pages with zones.

    All of it is stored with a page, so that the decision can be repeated.
    """

    page_good: NDArray[np.float64]
    """(prints,) scores of good prints of pages with zones, rising."""
    careful_good: NDArray[np.float64]
    """(prints,) scores of their careful areas, rising; of size 0: this page has none."""
    baseline: NDArray[np.float64]
    """(2, statistics) ``baseline_of``."""
    share: float
    """Share of the guaranteed rate that careful areas may use."""

    @classmethod
    def of(cls, zones: PageZones) -> Self | None:
        """Return the rule for zones; None: they are not calibrated.

        RequestError: another version calibrated them.
        """
        if zones.calibration is None:
            return None
        return cls.by(zones.calibration, zones.careful_share, careful="careful" in zones.kinds)

    @classmethod
    def by(cls, calibration: Calibration, share: float, *, careful: bool) -> Self:
        """Return the rule of a calibration; careful: whether the page has careful areas.

        RequestError: as for ``of``.
        """
        if careful and not (
            len(calibration.careful_scores) > 1
            and len(calibration.careful_mean) == STATISTICS == len(calibration.careful_sd)
        ):
            raise RequestError(
                "zones", "their price was computed for other careful areas", remedy="price them again"
            )
        if len(calibration.page_scores) < 2:
            raise RequestError(
                "zones", "their price was computed from fewer than 2 prints", remedy="price them again"
            )
        good = calibration.careful_scores if careful else ()
        return cls(
            page_good=np.sort(np.array(calibration.page_scores, np.float64)),
            careful_good=np.sort(np.array(good, np.float64)),
            baseline=np.array([calibration.careful_mean, calibration.careful_sd], np.float64)
            if careful
            else np.zeros((2, 0)),
            share=share,
        )

    @classmethod
    def from_stored(cls, stored: StoredArrays) -> tuple[Self, NDArray[np.float32]] | None:
        """Return the stored rule and the careful area's statistics; None: the page has no zones."""
        if "zones_page" not in stored.stored_arrays:
            return None
        share = float(stored.array("zones_share", "f", (), finite=True))
        page = stored.array("zones_page", "f", (None,), finite=True)
        if "careful" not in stored.stored_arrays:
            nothing = np.zeros(0)
            judge = cls(page_good=page, careful_good=nothing, baseline=np.zeros((2, 0)), share=share)
            return judge, nothing.astype(np.float32)
        careful = stored.array("careful_good", "f", (None,), finite=True)
        baseline = stored.array("careful_baseline", "f", (2, STATISTICS), finite=True)
        judge = cls(page_good=page, careful_good=careful, baseline=baseline, share=share)
        return judge, stored.array("careful", "f", (STATISTICS,))

    def stored_arrays(self, values: NDArray[np.float32]) -> Mapping[str, NDArray[Any]]:
        """Return what ``from_stored`` needs."""
        always = {"zones_page": self.page_good, "zones_share": np.array(self.share)}
        if not self.careful_good.size:
            return always
        return always | {
            "careful": values,
            "careful_good": self.careful_good,
            "careful_baseline": self.baseline,
        }

    def rates(self, nominal: float) -> tuple[float, float]:
        """Return the shares of a rate of the page as a whole and of its careful areas.

        The latter is 0 if there are no careful areas.

        RequestError: the prints are too few for alarms that rare.
        """
        if not self.careful_good.size:
            return nominal, 0.0
        careful = max(self.share * nominal, GoodScores(worst=self.careful_good).least_rate)
        if careful > MOST_OF_RATE * nominal:
            count = self.careful_good.size
            odds = f"{1 / (self.share * nominal):,.0f}"
            what = f"{count} prints are too few for careful areas that alarm in 1 of {odds} pages"
            raise RequestError("zones", what, remedy=TOO_FEW)
        return nominal - careful, careful

    def decide(self, detector: CalibratedDetector, score: float, values: NDArray[np.floating]) -> Decision:
        """Decide at the trained threshold; score: of the page as a whole.

        values (statistics,): of its careful areas.

        The decision's score is above its threshold by the greater of the two excesses over their own
        thresholds.
        """
        page_rate, careful_rate = self.rates(detector.ranking_rate)
        zoned = PressScores(reference=detector.scores.reference, own=GoodScores(worst=self.page_good))
        both, at = (detector.scores, zoned), detector.trained_threshold
        threshold = max(at, *(of.threshold(page_rate)[0] for of in both))
        p_page = max(of.p_value(score, page_rate) for of in both) if np.isfinite(score) else 1.0
        if not careful_rate:
            return detector.decision(at + (score - threshold), at, p_page)
        good = GoodScores(worst=self.careful_good)
        careful = float(careful_scores(values[None], self.baseline)[0])
        above = careful - good.threshold(careful_rate)[0]
        p_careful = good.p_value(careful) if np.isfinite(careful) else 1.0
        part = careful_rate / detector.ranking_rate
        p_value = min(p_page / (1 - part), p_careful / part, 1.0)
        return detector.decision(at + float(np.maximum(score - threshold, above)), at, p_value)

    def careful_alarms(self, detector: CalibratedDetector, values: NDArray[np.floating]) -> bool:
        """Return whether careful areas alone are enough for an alarm."""
        _, rate = self.rates(detector.ranking_rate)
        return bool(rate) and bool(
            careful_scores(values[None], self.baseline)[0]
            > GoodScores(worst=self.careful_good).threshold(rate)[0] + detector.raised
        )

    def greatest(self, observed: Sequence[Observed]) -> Observed:
        """Return the careful area's statistic with the greatest deviation, with that as its value."""
        deviations = (values_of(observed) - self.baseline[0]) / self.baseline[1]
        most = int(deviations.argmax())
        one = observed[most]
        return Observed(statistic=one.statistic, value=float(deviations[most]), box=one.box)


STATISTICS: Final = 2 * len(SCREEN_MODES) * (6 + len(STREAK_TILES))
"""Number of statistics of careful areas: both signs of every mode, of boxes of six sizes and of streaks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchedFilterPricing:
    """See ``ZonePricing``."""

    calibrated: CalibratedDetector

    @property
    def rate(self) -> float:
        """See ``ZonePricing``: the ranking's share, since glyphs and floor know no zones."""
        return self.calibrated.ranking_rate

    def fewest_prints(self, careful_share: float) -> int:
        """See ``ZonePricing``.

        Of the prints that show a careful area, all but one in ``LEARNING`` calibrate, their tail extrapolated,
        and one less of them: each is judged by the others.
        """
        if not careful_share:
            return FEWEST_PRINTS
        needed = (1 / (FURTHEST * MOST_OF_RATE * self.rate) + 1) * LEARNING / (LEARNING - 1) / careful_share
        return max(math.ceil(needed * (1.0 if careful_share == 1 else LUCK)), FEWEST_PRINTS)

    def score(self, inspection: Inspection) -> float:
        """See ``ZonePricing``."""
        score = self.calibrated.score_again(StoredArrays(inspection.stored_arrays, self.calibrated.name))
        return score if np.isfinite(score) else WRONG_PAGE

    def alarms(self, score: float) -> bool:
        """See ``ZonePricing``."""
        return score > self.calibrated.threshold

    def calibration(self, prints: Sequence[GoodPrint]) -> Calibration:
        """See ``ZonePricing``."""
        careful = [one.careful for one in prints if one.careful is not None]
        learned = np.array(careful[::LEARNING])
        others = np.array([one for at, one in enumerate(careful) if at % LEARNING])
        mean = sd = scores = np.zeros(0)
        if careful:
            if len(others) < 2 or len(learned) < 2:
                raise RequestError("prints", "too few show a careful area", remedy="give more of them")
            baseline = baseline_of(learned)
            mean, sd = baseline
            scores = careful_scores(others, baseline)
        return Calibration(
            page_scores=tuple(round(one.after, 6) for one in prints),
            careful_scores=tuple(np.round(scores, 6).tolist()),
            careful_mean=tuple(np.round(mean, 6).tolist()),
            careful_sd=tuple(np.round(sd, 6).tolist()),
        )

    def alarmed(
        self, prints: Sequence[GoodPrint], calibration: Calibration, share: float
    ) -> tuple[list[tuple[GoodPrint, bool]], float]:
        """See ``ZonePricing``."""
        judges = {
            careful: ZonedJudge.by(calibration, share, careful=careful)
            for careful in {one.careful is not None for one in prints}
        }
        careful_rate = max(judge.rates(self.rate)[1] for judge in judges.values())  # may be refused
        scored = [one for at, one in enumerate(prints) if at % LEARNING]
        return [
            (one, self._alarms(one, scored, judges[one.careful is not None])) for one in scored
        ], careful_rate

    def _alarms(self, one: GoodPrint, scored: Sequence[GoodPrint], judge: ZonedJudge) -> bool:
        """Return whether a good print alarms, judged by the others."""
        others = [other for other in scored if other is not one]
        left = replace(judge, page_good=np.sort([other.after for other in others]))
        values = np.zeros(judge.baseline.shape[1]) if one.careful is None else one.careful
        if judge.careful_good.size:
            theirs = np.array([other.careful for other in others if other.careful is not None])
            left = replace(left, careful_good=np.sort(careful_scores(theirs, judge.baseline)))
        return self.calibrated.decided(left.decide(self.calibrated, one.after, values), NONE).misprint
