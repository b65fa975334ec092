"""Placing of a scanner's picture: where the page lies in it, and the picture at the press's pixels.

A feeder shifts, turns and stretches its sheets by far more than a press does, and may take them upside down. The page
is found by the coarse search and the landmarks of ``registration``, from wider priors. The scan is then drawn once at
the pixels of the press, so that all that follows sees an ordinary scan. That moves the scan where elsewhere the
prediction moves: a scanner has resampled and rounded its lines itself, so no noise of a sensor is left to be spoilt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.registration.coarse import peaks, refined
from prooflight.registration.landmarks import Landmarks, prepare
from prooflight.registration.pose import Pose
from prooflight.registration.register import Prior, register

if TYPE_CHECKING:
    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.scanner.feeder import FeederPrior
    from prooflight.scans.scanner.reading import ScannedPicture

REACH_MM: Final = 12.5
"""Distance within which the page is searched around the middle of its scan."""
COARSE_FITS: Final = 4
"""Number of coarse fits, each from the last one's pose: a feeder stretches more than one of them allows for."""
FITS: Final = 3
"""Greatest number of registrations; each starts from where the last one has drawn the page."""
LEAST_AGREEMENT: Final = 0.6
"""Correlation of scan and page below which the page has not been found; pages of real scans have 0.67 to 0.89."""
SURE_AGREEMENT: Final = 0.85
"""Correlation at which it has been, although it repeats itself."""
LEAST_LIKENESS: Final = 0.2
"""Likeness of edges below which the scan shows nothing of a page; good prints have 0.4 to 0.9."""
NOTHING_SHOWN: Final = "the scan shows nothing of this page"
LEAST_SEEN: Final = 0.8
"""Least share of the page that must lie within its scan."""
PARTS: Final = 3
"""Parts of a page either way, each of which must agree."""
LEAST_PART: Final = 0.4
"""Correlation of scan and page in a part of it below which that part does not lie there."""
LEAST_PRINT: Final = 1000
"""Pixels near print from which on a part of the page tells where it lies: a few words."""
EDGE_MM: Final = 3.0
"""Strip along the edges of sheet and scan that is not judged: a device shows the sheet's shadow there. assumed, the
margin that office printers cannot print on."""
PRINTED: Final = 0.9
"""Expected light below which a pixel counts as printed. [paper]"""
NEAR_PIXELS: Final = 9
"""Side of the squares about printed pixels within which scan and page are compared."""
WHITE_PERCENTILE: Final = 95.0
"""Percentile of a scan's light that is taken for paper until its tone is fitted."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedPage:
    """Page of the job with what its place in a scan is found by."""

    page: Page
    due: NDArray[np.float32]
    """Light that is expected of the page in its place, (sensors, lines, pixels). [paper]"""
    near_print: NDArray[np.bool_]
    """Whether print is expected near by, (lines, pixels)."""
    landmarks: Landmarks
    feeder: FeederPrior

    @classmethod
    def of(cls, page: Page, expected: Prediction, press: Press, feeder: FeederPrior) -> ExpectedPage:
        """Return a page as it enters the press with its landmarks."""
        prior = replace(Prior(), turn_deg=feeder.skew_deg, stretch_percent=feeder.stretch_percent)
        landmarks = prepare(page, expected, sensors=press.sensors, geometry=press.geometry, prior=prior)
        due = expected_light(expected, press.sensors)
        printed = (due.min(axis=0) < PRINTED).astype(np.uint8)
        near = cv2.dilate(printed, np.ones((NEAR_PIXELS, NEAR_PIXELS), np.uint8)) > 0
        return cls(page=page, due=due, near_print=near, landmarks=landmarks, feeder=feeder)

    def fed_by(self, feeder: FeederPrior) -> ExpectedPage:
        """Return the page as another feeder lays it, that of the sheet's other side; cheap."""
        if feeder is self.feeder:
            return self
        basis = self.landmarks.basis.loosened(
            turn_deg=feeder.skew_deg, stretch_percent=feeder.stretch_percent
        )
        return replace(self, landmarks=replace(self.landmarks, basis=basis), feeder=feeder)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Whereabouts:
    """Place of a page in a scan: a map of the page to the scan, both in mm from their centres."""

    likeness: float
    """Likeness of the edges of page and scan at the best place of the coarse search; 1: they are the same."""
    turned: bool
    """Whether the scan has to be turned by 180 degrees."""
    matrix: NDArray[np.float64]
    """Affine map of homogeneous coordinates, (3, 3), after that turn."""

    @property
    def shift_mm(self) -> tuple[float, float]:
        """Return the displacement of the page's centre from the scan's, to the right and down."""
        return float(self.matrix[0, 2]), float(self.matrix[1, 2])

    @property
    def skew_deg(self) -> float:
        """Return the turn of the page, clockwise as seen."""
        return float(np.rad2deg(np.arctan2(self.matrix[1, 0], self.matrix[0, 0])))

    @property
    def stretch_percent(self) -> tuple[float, float]:
        """Return the elongation of the page across and along."""
        across, along = (float(np.hypot(*self.matrix[:2, axis])) for axis in range(2))
        return 100 * (across - 1), 100 * (along - 1)


