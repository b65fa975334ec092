"""Explanation of a misprint in the terms of a press room: kind, places, reason, and the state of each ink.

``Explainer`` takes the evidence that decided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import NAME_OF_INK
from prooflight.detectors.matched_filter.amounts import FarAmounts, amount_in
from prooflight.detectors.matched_filter.extents import (
    MODES_OF_EXTENT,
    Extent,
    column_evidence,
    extended,
    streak_centre,
)
from prooflight.detectors.matched_filter.glyphs.reporting import glyph_explanation, glyphs_name
from prooflight.detectors.matched_filter.naming import UNKNOWN, kind_of, named, supported
from prooflight.detectors.matched_filter.statistics.statistic import (
    FLAT_AREAS,
    Box,
    Observed,
    Statistic,
    values_of,
)
from prooflight.detectors.placing import WRONG_PAGE_KIND, place_reason
from prooflight.detectors.verdict import Decision, Ink, Region

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.analysis import ScanAnalysis
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.detectors.matched_filter.glyphs.scoring import ScoredPage
    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.detectors.matched_filter.statistics.marks import FloorFinding
    from prooflight.detectors.matched_filter.zones import ZonedJudge
    from prooflight.pages.zones.zone import PageZones
    from prooflight.prediction.tables import SensorModel
    from prooflight.registration.register import Registration

LIGHTENING: Final = ("light", "void")
"""Modes of which more makes a place lighter."""
MOST_OF_PLANE: Final = 0.5
DISTINCT_DEGREES: Final = 10.0
"""assumed: noise turns the direction of a spot of 10 standard deviations by 6 degrees."""
MISSING_PERCENT: Final = -60.0
"""Gain below which an ink is called missing, not weak: less than 40 % is there."""
LEAST_REPORTED_MM: Final = 0.05
"""Minimum displacement of a plane that is reported with its amount: 0.0 mm would be read as none."""
TIE_MM: Final = 0.05
"""Tolerance of the test whether a point is inside a region. Boxes of one size overlap by half, so that the
middle of one is on its neighbour's edge, and rounding would decide on which side. Tiles are ten times as
large."""


def distinct_inks(sensors: Sequence[SensorModel]) -> frozenset[str]:
    """Return the letters of the inks that the sensors can distinguish from every other ink.

    Each ink darkens the sensors in proportions of its own, whatever its amount: the optical densities of the
    solid ink, one per sensor, are a direction. An ink is distinct if its direction differs by more than
    ``DISTINCT_DEGREES`` from that of every other ink. A single sensor measures one direction, and so no
    distinct ink.

    Parameters
    ----------
    sensors
        Of the press; ``mean_dn`` gives the signal of paper and of each solid ink [DN].
    """
    solid = [
        tuple(-1 if ink == at else 0 for at in range(len(NAME_OF_INK))) for ink in range(len(NAME_OF_INK))
    ]
    density = np.array(
        [
            [
                max(math.log10(sensor.white_dn / max(float(sensor.mean_dn[node]), 1.0)), 0.0)
                for sensor in sensors
            ]
            for node in solid
        ]
    )
    length = np.linalg.norm(density, axis=1)
    seen = length > 0
    direction = density / np.where(seen, length, 1.0)[:, None]
    degrees = np.degrees(np.arccos(np.clip(direction @ direction.T, -1.0, 1.0)))
    degrees[:, ~seen] = np.inf  # an ink that no sensor sees cannot be mistaken for another
    np.fill_diagonal(degrees, np.inf)
    distinct = seen & (degrees.min(axis=1) > DISTINCT_DEGREES)
    return frozenset(letter for letter, alone in zip(NAME_OF_INK, distinct, strict=True) if alone)


def measured_inks(analysis: ScanAnalysis, present: str, far_off: FarAmounts | None = None) -> dict[str, Ink]:
    """Return the state of the inks of ``present``, letters of CMYK, in a print.

    A plane of which most is displaced further than registration follows is out of register by that
    displacement, and where ``far_off`` has one that is, all are where it has them.
    """
    fit, registration = analysis.fit, analysis.registration
    far = analysis.sums.shifts[:, 1] > MOST_OF_PLANE
    register_mm = registration.planes_mm + np.where(far[:, None], analysis.sums.shifts[:, 2:], 0)
    if far_off is not None and far_off.displaced.any():
        register_mm = far_off.register_mm
    return {
        letter: Ink(
            gain_percent=round(100 * float(fit.gain[ink, 0]), 2),
            dot_gain_percent=round(100 * float(fit.dot[ink]), 2),
            register_mm=(round(float(register_mm[ink, 0]), 4), round(float(register_mm[ink, 1]), 4)),
        )
        for ink, letter in enumerate(NAME_OF_INK)
        if letter in present
    }


def regions_of(
    strongest: Sequence[tuple[str, Observed]],
    kinds: Sequence[str],
    *,
    shift_mm: tuple[float, float],
    size_mm: tuple[float, float],
    measured: Callable[[Observed], dict[str, Any]] = lambda _: {},
) -> tuple[Region, ...]:
    """Return places, the strongest first: statistics' boxes, less the print's shift, clipped to the page.

    measured: returns what else a statistic states of its region (ink, darker_percent, above_good_sd).

    A box whose middle is in an earlier region, or within ``TIE_MM`` of one, gives no region of its own.
    Without any box the region is the page as a whole.
    """
    regions: list[Region] = []
    for (_, statistic), kind in zip(strongest, kinds, strict=True):
        x, y, width, height = statistic.box
        if math.isnan(x):
            continue
        left, right = (
            min(max(v - shift_mm[0], 0.0), size_mm[0]) for v in (x, x + min(width, 2 * size_mm[0]))
        )
        top, bottom = (
            min(max(v - shift_mm[1], 0.0), size_mm[1]) for v in (y, y + min(height, 2 * size_mm[1]))
        )
        middle = (left + right) / 2, (top + bottom) / 2
        if right <= left or bottom <= top or any(_holds(one, middle) for one in regions):
            continue
        box_mm = left, top, right - left, bottom - top
        regions.append(Region.rounded(box_mm, score=abs(statistic.value), kind=kind, **measured(statistic)))
    if not regions and strongest:
        first = strongest[0][1]
        regions = [whole_page(size_mm, first, kinds[0], **measured(first))]
    return tuple(regions)


def floor_explanation(floor: FloorFinding, registration: Registration) -> dict[str, Any]:
    """Return kind, place and reason of a misprint whose light differs by more than the floor."""
    shift_mm = registration.placement.shift_mm if registration.located else (0.0, 0.0)
    x, y, width, height = floor.box
    box_mm = max(x - shift_mm[0], 0.0), max(y - shift_mm[1], 0.0), width, height
    region = Region.rounded(box_mm, score=floor.area_mm2, kind="spots-voids")
    what = "darker" if floor.darker else "lighter"
    reason = f"a place of {floor.area_mm2:.1f} mm2 is much {what} than expected{_around(region)}"
    return {"kind": "spots-voids", "regions": (region,), "reason": reason}


def whole_page(size_mm: tuple[float, float], statistic: Observed, kind: str, **measured: Any) -> Region:
    """Return the page as a region, for evidence without a place; measured: as in ``regions_of``."""
    return Region.rounded((0.0, 0.0, *size_mm), score=abs(statistic.value), kind=kind, **measured)


def _holds(region: Region, point: tuple[float, float]) -> bool:
    across, down = point[0] - region.x_mm, point[1] - region.y_mm
    return -TIE_MM <= across <= region.width_mm + TIE_MM and -TIE_MM <= down <= region.height_mm + TIE_MM


def reason_for(
    kind: str,
    statistic: Observed | None,
    region: Region | None,
    inks: dict[str, Ink],
    registration: Registration,
    *,
    distinct: Collection[str],
    ink: str = "",
) -> str:
    """Return one line: what is wrong, with which ink, by how much and where.

    Only distinct inks are named, and the only ink of a page where the print of that ink as a whole is off.

    Parameters
    ----------
    kind : kind of the misprint.
    statistic : the strongest statistic; None: there is none.
    region : the first place; None: there is none.
    inks : measured state of each ink.
    registration : of the scan.
    distinct : letters of the inks that the sensors distinguish from others.
    ink : letter of the ink that is off; empty: that of the statistic.
    """
    ink = ink or _ink_of(statistic)
    match kind:
        case "wrong-page":
            return place_reason(registration)
        case "plane-register":
            return _of_register(ink, inks, distinct)
        case "density" | "missing-plane" | "swapped-planes":
            return _of_gain(kind, ink, inks, statistic, region, distinct)
        case "streak" if region is not None:
            return f"streak at x = {region.x_mm + region.width_mm / 2:.0f} mm{_in(ink, distinct)}"
        case "banding":
            return f"bands across the page{_in(ink, distinct)}"
        case "unknown" if not registration.located:
            why = registration.reason or "parts of the page are at different positions"
            return f"the position of the page cannot be determined: {why}"
    what = {
        "spots-voids": "spot" if _darker(statistic) else "void",
        "ghost-smear": "ghost",
        "local-blur": "blurred place",
        "missing-content": "missing content",
        "scum": "ink where there should be paper",
    }.get(kind, "difference all over the page" if region is None else "difference")
    return f"{what}{_in(ink, distinct)}{_around(region)}"


def _of_register(ink: str, inks: dict[str, Ink], distinct: Collection[str]) -> str:
    off = {letter: math.hypot(*one.register_mm) for letter, one in inks.items()}
    if not off:
        return "planes out of register"
    worst = ink if ink in off else max(off, key=lambda letter: off[letter])
    amount = f" {off[worst]:.1f} mm" if off[worst] >= LEAST_REPORTED_MM else ""
    return f"register of {_named(worst, inks, distinct)}{amount}"


def _of_gain(
    kind: str,
    ink: str,
    inks: dict[str, Ink],
    statistic: Observed | None,
    region: Region | None,
    distinct: Collection[str],
) -> str:
    gains = {letter: one.gain_percent for letter, one in inks.items()}
    named = ink if ink in gains else max(gains, key=lambda letter: abs(gains[letter]), default="")
    local = statistic is not None and _is_local(statistic.statistic)
    where = _around(region) if local else ""
    if not named:
        return f"wrong amount of ink{where}"
    gain = gains[named]
    if kind == "missing-plane" and (local or gain < 0):
        adjective = "missing" if gain < MISSING_PERCENT or (local and not _darker(statistic)) else "weak"
        return f"{adjective} {_named(named, inks, distinct).removeprefix('an ')}{where}"
    if ink == "" and len(gains) > 1 and np.ptp(np.sign(list(gains.values()))) == 0:
        return f"all inks {_amount(float(np.mean(list(gains.values()))))}{where}"
    return f"{_named(named, inks, distinct)} {_amount(gain)}{where}"


def _is_local(statistic: Statistic) -> bool:
    """Return whether a statistic's place is where ink is off; flat areas may be all around it."""
    return statistic.family in ("box", "spread") and statistic.reference is not FLAT_AREAS


