"""Detection limits of marks: the smallest spot and the narrowest hair that alarm, computed before printing.

The chain from a small window's deviation T to an alarm is inverted: from the press's threshold to the
evidence of one family of marks that exceeds it alone, and from that to a deviation, a statistic and a T for
each class of place and each window. The page's expected light and the variance of its residuals give the
cover of a window that a mark needs to have that T, and the camera's footprint gives its size for that. Where
the floor applies, a mark that reaches it alarms as well. Forests and other families are left out: they can
only add to it.

A mark of the stated size has the T of the limit on average, so that noise decides on it; a good page is taken
to scatter as it is predicted to. A page that is badly placed widens its limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.matched_filter.fit.binning import binned_geometry, binned_sensor, bins_of
from prooflight.detectors.matched_filter.fit.modes import Modes, pixel_map, prepare_modes
from prooflight.detectors.matched_filter.fit.special_places import with_hidden_edges
from prooflight.detectors.matched_filter.ranking import alarming_evidence, deviation_at, marks_of
from prooflight.detectors.matched_filter.statistics.marks import (
    FLOOR_SIGMAS,
    NAMES,
    PLACE_CLASSES,
    REFERENCE_T,
    Places,
    classify,
    least_pixels,
    speck_shares,
    usual_t,
)
from prooflight.detectors.visible_marks import VisibleMarks
from prooflight.kernels.residuals.residuals import VarianceShares, variances
from prooflight.kernels.statistics.marks import CLASSES, LEAST_T, NOT_INSPECTED, SIZES, WINDOWS
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.prediction.predict import predict
from prooflight.prediction.tables import SensorModel, node_fractions
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from prooflight.detectors.base import PressContext
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.scans.geometry import ScanGeometry

SPOT_BLACK: Final = 0.9
"""Ink of the spot. [-]"""
HAIR_BLACK: Final = 0.7
HAIR_MM: Final = 6.0
"""Length of the hair, whose width is the result. [mm]"""
SPOTS_MM: Final = np.geomspace(0.05, 4.0, 64)
"""Diameters that are tried; a spot that needs a larger one does not alarm."""
HAIRS_MM: Final = np.geomspace(0.005, 2.0, 64)
SLICES: Final = 32
"""Number of rectangles that approximate a disc."""
PHASES: Final = (0.125, 0.375)
"""Distances of a mark's middle from a pixel's, in each direction; the others mirror them. [pixels]"""
DARKER: Final = "+-".index("-")
A4_MM2: Final = 210.0 * 297.0
SAMPLE_MM: Final = 18.0
"""Side of the page that represents a large area of one tint."""


class Mark(NamedTuple):
    """Signal of marks of increasing sizes, averaged over their positions relative to the pixels."""

    sizes_mm: NDArray[np.float64]
    """(n,)"""
    sums: NDArray[np.float64]
    """(n, SIZES) greatest sum of a mark's cover over windows of each size. [pixels]"""
    floor: NDArray[np.float64]
    """(n,) cover that is exceeded by as many pixels as the floor requires. [-]"""
    light: NDArray[np.float64]
    """(sensors,) light of what the mark covers, as a share of paper's; a mark never lightens anything. [-]"""

    @classmethod
    def spot(cls, sensors: Sequence[SensorModel], geometry: ScanGeometry) -> Self:
        """Return discs of ``SPOT_BLACK``; the sizes are diameters. sensors, geometry: of binned pixels."""
        edges = np.linspace(-0.5, 0.5, SLICES + 1)
        half = np.sqrt(0.25 - ((edges[1:] + edges[:-1]) / 2) ** 2)
        slices = [np.column_stack([edges[:-1], edges[1:], half]) * size for size in SPOTS_MM]
        return cls._seen(SPOTS_MM, slices, SPOT_BLACK, sensors, geometry)

    @classmethod
    def hair(cls, sensors: Sequence[SensorModel], geometry: ScanGeometry) -> Self:
        """Return lines of ``HAIR_BLACK``, ``HAIR_MM`` long, along the travel; the sizes are widths."""
        slices = [np.array([[-HAIR_MM / 2, HAIR_MM / 2, size / 2]]) for size in HAIRS_MM]
        return cls._seen(HAIRS_MM, slices, HAIR_BLACK, sensors, geometry)

    @classmethod
    def _seen(
        cls,
        sizes_mm: NDArray[np.float64],
        slices: Sequence[NDArray[np.float64]],
        black: float,
        sensors: Sequence[SensorModel],
        geometry: ScanGeometry,
    ) -> Self:
        """Compute the signal of marks.

        slices: for each size, (rectangles, 3) top, bottom and half width [mm].
        """
        sums, floor = np.zeros((len(sizes_mm), SIZES)), np.zeros(len(sizes_mm))
        least = least_pixels(geometry.pixel_pitch_mm)
        phases = [(across, along) for across in PHASES for along in PHASES]
        for at, rectangles in enumerate(slices):
            for phase in phases:
                cover = _cover(rectangles, sensors, geometry, phase)
                for size, side in enumerate(WINDOWS):
                    sums[at, size] += _box_sums(cover, side).max() / len(phases)
                floor[at] += np.partition(cover.ravel(), -least)[-least] / len(phases)
        nodes = [one.mean_dn[(0,) * INK_LETTERS.index("K")] for one in sensors]
        light = [np.interp(black, node_fractions(), one) / one[0] for one in nodes]
        return cls(sizes_mm, np.maximum.accumulate(sums), np.maximum.accumulate(floor), np.array(light))