NOWHERE: Final = Whereabouts(likeness=0.0, turned=False, matrix=np.eye(3))
"""Place of a page in a scan that could not be read."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnScan:
    """A scanner's picture at the press's pixels, (sensors, lines, pixels)."""

    light: NDArray[np.float32]
    """Light of the page in its nominal place, 0 to 1 of the file's white point."""
    clipped: NDArray[np.float32]
    """Share of each pixel's samples that are clipped in the file. [-]"""
    seen: NDArray[np.bool_]
    """Whether a pixel lies on the page and within the scan, (lines, pixels)."""


def expected_light(expected: Prediction, sensors: Sequence[SensorModel]) -> NDArray[np.float32]:
    """Return the light that is expected of a page, of bare columns, (sensors, lines, pixels) [paper]."""
    return np.stack(
        [
            (lines - sensor.column_offset_dn) / (sensor.column_gain * np.float32(sensor.white_dn))
            for lines, sensor in zip(expected.expected_dn, sensors, strict=True)
        ]
    ).astype(np.float32, copy=False)


def channels_of(picture: ScannedPicture, sensors: int) -> ScannedPicture:
    """Return the picture with one channel for each of the press's sensors: of RGB, green where the press sees grey."""
    if len(picture.light) == sensors:
        return picture
    if sensors == 1:
        # sRGB's green carries 72 % of its luminance, and is what a grey scanner of our preset sees.
        return replace(picture, light=picture.light[1:2], clipped=picture.clipped[1:2])
    one = np.zeros(sensors, np.intp)
    return replace(picture, light=picture.light[one], clipped=picture.clipped[one])


def seen_coarsely(picture: ScannedPicture, expected: ExpectedPage) -> NDArray[np.float32]:
    """Return the coarse picture of a scan, its centre on that of the page, as a share of its paper's light."""
    grey = np.ascontiguousarray(picture.light.mean(axis=0))
    coarse = expected.landmarks.coarse
    sizes = [
        max(1, round(extent * MM_PER_INCH / dpi / pitch))
        for extent, dpi, pitch in zip(grey.shape[::-1], picture.dpi, coarse.pitch_mm, strict=True)
    ]
    small = cv2.resize(grey, (sizes[0], sizes[1]), interpolation=cv2.INTER_AREA)
    small /= max(float(np.percentile(small, WHITE_PERCENTILE)), 1e-3)
    rows, columns = coarse.picture.shape
    # The coarse pixels of page and scan need not have one centre: the search is for more than half a pixel.
    matrix = np.array([[1.0, 0, (columns - sizes[0]) / 2], [0, 1.0, (rows - sizes[1]) / 2]])
    return np.asarray(
        cv2.warpAffine(small, matrix, (columns, rows), flags=cv2.INTER_LINEAR, borderValue=1.0), np.float32
    )


def most_likely(coarse: NDArray[np.float32], expected: ExpectedPage) -> Whereabouts:
    """Return the place of the best match of edges, upright or upside down, in a coarse picture of a scan."""
    candidates = []
    for turned in (False, True):
        seen = np.ascontiguousarray(coarse[::-1, ::-1]) if turned else coarse
        height, pose = peaks(expected.landmarks.coarse, seen, reach_mm=REACH_MM, turn=0.0, most=1)[0]
        candidates.append(Whereabouts(likeness=height, turned=turned, matrix=_matrix(pose)))
    return max(candidates, key=lambda one: one.likeness)