def _amount(percent: float) -> str:
    return f"{abs(percent):.0f} % too {'strong' if percent > 0 else 'weak'}"


def _ink_of(statistic: Observed | None) -> str:
    """Return the letter of a statistic's ink; empty: it has no single ink."""
    ink = statistic.statistic.ink if statistic else ""
    return ink if ink in NAME_OF_INK else ""


def _darker(statistic: Observed | None) -> bool:
    """Return whether a statistic means that a place is darker; for light and voids, more is lighter."""
    if statistic is None:
        return False
    return statistic.statistic.sign == ("-" if statistic.statistic.mode in LIGHTENING else "+")


def _named(ink: str, inks: dict[str, Ink], distinct: Collection[str]) -> str:
    """Return the name of a plane's ink, if the sensors or the page leave no other."""
    return NAME_OF_INK[ink] if ink in distinct or len(inks) == 1 else "an ink"


def _in(ink: str, distinct: Collection[str]) -> str:
    return f" in {NAME_OF_INK[ink]}" if ink and ink in distinct else ""


def _around(region: Region | None) -> str:
    if region is None:
        return ""
    x, y = region.x_mm + region.width_mm / 2, region.y_mm + region.height_mm / 2
    return f" around x = {x:.0f} mm, y = {y:.0f} mm ({region.width_mm:.0f} x {region.height_mm:.0f} mm)"


