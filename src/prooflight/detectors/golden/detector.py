"""The golden detector: scans are compared with a good one, where no raster states what was to be printed.

Regions are differences to the golden scan, joined where they are close, weighted, and enclosed in boxes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.base import (
    BLOCK_PIXELS,
    ContextDetector,
    Inspection,
    PlannedPage,
    PreparedOnly,
    StoredArrays,
)
from prooflight.detectors.golden.differences import (
    GoldenDifference,
    Tolerance,
    compare,
    place_of,
    residual_of,
)
from prooflight.detectors.golden.place import TILE_PIXELS, GoldenPlace
from prooflight.detectors.placing import WRONG_PAGE_KIND
from prooflight.detectors.verdict import Decision, Region, Verdict
from prooflight.errors import RequestError, ScanError
from prooflight.pages.zones.zone import Kind, PageZones
from prooflight.prediction.predict import Prediction
from prooflight.scans.placement import Placement

if TYPE_CHECKING:
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.scan import Scan

NAME: Final = "golden"
BLOCK_SD: Final = 1 / 48
"""Mean difference of a block that counts as a standard deviation of good prints in pictures, where a quarter of the
contrast thus has the strongest colour. assumed [contrast]"""
GUARANTEE: Final = (
    "none: tolerances were tuned on real pairs, "
    "docs/results/detector/golden.md states how often good ones alarm"
)
ZONES: Final[frozenset[Kind]] = frozenset({"ignore", "normal"})
"""Kinds of zones that a comparison with one expected picture knows."""
MOST_REGIONS: Final = 12
MARGIN_PIXELS: Final = 2
"""Margin around a region: edges may be displaced so far, so that this much of it may be hidden."""
EDGE_STRIP_MM: Final = 4.0
"""Width of the strip along the sheet's edge that is not judged: a feeder's shadow lies up to 3 mm inside it."""
MOST_STRIP: Final = 0.04
"""Share of the shorter side that such a strip may take; a smaller picture is a part of a sheet, without its edge."""
EDGE_OFF_MM: Final = 0.1
"""Displacement that the edge of a letter may have on a picture, where a whole pixel is not more: toner and the
scanner's own steps. With a press, its planes' register may be off by two pixels."""
STREAK_PIXELS, STREAK_LENGTH_MM, STREAK_LEAST = 3, 4.0, 0.1
"""Width and length of the least streak that is searched for, and its least mean difference. [contrast]"""
CROPPED: Final = 0.05
"""Share by which a scan may be longer or shorter than its golden; their common part is compared."""
TURNED: Final = "the scan is turned by 180 degrees, and its places are given as the page is read"
BLOT_EDGES: Final = 4.0
"""Side of the window of the least void in print, in edge tolerances: 5 pixels at 300 dpi, where 0.5 mm has 6. Two edges
that are displaced by the tolerance change its mean by half of the contrast."""
STREAK_WIDTH_MM: Final = 5.0
STREAK_RATIO: Final = 4.0
SPOT_MM: Final = 6.0
"""Diameter of the greatest spot of worlds.toml."""
WRONG_SHIFT_MM: Final = 1.8
"""worlds.toml: a page displaced so far is a misprint; two good prints are at most 1.6 mm apart."""
JOINING_PIXELS: Final = 8
"""Half of the distance within which differences are joined; tuned with the next on one half of
docs/results/detector/golden.md."""
LEAST_VOLUME: Final = 5.0
"""Minimum volume of a region that is reported. [contrast pixels]"""
AROUND: Final = 3
"""Side of the neighbourhood by which a pixel's difference is weighted. [pixels]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Golden:
    """A scan that was taken for good, or the mean of several."""

    name: str
    light: NDArray[np.float32]
    """(channels, lines, pixels) light, corrected for columns' offsets and gains if the press states them."""
    spread: NDArray[np.float32] | None = None
    """Standard deviation of each pixel of ``light`` over several scans, of which it is the mean, in its unit."""

    @classmethod
    def of(cls, scan: Scan, sensors: Sequence[SensorModel]) -> Self:
        """Return a scan of a press's camera as a golden one."""
        return cls(name=scan.name, light=evened(scan.dn.astype(np.float32), sensors))