def placed(
    picture: ScannedPicture, expected: ExpectedPage, start: Whereabouts, press: Press
) -> tuple[Whereabouts, str]:
    """Return where the page lies in its scan, from the coarse place, and why it could not be placed; else empty."""
    if start.likeness < LEAST_LIKENESS:
        return start, NOTHING_SHOWN
    coarse = seen_coarsely(picture, expected)
    coarse = np.ascontiguousarray(coarse[::-1, ::-1]) if start.turned else coarse
    where = replace(start, matrix=_matrix(_coarse_pose(coarse, expected, start)))
    drawn = drawn_scan(picture, expected.page, where, press)
    agreement, reason = agreement_of(drawn, expected), ""
    for _ in range(FITS):
        registration = register(expected.landmarks, _roughly(drawn, press))
        reason = registration.reason
        if not registration.tiles_used:
            break
        x_mm, y_mm = registration.placement.shift_mm
        across, along = (percent / 100 for percent in registration.placement.stretch_percent)
        turn = float(np.deg2rad(registration.placement.skew_deg))
        further = _matrix(Pose(x_mm=x_mm, y_mm=y_mm, turn=turn, across=across, along=along))
        moved = replace(where, matrix=where.matrix @ further)
        again = drawn_scan(picture, expected.page, moved, press)
        better = agreement_of(again, expected)
        if better < agreement:
            break
        where, drawn, agreement = moved, again, better
    if least_agreement_of_parts(drawn, expected) < LEAST_PART:
        return where, "parts of the page are at other positions than the rest"
    if agreement >= SURE_AGREEMENT:  # what repeats within the page lies nowhere else within a feeder's reach
        return where, ""
    if agreement < LEAST_AGREEMENT:
        return where, reason or f"what is printed there agrees with the page to {agreement:.0%} only"
    return where, reason


def agreement_of(drawn: DrawnScan, expected: ExpectedPage) -> float:
    """Return the correlation of a drawn scan with its page, near the print that is expected; 1: they are the same.

    A stamp elsewhere says nothing of the page's place.
    """
    return _correlation(drawn.light, expected.due, drawn.seen & expected.near_print)


def least_agreement_of_parts(drawn: DrawnScan, expected: ExpectedPage) -> float:
    """Return the least agreement of the parts of the page that have print: one that lies elsewhere has none."""
    due, near = expected.due, drawn.seen & expected.near_print
    least = 1.0
    for rows in np.array_split(np.arange(near.shape[0]), PARTS):
        for columns in np.array_split(np.arange(near.shape[1]), PARTS):
            part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
            if near[part].sum() >= LEAST_PRINT:
                least = min(least, _correlation(drawn.light[:, *part], due[:, *part], near[part]))
    return least


def _correlation(light: NDArray[np.float32], due: NDArray[np.float32], near: NDArray[np.bool_]) -> float:
    """Return the correlation of two arrays (sensors, lines, pixels) where ``near`` (lines, pixels) is set. [-]"""
    if not near.any():
        return 0.0
    seen, expectation = (part[:, near].ravel().astype(np.float64) for part in (light, due))
    spread = float(seen.std() * expectation.std())
    covariance = np.mean((seen - seen.mean()) * (expectation - expectation.mean()))
    return float(covariance) / spread if spread else 0.0