PARTS: Final = "parts of the page do not look as designed"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """What one scan shows, as far as it decides or explains."""

    analysis: ScanAnalysis
    statistics: list[Observed]
    """All, or those of the model's screen alone."""
    score: float
    """Score of the ranking."""
    strongest: list[tuple[str, Observed]]
    """The families that speak most for a misprint, and the strongest statistic of each."""
    values: NDArray[np.float32]
    """(statistics,) values in the order of the model."""
    careful: list[Observed]
    """Statistics of the page's careful areas; empty: it has none."""
    another: bool
    """Whether the scan shows another page."""
    glyphs: ScoredPage
    floor: FloorFinding

    def settled(self) -> Evidence:
        """Return the same evidence without the scan's images; see ``ScanAnalysis.settled``."""
        return replace(self, analysis=self.analysis.settled())


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """The decision on a page."""

    decision: Decision
    by_ranking: bool
    """Whether the ranking alone calls the page a misprint."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explainer:
    """What is known of a page by which its misprints are explained."""

    prepared: PreparedPage
    inks: str
    """Letters of CMYK that the page has."""
    model: DetectorModel
    """Model by which this page is judged."""
    calibrated: CalibratedDetector
    sensors: Sequence[SensorModel]
    """Sensors of the press."""
    zones: PageZones | None
    judge: ZonedJudge | None

    def explanation(self, evidence: Evidence, judged: Judged, far: FarAmounts | None) -> dict[str, Any]:
        """Return kind, regions and reason of a misprint; empty: the page is none.

        The ranking explains first, then the floor, and wrong glyphs where they name what the ranking saw.
        far: amounts of planes that lie further off than registration follows; None: they were not looked for.
        """
        analysis, strongest, explanation = evidence.analysis, evidence.strongest, dict[str, Any]()
        if judged.by_ranking:
            explanation = self._of_ranking(evidence, far)
        if evidence.floor.alarms and not explanation:
            explanation = floor_explanation(evidence.floor, analysis.registration)
        wrong = self.calibrated.wrong_glyphs(evidence.glyphs) if judged.decision.misprint else ()
        if wrong and self.prepared.glyphs is not None:
            others, kind = explanation.get("regions", ()), explanation.get("kind", "")
            # The evidence itself decides, not the extent of the defect that it is taken for.
            places = self._places(kind, *_ordered(strongest, kind), analysis) if judged.by_ranking else others
            if not explanation or glyphs_name(self.prepared.glyphs, wrong, places, kind=kind):
                explanation = glyph_explanation(self.prepared.glyphs, wrong, others)
        return explanation

    def _of_ranking(self, evidence: Evidence, far: FarAmounts | None) -> dict[str, Any]:
        """Return kind, places and reason of a misprint; of one with a plane out of register, that."""
        analysis, strongest, another = evidence.analysis, evidence.strongest, evidence.another
        registration = analysis.registration
        if self.judge is not None and not another:
            careful = evidence.careful
            if self.judge.careful_alarms(self.calibrated, values_of(careful)):
                return self._careful_explanation(analysis, self.judge.greatest(careful))
        learned = self.model.kinds_of(evidence.values[None], self.prepared.page_features[None])[0]
        kind, ink = WRONG_PAGE_KIND, ""
        if not another:
            kind = supported(learned or named(strongest), registration, self.inks)
        if far is not None and far.displaced.any():
            kind, ink = "plane-register", far.displaced_ink
        inks = measured_inks(analysis, self.inks, far)
        regions = self._regions(strongest, kind, analysis, inks, ink=ink)
        reason = PARTS
        if another or kind != WRONG_PAGE_KIND:
            speaking = next(
                (statistic for _, statistic in strongest if kind_of(statistic.statistic) == kind), None
            )
            place = regions[0] if regions else None
            distinct = {*distinct_inks(self.sensors), ink}
            reason = reason_for(kind, speaking, place, inks, registration, distinct=distinct, ink=ink)
        return {"kind": kind, "regions": regions, "reason": reason}

    def _careful_explanation(self, analysis: ScanAnalysis, greatest: Observed) -> dict[str, Any]:
        """Return kind, places and reason of a misprint in a careful area.

        greatest: the area's greatest statistic, with its deviation.
        """
        kind, strongest = kind_of(greatest.statistic), [(greatest.statistic.cause, greatest)]
        inks = measured_inks(analysis, self.inks)
        regions = self._regions(strongest, kind, analysis, inks, careful=True)
        place = regions[0] if regions else None
        distinct = distinct_inks(self.sensors)
        reason = reason_for(kind, greatest, place, inks, analysis.registration, distinct=distinct)
        zone = None
        if place is not None and self.zones is not None:
            middle = place.x_mm + place.width_mm / 2, place.y_mm + place.height_mm / 2
            zone = self.zones.at(*middle)
        name = f" '{zone.name}'" if zone is not None and zone.kind == "careful" else ""
        return {"kind": kind, "regions": regions, "reason": f"{reason}, in the careful zone{name}"}

    def _regions(
        self,
        strongest: list[tuple[str, Observed]],
        kind: str,
        analysis: ScanAnalysis,
        inks: dict[str, Ink],
        *,
        careful: bool = False,
        ink: str = "",
    ) -> tuple[Region, ...]:
        """Return places, those of the verdict's kind first; a wrong page is wrong as a whole.

        ink: letter of the ink that is off there; empty: its amount is looked for.

        careful: the values are deviations of a careful area, of which the model does not know what good pages show.
        """
        if kind == WRONG_PAGE_KIND:
            return self._places(kind, strongest, [], analysis)
        places, kinds = _ordered(strongest, kind)
        sums, fit = analysis.sums, analysis.fit
        if kind in MODES_OF_EXTENT and not careful:
            box_of: Callable[[Extent], Box] = attrgetter("box")
            if kind == "streak":
                box_of = partial(self._streak_box, analysis)
            places, kinds = extended(kind, places, sums, fit.gain, box_of=box_of), [kind] * len(places)
        distinct = distinct_inks(self.sensors)

        def measured(statistic: Observed) -> dict[str, Any]:
            features = self.prepared.page_features
            above_good_sd = None if careful else self.model.above_good(statistic, features)
            if ink:
                return {"ink": ink, "above_good_sd": above_good_sd}
            placed = analysis.placed()
            shape = placed.where.inside.shape
            rows, columns = sums.cells_of(statistic.box, shape, (sums.pixel_mm, sums.pixel_mm))
            added = self.prepared.added
            amount = amount_in(kind, rows, columns, placed, added, fit, distinct=distinct, inks=inks)
            return asdict(amount) | {"above_good_sd": above_good_sd}

        return self._places(kind, places, kinds, analysis, measured)

    def _streak_box(self, analysis: ScanAnalysis, streak: Extent) -> Box:
        """Return the place of a streak, about its middle to a fraction of a pixel."""
        sums, where = analysis.sums, analysis.placed().where
        sensors = self.prepared.binned_sensors
        centre = streak_centre(column_evidence(streak, sums), where, sensors, sums.pixel_mm)
        _, top, width, height = streak.box
        x = sums.left_mm + (centre + 0.5) * sums.pixel_mm + _shift_mm(analysis.registration)[0]
        return x - width / 2, top, width, height

    def _places(
        self,
        kind: str,
        places: list[tuple[str, Observed]],
        kinds: list[str],
        analysis: ScanAnalysis,
        measured: Callable[[Observed], dict[str, Any]] = lambda _: {},
    ) -> tuple[Region, ...]:
        """Return the places of statistics on the page; a wrong page is wrong as a whole."""
        page = self.prepared.page
        size_mm = page.width_mm, page.height_mm
        if kind == WRONG_PAGE_KIND:  # no place is more specific than another
            return (whole_page(size_mm, places[0][1], kind),) if places else ()
        shift_mm = _shift_mm(analysis.registration)
        return regions_of(places, kinds, shift_mm=shift_mm, size_mm=size_mm, measured=measured)


def _shift_mm(registration: Registration) -> tuple[float, float]:
    """Return by how much places on a scan are right of and below those on its page."""
    return registration.placement.shift_mm if registration.located else (0.0, 0.0)


def _ordered(
    strongest: list[tuple[str, Observed]], kind: str
) -> tuple[list[tuple[str, Observed]], list[str]]:
    """Return statistics with the kinds that they indicate, those of a kind first; unspecific ones are of it."""
    kinds = [kind if (one := kind_of(statistic.statistic)) == UNKNOWN else one for _, statistic in strongest]
    order = sorted(range(len(kinds)), key=lambda at: kinds[at] != kind)
    return [strongest[at] for at in order], [kinds[at] for at in order]