def _cover(
    rectangles: NDArray[np.float64],
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    phase: tuple[float, float],
) -> NDArray[np.float64]:
    """Return the share of each pixel's light from rectangles, (lines, pixels), averaged over sensors."""
    top, bottom, half = rectangles.T
    reach = max(one.footprint.reach_mm for one in sensors)
    seen = []
    for sensor in sensors:
        parts = []
        for of, pitch, off, begin, end in (
            (sensor.footprint.along, geometry.line_pitch_mm, phase[1], top, bottom),
            (sensor.footprint.across, geometry.pixel_pitch_mm, phase[0], -half, half),
        ):
            count = int(np.ceil((np.abs([begin, end]).max() + reach) / pitch)) + WINDOWS[-1]
            middles = (np.arange(-count, count + 1) + off)[:, None] * pitch
            offsets = np.linspace(-sensor.footprint.reach_mm, sensor.footprint.reach_mm, of.size)
            parts.append(np.interp(end - middles, offsets, of) - np.interp(begin - middles, offsets, of))
        seen.append(parts[0] @ parts[1].T)
    return np.asarray(np.mean(seen, axis=0))


def _box_sums(image: NDArray[np.floating], side: int) -> NDArray[np.float64]:
    """Return sums over windows, at the pixel that ``note_row`` takes as their middle; 0 outside the image.

    image: (lines, pixels), not negative, so that negative sums are rounding errors.
    """
    middle = side // 2, side // 2
    sums = cv2.boxFilter(
        image, cv2.CV_64F, (side, side), normalize=False, anchor=middle, borderType=cv2.BORDER_CONSTANT
    )
    return np.maximum(sums, 0)