def _coarse_pose(coarse: NDArray[np.float32], expected: ExpectedPage, start: Whereabouts) -> Pose:
    """Return the pose of the best of several coarse fits: a feeder turns and stretches by more than one allows for."""
    page, feeder = expected.landmarks.coarse, expected.feeder
    if not page.points.size:
        return Pose(x_mm=start.shift_mm[0], y_mm=start.shift_mm[1])
    due = page.picture.ravel()[page.points]

    def error(pose: Pose) -> float:
        x, y = (
            (at + move - first) / pitch
            for at, move, first, pitch in zip(
                page.points_mm,
                pose.displacement_mm(*page.points_mm),
                page.first_mm,
                page.pitch_mm,
                strict=True,
            )
        )
        maps = x.astype(np.float32)[None], y.astype(np.float32)[None]
        seen = cv2.remap(coarse, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
        return float(np.abs(seen - due).mean())

    fits: list[tuple[float, int, Pose]] = []
    rows, columns = coarse.shape
    for turn_deg, along_percent in product((0, -feeder.skew_deg, feeder.skew_deg), (0, -1, 1)):
        pose = Pose(turn=float(np.deg2rad(turn_deg)), along=along_percent * feeder.stretch_percent / 100)
        linear = _matrix(pose)[:2, :2]
        centre = np.array([(columns - 1) / 2, (rows - 1) / 2])
        back = np.column_stack([linear, centre - linear @ centre])
        # As it would lie without this turn and stretch: a sparse page then matches at both of its ends.
        upright = cv2.warpAffine(
            coarse,
            back,
            (columns, rows),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        _, shift = peaks(page, np.asarray(upright, np.float32), reach_mm=REACH_MM, turn=0.0, most=1)[0]
        pose = replace(pose, x_mm=shift.x_mm, y_mm=shift.y_mm)
        for _ in range(COARSE_FITS):
            pose = refined(page, coarse, pose)
        fits.append((error(pose), len(fits), pose))
    return min(fits)[2]


def drawn_scan(picture: ScannedPicture, page: Page, where: Whereabouts, press: Press) -> DrawnScan:
    """Return the picture at the press's pixels, with the page in its nominal place."""
    geometry = press.geometry
    lines, pixels = geometry.lines(page.height_mm), geometry.pixels
    pitch_mm = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    scan_mm = [MM_PER_INCH / dpi for dpi in picture.dpi]
    # Drawn as finely as the scan is, then averaged over whole pixels of the press, as its camera does.
    finer = [max(1, round(pitch / own)) for pitch, own in zip(pitch_mm, scan_mm, strict=True)]
    first = geometry.centres_x_mm(page.width_mm)[0], geometry.centres_y_mm(1)[0]
    to_page = np.eye(3)
    for axis, (pitch, times, size) in enumerate(
        zip(pitch_mm, finer, (page.width_mm, page.height_mm), strict=True)
    ):
        to_page[axis, axis] = pitch / times
        to_page[axis, 2] = first[axis] - pitch / 2 + pitch / times / 2 - size / 2
    high, wide = picture.light.shape[1:]
    to_scan = np.diag([1 / scan_mm[0], 1 / scan_mm[1], 1.0])
    to_scan[:2, 2] = (wide - 1) / 2, (high - 1) / 2
    turn = np.diag([-1.0, -1.0, 1.0]) if where.turned else np.eye(3)
    matrix = (to_scan @ turn @ where.matrix @ to_page)[:2]
    fine = pixels * finer[0], lines * finer[1]

    def drawn(samples: NDArray[np.float32], beyond: float) -> NDArray[np.float32]:
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        moved = cv2.warpAffine(samples, matrix, fine, flags=how, borderValue=beyond)
        return np.asarray(cv2.resize(moved, (pixels, lines), interpolation=cv2.INTER_AREA), np.float32)

    within = drawn(np.ones((high, wide), np.float32), 0.0) > 0.999
    x_mm, y_mm = geometry.centres_x_mm(page.width_mm), geometry.centres_y_mm(lines)
    on_page = np.outer((y_mm > 0) & (y_mm < page.height_mm), (x_mm > 0) & (x_mm < page.width_mm))
    return DrawnScan(
        light=np.stack([drawn(channel, 1.0) for channel in picture.light]),
        clipped=np.stack([drawn(channel.astype(np.float32), 1.0) for channel in picture.clipped]),
        seen=_without_edge(within & on_page, geometry),
    )


def _without_edge(seen: NDArray[np.bool_], geometry: ScanGeometry) -> NDArray[np.bool_]:
    """Return what is seen (lines, pixels) but for ``EDGE_MM`` along its edges."""
    across, along = (
        2 * round(EDGE_MM / pitch) + 1 for pitch in (geometry.pixel_pitch_mm, geometry.line_pitch_mm)
    )
    rectangle = np.ones((along, across), np.uint8)
    how = {"borderType": cv2.BORDER_CONSTANT, "borderValue": 0}
    return np.asarray(cv2.erode(seen.astype(np.uint8), rectangle, **how) > 0)


def _roughly(drawn: DrawnScan, press: Press) -> NDArray[np.uint16]:
    """Return a drawn scan in the press's numbers [DN], its tone unfitted, which is enough to place it."""
    dn = np.empty(drawn.light.shape, np.uint16)
    for light, sensor, out in zip(drawn.light, press.sensors, dn, strict=True):
        white = max(float(np.percentile(light, WHITE_PERCENTILE)), 1e-3)
        bare = np.minimum(light / white, 1.2) * sensor.white_dn
        out[:] = np.clip(sensor.column_offset_dn + sensor.column_gain * bare, 0, sensor.top_code_dn)
    return dn


def _matrix(pose: Pose) -> NDArray[np.float64]:
    """Return a pose as an affine map of homogeneous coordinates, (3, 3)."""
    cosine, sine = np.cos(pose.turn), np.sin(pose.turn)
    matrix = np.eye(3)
    matrix[:2, :2] = np.array([[cosine, -sine], [sine, cosine]]) * (1 + pose.across, 1 + pose.along)
    matrix[:2, 2] = pose.x_mm, pose.y_mm
    return matrix