class PictureDetector(ContextDetector):
    """Detector that compares each scan with one expected picture."""

    @property
    def zone_kinds(self) -> frozenset[Kind]:
        """See ``Detector``."""
        return ZONES

    def decided_again(self, stored: StoredArrays) -> Decision:
        """See ``Detector``."""
        volume = float(stored.array("volume", "f", (), finite=True))
        return decision_of(volume, another=stored.wrong_page)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoldenDetector(PictureDetector):
    """Detector with a good scan of each page, or one of all."""

    goldens: Mapping[str, Golden] = field(default_factory=dict)
    """Golden scans by the page's name; under the empty name: of every page that has none of its own."""
    name: str = NAME
    guarantee: str = GUARANTEE

    def prepare(self, planned: PlannedPage) -> GoldenSheet:
        """See ``Detector``; RequestError: there is no golden scan of this page."""
        left_mm = self.press_context.geometry.left_mm(planned.page.width_mm)
        return self.sheet(planned.page.name, left_mm=left_mm, zones=planned.zones)

    def sheet(self, page: str, *, left_mm: float, zones: PageZones | None = None) -> GoldenSheet:
        """Prepare a page of which nothing is known but its name and its left edge: a golden scan needs no raster.

        RequestError: there is no golden scan of this page.
        """
        geometry = self.press_context.geometry
        golden = self.goldens.get(page) or self.goldens.get("")
        if golden is None:
            remedy = "give one for all pages, or one for each, by `prooflight inspect --golden`"
            raise RequestError(page, "has no golden scan", remedy=remedy)
        lines, pixels = golden.light.shape[1:]
        x_mm = (np.arange(pixels) + 0.5) * geometry.pixel_pitch_mm - left_mm
        return GoldenSheet(
            page=page,
            golden=golden.name,
            light=golden.light,
            spread=golden.spread,
            ignored=None if zones is None else zones.holds("ignore", x_mm, geometry.centres_y_mm(lines)),
            pitch_mm=(geometry.pixel_pitch_mm, geometry.line_pitch_mm),
            left_mm=left_mm,
            lead_in_mm=geometry.lead_in_mm,
            sensors=self.press_context.sensors,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoldenSheet(PreparedOnly):
    """The golden scan of one page, and the position of its pixels on the page."""

    page: str
    golden: str
    """Name of the golden scan, for errors."""
    light: NDArray[np.float32]
    """(channels, lines, pixels) light, corrected for columns' offsets and gains if the press states them."""
    pitch_mm: tuple[float, float]
    """Pitch of pixels, across and along."""
    left_mm: float = 0.0
    """Distance from the scan's left end to the page's left edge."""
    lead_in_mm: float = 0.0
    """Distance from the scan's first line to the page's upper edge."""
    sensors: Sequence[SensorModel] = field(default=())
    """Sensors of the press whose raw numbers scans are; empty: scans are pictures, which need no
    correction."""
    spread: NDArray[np.float32] | None = None
    """Standard deviation of each pixel of ``light`` over several goldens, of which it is the mean, in its unit."""
    is_drawn: bool = False
    """Whether ``light`` is drawn from the page's file: strokes of a good print may then lack most of their ink."""
    ignored: NDArray[np.bool_] | None = None
    """(lines, pixels) places of the golden that are not judged."""
    edge_strip_mm: float = EDGE_STRIP_MM
    """Width of the strip along the edge of either sheet that is not judged."""

    def inspect(self, scan: Scan, *, seed: int = 0) -> Inspection:
        """See ``PreparedPage``; ScanError: the scan is not of the golden's kind.

        A scan with the golden's content but out of shape is not inspected: it differs by how it was scanned
        or placed, which is no property of any place on it.
        """
        measured = evened(scan.dn.astype(np.float32), self.sensors)
        expected, seen = _alike(scan.name, self.light, measured)
        for light, name in ((expected, self.golden), (seen, scan.name)):
            if not np.isfinite(light).all():
                why = f"{name} holds values that are not finite numbers"
                verdict, excess = Verdict.skipped(self.page, why, detector=NAME), np.zeros_like(expected[0])
                return self._inspection(verdict, scan, expected, excess)
        where, turned = self._place(expected, seen), False
        if not where.located:
            over = _alike(scan.name, self.light, measured[:, ::-1, ::-1])[1]
            other = self._place(expected, over)
            if turned := other.located:
                where, seen, scan = other, over, replace(scan, dn=scan.dn[:, ::-1, ::-1])
        lines, pixels = expected.shape[1:]
        difference = compare(
            expected,
            seen,
            tolerance=self._tolerance,
            where=where,
            spread=self._spread(len(expected), lines, pixels),
            ignored=None if self.ignored is None else self.ignored[:lines, :pixels],
            border=self._edge_strip(lines, pixels),
        )
        verdict = self._verdict(difference, turned=turned)
        return self._inspection(verdict, scan, expected, difference.excess)

    def residual_pixels(self, scan: Scan) -> float:
        """Return by how far the print lies off the place that the comparison follows, rms along an axis."""
        measured = evened(scan.dn.astype(np.float32), self.sensors)
        compared = self._without_ignored(*_alike(scan.name, self.light, measured))
        return residual_of(*compared, place_of(*compared))

    def _place(self, expected: NDArray[np.float32], seen: NDArray[np.float32]) -> GoldenPlace:
        """Return where ``seen`` shows the golden, by what is not ignored: a stamp has a place of its own."""
        return place_of(*self._without_ignored(expected, seen))

    def _without_ignored(
        self, expected: NDArray[np.float32], seen: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        if self.ignored is None:
            return expected, seen
        lines, pixels = expected.shape[1:]
        blank = np.median(expected[:, ::4, ::4], axis=(1, 2), keepdims=True)
        ignored = self.ignored[:lines, :pixels]
        return np.where(ignored, blank, expected), np.where(ignored, blank, seen)

    def _spread(self, channels: int, lines: int, pixels: int) -> NDArray[np.float32] | None:
        if self.spread is None:
            return None
        whole = self.spread if len(self.spread) == channels else self.spread.mean(axis=0, keepdims=True)
        return whole[:, :lines, :pixels]

    @property
    def _tolerance(self) -> Tolerance:
        fine_mm = min(self.pitch_mm)
        usual = Tolerance().edge_pixels
        length = max(round(STREAK_LENGTH_MM / fine_mm), STREAK_PIXELS)
        edge_pixels = usual if self.sensors else min(max(EDGE_OFF_MM / fine_mm, 1.0), usual)
        return Tolerance(
            edge_pixels=edge_pixels,
            streak=(STREAK_PIXELS, length, STREAK_LEAST),
            blot=2 * round(BLOT_EDGES * edge_pixels / 2) + 1,
            in_strokes=not self.is_drawn,
        )

    def _edge_strip(self, lines: int, pixels: int) -> NDArray[np.bool_] | None:
        """Return the strip along the sheet's edge, which is judged in neither scan; None: there is none."""
        sides_mm = pixels * self.pitch_mm[0] - 2 * self.left_mm, lines * self.pitch_mm[1] - self.lead_in_mm
        if self.edge_strip_mm <= 0 or self.edge_strip_mm > MOST_STRIP * min(sides_mm):
            return None
        strip = np.zeros((lines, pixels), np.bool_)
        across = round((self.left_mm + self.edge_strip_mm) / self.pitch_mm[0])
        above = round((self.lead_in_mm + self.edge_strip_mm) / self.pitch_mm[1])
        below = round(self.edge_strip_mm / self.pitch_mm[1])
        strip[:above] = strip[lines - below :] = True
        strip[:, :across] = strip[:, pixels - across :] = True
        return strip

    def _verdict(self, difference: GoldenDifference, *, turned: bool) -> Verdict:
        places, where = marks(difference), difference.place
        across, along = (
            round(shift * pitch, 4) for shift, pitch in zip(where.shift_pixels, self.pitch_mm, strict=True)
        )
        # A sheet that was fed by its other edge lies elsewhere in its scan, which says nothing of its print.
        off_place = not turned and max(abs(across), abs(along)) >= WRONG_SHIFT_MM
        if where.located and not off_place and not difference.fits:
            skipped = Verdict.skipped(self.page, self._misfit(difference), detector=NAME)
            return replace(skipped, shift_mm=(across, along))
        another = not where.located or off_place
        regions = tuple(self._region(mark) for mark in places[:MOST_REGIONS])
        kind = WRONG_PAGE_KIND if another else regions[0].kind if regions else None
        why = _reason(where.likeness, off_place=off_place, registered=where.located, places=len(places))
        return Verdict.from_decision(
            self.page,
            decision_of(places[0].volume if places else 0.0, another=another),
            kind=kind,
            regions=regions,
            shift_mm=(across, along) if where.located else None,
            detector=NAME,
            reason="; ".join(filter(None, (why, TURNED if turned else ""))),
        )

    def _misfit(self, difference: GoldenDifference) -> str:
        """Return why the scan cannot be compared: a description of its placement."""
        where = difference.place
        across, along = (
            shift * pitch for shift, pitch in zip(where.shift_pixels, self.pitch_mm, strict=True)
        )
        slopes = where.slopes
        turn_deg = np.degrees((slopes[1, 0] - slopes[0, 1]) / 2)
        return (
            f"the scan does not fit its golden: shifted by {across:.2f} x {along:.2f} mm, stretched by "
            f"{slopes[0, 0]:.1%} x {slopes[1, 1]:.1%}, turned by {turn_deg:.1f} degrees"
            + (", and bent" if where.bent else f"; still {difference.misfit:.0%} of it does not fit")
        )

    def _inspection(
        self, verdict: Verdict, scan: Scan, expected: NDArray[np.float32], excess: NDArray[np.float32]
    ) -> Inspection:
        lines, pixels = excess.shape
        area = (slice(0, lines), slice(0, pixels))
        golden = _uneven(expected, self.sensors)
        blocks = cv2.resize(
            excess,
            (max(pixels // BLOCK_PIXELS, 1), max(lines // BLOCK_PIXELS, 1)),
            interpolation=cv2.INTER_AREA,
        )
        return Inspection(
            verdict=verdict,
            placement=Placement(shift_mm=verdict.shift_mm or (0.0, 0.0)),
            area=area,
            measured_dn=scan.dn[:, *area],
            block_z=np.asarray(blocks / BLOCK_SD, np.float32)[None],
            expect=lambda: Prediction(expected_dn=golden, variance_dn2=np.ones_like(golden)),
            stored_arrays={
                "wrong_page": np.array(verdict.kind == WRONG_PAGE_KIND),
                "volume": np.array(verdict.score or 0.0),
            },
        )

    def _region(self, mark: Mark) -> Region:
        left, top, right, bottom = mark.grown(MARGIN_PIXELS)
        pitch_x_mm, pitch_y_mm = self.pitch_mm
        width_mm, height_mm = (right - left) * pitch_x_mm, (bottom - top) * pitch_y_mm
        box_mm = left * pitch_x_mm - self.left_mm, top * pitch_y_mm - self.lead_in_mm, width_mm, height_mm
        kind = _kind(width_mm, height_mm, lighter=mark.lighter)
        return Region.rounded(box_mm, score=mark.volume, kind=kind)


def decision_of(volume: float, *, another: bool) -> Decision:
    """Return the decision for the greatest region that differs; volume: 0 if there is none."""
    return Decision(
        misprint=another or volume > 0,
        score=round(volume, 1),
        threshold=LEAST_VOLUME,
        p_value=None,
        probability=None,
    )


def evened(light: NDArray[np.float32], sensors: Sequence[SensorModel]) -> NDArray[np.float32]:
    """Remove columns' offsets and gains from (sensors, lines, pixels), unless there are no sensors."""
    if not sensors:
        return light
    return np.stack(
        [(sheet - one.column_offset_dn) / one.column_gain for sheet, one in zip(light, sensors, strict=True)]
    )


def _uneven(light: NDArray[np.float32], sensors: Sequence[SensorModel]) -> NDArray[np.float32]:
    """Invert ``evened``: return numbers as the camera gives them."""
    if not sensors:
        return light
    return np.stack(
        [sheet * one.column_gain + one.column_offset_dn for sheet, one in zip(light, sensors, strict=True)]
    )


def _alike(
    name: str, golden: NDArray[np.float32], seen: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Crop both to their common part, grey if either is.

    ScanError: their sizes differ too much, or are too small.
    """
    if len(golden) != len(seen):
        golden, seen = (image.mean(axis=0, keepdims=True) for image in (golden, seen))
    sizes = np.array([golden.shape[1:], seen.shape[1:]])
    if sizes.min() < TILE_PIXELS:
        small = "its golden is" if sizes[0].min() < TILE_PIXELS else "is"
        lines, pixels = sizes[sizes.min(axis=1).argmin()]
        what = f"{small} of {lines} lines x {pixels} pixels"
        raise ScanError(
            name, what, remedy=f"{TILE_PIXELS} x {TILE_PIXELS} are the least that can be compared"
        )
    if (np.abs(sizes[1] / sizes[0] - 1) > CROPPED).any():
        what = f"is of {seen.shape[1]} lines x {seen.shape[2]} pixels"
        raise ScanError(name, what, remedy=f"its golden has {golden.shape[1]} x {golden.shape[2]}")
    lines, pixels = sizes.min(axis=0)
    return golden[:, :lines, :pixels], seen[:, :lines, :pixels]


def _kind(width_mm: float, height_mm: float, *, lighter: bool) -> str:
    """Name the kind of one region."""
    if width_mm <= STREAK_WIDTH_MM and height_mm > max(STREAK_RATIO * width_mm, SPOT_MM):
        return "streak"
    if max(width_mm, height_mm) <= SPOT_MM:
        return "spots-voids"
    return "missing-content" if lighter else "unknown"


def _reason(likeness: float, *, off_place: bool, registered: bool, places: int) -> str:
    if not registered:
        return f"the scan does not show the expected page: their edges agree to {max(likeness, 0):.0%}"
    if off_place:
        return f"the page is {WRONG_SHIFT_MM} mm or more off the position of the golden"
    if places:
        return f"{places} place{'s differ' if places > 1 else ' differs'} from the golden by more than good prints do"
    return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """One region where a scan differs from its golden; sides in pixels, the last ones exclusive."""

    left: int
    top: int
    right: int
    bottom: int
    volume: float
    """Sum of the difference, each pixel's weighted by the share of its 3 x 3 neighbourhood that differs as
    well: the edge strips that a tolerance leaves count little. A region of n pixels from dark to light has
    nearly n. [contrast pixels]"""
    lighter: bool
    """Whether the region is lighter than the golden."""

    def grown(self, margin: int) -> tuple[int, int, int, int]:
        """Return left, top, right and bottom with a margin all around. [pixels]"""
        return self.left - margin, self.top - margin, self.right + margin, self.bottom + margin


def marks(
    difference: GoldenDifference, *, joining_pixels: int = JOINING_PIXELS, least_volume: float = LEAST_VOLUME
) -> tuple[Mark, ...]:
    """Return regions that differ by at least ``least_volume``, the greatest first.

    Lighter differences are joined only with lighter ones, and darker with darker: missing content is not
    additional content.
    """
    result = []
    for lighter in (True, False):
        weight = np.where((difference.excess > 0) == lighter, difference.weight, np.float32(0))
        result += _of_sign(weight, lighter, joining_pixels, least_volume)
    return tuple(sorted(result, key=lambda mark: -mark.volume))


def _of_sign(
    weight: NDArray[np.float32], lighter: bool, joining_pixels: int, least_volume: float
) -> list[Mark]:
    counted = (weight > 0).astype(np.uint8)
    side = 2 * joining_pixels + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(cv2.dilate(counted, disc))
    dense = weight * cv2.blur(counted.astype(np.float32), (AROUND, AROUND), borderType=cv2.BORDER_REFLECT)
    volumes = np.bincount(labels.ravel(), dense.ravel(), count)
    result = []
    for label in range(1, count):
        if volumes[label] < least_volume:
            continue
        left, top, width, height = (int(value) for value in boxes[label, :4])
        inside = (slice(top, top + height), slice(left, left + width))
        own = (labels[inside] == label) & (counted[inside] > 0)
        right, down, columns, rows = cv2.boundingRect(own.astype(np.uint8))
        result.append(
            Mark(
                left=left + right,
                top=top + down,
                right=left + right + columns,
                bottom=top + down + rows,
                volume=float(volumes[label]),
                lighter=lighter,
            )
        )
    return result