def limits(
    model: DetectorModel,
    threshold: float,
    page_features: NDArray[np.floating],
    windows: NDArray[np.integer] | NDArray[np.floating],
) -> NDArray[np.float64]:
    """Return the T from which a page alarms by one window alone, (classes, sizes, 2): lighter and darker.

    Parameters
    ----------
    model : of the press.
    threshold : of its score.
    page_features : (PAGE_FEATURES,) of the page.
    windows : (classes, sizes) number of places of each class on the page, times channels.
    """
    deciding = model.screen or model
    marks = int(marks_of(deciding.families).sum())
    # Without forests trained on misprints, the strongest family's evidence is the score.
    alone = model.screen is None and model.forest is None
    evidence = threshold if alone else alarming_evidence(threshold, max(marks, 1))
    of_families = deviation_at(evidence, deciding.quantiles, deciding.tail, deciding.tail_from)
    deviations = np.full(len(model.statistics), np.inf)
    which = np.arange(len(model.statistics)) if model.screen is None else model.screen.statistic
    deviations[which] = of_families[deciding.family]
    with np.errstate(over="ignore", invalid="ignore"):
        values = model.values_at(deviations, page_features)
    result = np.full((CLASSES, SIZES, 2), np.inf)
    usual = usual_t(np.asarray(windows / np.square(WINDOWS)))
    for one, value in zip(model.statistics, values, strict=True):
        if one.family == "mark":
            c, s = PLACE_CLASSES.index(one.mode), WINDOWS.index(one.size or 0)
            result[c, s, "+-".index(one.sign)] = value - REFERENCE_T + usual[c, s]
    return np.maximum(result, LEAST_T)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedPage:
    """Expected light of a page's binned pixels, before it is printed."""

    light: NDArray[np.float32]
    """(sensors, lines, pixels) [DN]"""
    weight: NDArray[np.float32]
    """(sensors, lines, pixels) inverse variance of residuals. [1/DN^2]"""
    white: NDArray[np.float32]
    """(sensors, pixels) light of bare paper. [DN]"""
    places: Places

    @classmethod
    def of(
        cls,
        page: Page,
        modes: Modes,
        inside: NDArray[np.bool_],
        *,
        sensors: Sequence[SensorModel],
        geometry: ScanGeometry,
        residual_variance: ResidualVariance,
        unresolved: NDArray[np.float32] | None = None,
        hidden: NDArray[np.float32] | None = None,
        edges_in_border: bool = False,
        threads: int = 1,
    ) -> Self:
        """Predict a page in its nominal place, in binned pixels.

        modes: of the page; inside: its inspected part; sensors, geometry: of binned pixels; unresolved, hidden:
        as in ``PreparedPage``; edges_in_border: as in ``classify``.
        """
        seen = predict(page, sensors=sensors, geometry=geometry, threads=threads)
        offset = np.stack([one.column_offset_dn for one in sensors])
        light = np.asarray(seen.expected_dn - offset[:, None], np.float32)
        weight, of_edges = np.empty_like(light), np.empty(light.shape[1:], np.float32)
        variance = residual_variance.with_edges_off(page.edge_sd_mm / geometry.pixel_pitch_mm)
        texture = with_hidden_edges(modes.texture, hidden, variance)
        for index, sensor in enumerate(sensors):
            amounts = 1.0, variance.edge, variance.contrast, variance.share, variance.dark, sensor.white_dn
            variances(
                light[index],
                seen.variance_dn2[index],
                texture[index],
                inside,
                VarianceShares._make(map(np.float32, amounts)),
                0,
                len(inside),
                weight[index],
                of_edges,
            )
        white = np.stack([one.white_dn * one.column_gain for one in sensors]).astype(np.float32)
        places = classify(
            light,
            white,
            inside,
            pixel_mm=geometry.pixel_pitch_mm,
            unresolved=None if unresolved is None else unresolved > 0,
            hidden=hidden,
            edges_in_border=edges_in_border,
            threads=threads,
        )
        return cls(light=light, weight=weight, white=white, places=places)

    @property
    def windows(self) -> NDArray[np.int64]:
        """(classes, sizes) number of windows of each class that are analysed, over all channels."""
        sensors = len(self.light)
        return self.places.areas * (sensors + (sensors > 1))


def least_sizes(
    expected: ExpectedPage,
    mark: Mark,
    limiting_t: NDArray[np.float64],
    *,
    tolerance: float,
    specks: NDArray[np.float32],
    floor_share: float,
) -> NDArray[np.float32]:
    """Return the size of the smallest mark that alarms with its middle at each place, (lines, pixels) [mm].

    It is infinite where no size that is tried alarms, and NaN where the page is not inspected.

    Parameters
    ----------
    expected : the page.
    mark : the mark, which darkens.
    limiting_t : (classes, sizes, 2) as returned by ``limits``.
    tolerance, specks, floor_share : as in ``measure_marks``.
    """
    light = expected.light.astype(np.float64)
    taken = np.maximum(light - mark.light[:, None, None] * expected.white[:, None], 0)
    power, effect = light**2 * expected.weight, light * taken * expected.weight
    least = np.full(light.shape[1:], np.inf)
    sensors = len(light)
    with np.errstate(divide="ignore", invalid="ignore"):
        for size, side in enumerate(WINDOWS):
            required = np.append(limiting_t[:, size, DARKER], np.inf)[
                np.minimum(expected.places.of_windows[size], CLASSES)
            ]
            sums = np.stack([_box_sums(one, side) for one in power])
            pushes = np.stack([_box_sums(one, side) for one in effect]) / side**2
            channels = list(zip(pushes, sums, strict=True))
            if sensors > 1:
                channels.append((pushes.sum(axis=0), sums.sum(axis=0)))
            for push, information in channels:
                scatter = np.sqrt(information + (tolerance * information) ** 2)
                cover = (required * scatter + specks[size] * information) / push
                if side > 1:  # of the windows that hold the mark, the one that it darkens most decides
                    cover = cv2.erode(np.nan_to_num(cover, nan=np.inf), np.ones((3, 3)))
                np.minimum(least, _size_of(cover, mark.sums[:, size], mark.sizes_mm), out=least)
        if floor_share:
            noise = FLOOR_SIGMAS / np.sqrt(expected.weight)
            cover = (np.maximum(max(floor_share, specks[0]) * expected.white[:, None], noise) / taken).min(
                axis=0
            )
            applies = cv2.erode(expected.places.flat, np.ones((3, 3), np.uint8), borderValue=0) > 0
            of_floor = _size_of(cover, mark.floor, mark.sizes_mm)
            np.minimum(least, np.where(applies, of_floor, np.inf), out=least)
    least[expected.places.of_windows[0] == NOT_INSPECTED] = np.nan
    return least.astype(np.float32)


def _size_of(
    cover: NDArray[np.float64], covers: NDArray[np.float64], sizes_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate the smallest size with a cover in a rising table; infinite if there is none."""
    return np.interp(np.nan_to_num(cover, nan=np.inf), covers, sizes_mm, right=np.inf)


def visible_marks(
    design: PreparedPage, model: DetectorModel, threshold: float, press_context: PressContext
) -> VisibleMarks:
    """Compute the limits of a page that is prepared for its scans, judged by this model at this threshold."""
    sensors, geometry = design.binned_sensors, design.binned_geometry
    inside = pixel_map(design.page, geometry, IN_PLACE).inside
    if design.zones is not None:
        inside &= design.zones.images[0] < 0.5
    expected = ExpectedPage.of(
        design.page,
        Modes(images=design.images.values, sensors=len(sensors)),
        inside,
        sensors=sensors,
        geometry=geometry,
        residual_variance=model.residual_variance,
        unresolved=design.unresolved,
        hidden=design.hidden,
        edges_in_border=design.own_light is not None,
        threads=press_context.threads or 1,
    )
    limiting_t = limits(model, threshold, design.page_features, expected.windows)
    spot, hair = _spot_and_hair(expected, limiting_t, model, sensors, geometry, press_context.floor_share)
    return VisibleMarks(
        spot_mm=spot,
        hair_mm=hair,
        place=expected.places.of_windows[0],
        classes=tuple(NAMES[name] for name in PLACE_CLASSES),
        left_mm=-geometry.left_mm(design.page.width_mm),
        top_mm=-geometry.lead_in_mm,
        pixel_mm=geometry.pixel_pitch_mm,
        line_mm=geometry.line_pitch_mm,
        page_mm=(design.page.width_mm, design.page.height_mm),
    )


def _spot_and_hair(
    expected: ExpectedPage,
    limiting_t: NDArray[np.float64],
    model: DetectorModel,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    floor_share: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return ``least_sizes`` of both marks."""
    specks = speck_shares(model.prior, sensors, geometry.pixel_pitch_mm)
    tolerance = model.prior.place
    spot, hair = (
        least_sizes(expected, mark, limiting_t, tolerance=tolerance, specks=specks, floor_share=floor_share)
        for mark in (Mark.spot(sensors, geometry), Mark.hair(sensors, geometry))
    )
    return spot, hair


def on_tint(detector: CalibratedDetector, press_context: PressContext, black: float) -> tuple[float, float]:
    """Return the smallest spot and the narrowest hair that alarm on an A4 page of one tint. [mm]

    They are computed from the press's tables alone, for a page with the mean features of the training pages.
    black: its ink [-].
    """
    bins = bins_of(press_context.geometry)
    geometry = binned_geometry(press_context.geometry, bins)
    pitch_mm = press_context.geometry.pixel_pitch_mm, press_context.geometry.line_pitch_mm
    sensors = tuple(binned_sensor(one, bins, pitch_mm) for one in press_context.sensors)
    pixel_mm, model = geometry.pixel_pitch_mm, detector.model
    extent = round(min(SAMPLE_MM, press_context.geometry.field_mm) / pixel_mm)
    cmyk = np.zeros((extent, extent, 4), np.uint8)
    cmyk[..., INK_LETTERS.index("K")] = round(255 * black)
    page = Page(cmyk=cmyk, dpi=MM_PER_INCH / pixel_mm, name="tint", number=1)
    expected = ExpectedPage.of(
        page,
        prepare_modes(page, sensors=sensors, geometry=geometry),
        pixel_map(page, geometry, IN_PLACE).inside,
        sensors=sensors,
        geometry=geometry,
        residual_variance=model.residual_variance,
    )
    channels = len(sensors) + (len(sensors) > 1)
    windows = np.full((CLASSES, SIZES), channels * A4_MM2 / (pixel_mm * geometry.line_pitch_mm))
    limiting_t = limits(model, detector.threshold, model.centre[0], windows)
    spot, hair = _spot_and_hair(expected, limiting_t, model, sensors, geometry, press_context.floor_share)
    x_mm, y_mm = geometry.centres_x_mm(page.width_mm), geometry.centres_y_mm(len(spot))
    line, pixel = np.abs(y_mm - page.height_mm / 2).argmin(), np.abs(x_mm - page.width_mm / 2).argmin()
    return float(spot[line, pixel]), float(hair[line, pixel])
