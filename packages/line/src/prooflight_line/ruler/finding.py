"""Detection of a ruler page in a scan: its coded markers give the approximate map from page to scan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.errors import ScanError
from prooflight.inks.ruler_layout import (
    CELL_MM,
    DICTIONARY,
    GROUP_MM,
    MARGIN_MM,
    MARKER_MM,
    MOST_CELLS,
    SLOTS,
    TOOTH_MM,
    RulerLayout,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

SEARCH_PIXELS: Final = 2600
"""Longer side, in pixels, of the image in which markers are detected.

A marker of the widest page then has 30.
"""
STRETCHES: Final = (1.0, 2.0, 0.5, 4.0, 0.25)
"""Factors on the line pitch that are tried in turn where no marker is detected: an encoder may be that wrong."""
FEWEST: Final = 2
"""Least number of markers that locate a page; each has four corners."""
_OFF: Final = 0.35
"""Greatest distance of corners from the common map, as a share of a marker's side.

Corners farther off are of something else.
"""
PRINT_IT: Final = "let a whole page of `prooflight chart make --ruler` pass, print side to the camera"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectedRuler:
    """Ruler page in a scan."""

    to_pixel: NDArray[np.float64]
    """Affine map (2, 3) from (x, y, 1) on the page [mm] to (column, line) [pixels], whole numbers at pixel centres."""
    box_mm: tuple[float, float, float, float]
    """Left, top, right and bottom of the detected markers: the map is accurate there, and less so beyond. [mm]"""
    groups: tuple[int, int]
    """First and last group with a detected marker."""
    cells: tuple[int, int]
    """First and last cell with a detected marker."""
    markers: int

    @property
    def end_mm(self) -> tuple[float, float]:
        """Return right and bottom of the area that may be read: the combs after the last markers.

        The area after it is of another page, or would have markers of its own.
        """
        return (
            MARGIN_MM + (self.cells[1] + 1) * CELL_MM + TOOTH_MM,
            MARGIN_MM + (self.groups[1] + 1) * GROUP_MM + TOOTH_MM,
        )

    def whole(self, lines: int) -> bool:
        """Return whether ``lines`` lines hold the page from its first group to the place of another group's markers."""
        _, bottom = self.end_mm
        last = max(self.to_pixel[1] @ (x, bottom + 2 * MARKER_MM, 1.0) for x in self.box_mm[::2])
        return self.groups[0] == 0 and bool(last < lines)

    @property
    def to_page(self) -> NDArray[np.float64]:
        """Return the inverse map, (2, 3)."""
        return np.asarray(cv2.invertAffineTransform(self.to_pixel), np.float64)

    @property
    def pitch_mm(self) -> tuple[float, float]:
        """Return the distances between neighbouring columns and between neighbouring lines. [mm]"""
        back = self.to_page[:, :2]
        return float(np.hypot(*back[:, 0])), float(np.hypot(*back[:, 1]))

    @property
    def skew_deg(self) -> float:
        """Return the page's clockwise rotation as seen. [degree]"""
        across, along = self.pitch_mm
        return float(np.rad2deg(np.arctan2(self.to_pixel[1, 0] * along, self.to_pixel[0, 0] * across)))


def relative_light(lines: NDArray[np.number]) -> NDArray[np.float32]:
    """Convert raw lines (sensors, lines, pixels) [DN] to the brightest sensor's light over paper's, (lines, pixels).

    Only black is dark in all sensors. Black is 0 and paper about 1; both as the scan itself shows them.
    """
    coarse = lines[:, ::5, ::5].reshape(len(lines), -1)
    dark, white = np.percentile(coarse, (1, 97), axis=1).astype(np.float32)
    span = np.maximum(white - dark, 1e-3)[:, None, None]
    return np.asarray(((lines.astype(np.float32) - dark[:, None, None]) / span).max(axis=0))


def find_ruler(light: NDArray[np.float32], *, where: str) -> DetectedRuler:
    """Detect a ruler page in ``relative_light`` (lines, pixels); where: the camera, in errors.

    ScanError: there is none, or it lies upside down, sideways or is seen mirrored.
    """
    numbers, corners = _markers(light)
    if len(numbers) < FEWEST:
        if len(_markers(np.ascontiguousarray(light[:, ::-1]), STRETCHES[:1])[0]) >= FEWEST:
            what = "sees the ruler page mirrored"
            raise ScanError(where, what, remedy="switch off its ReverseX, or let the paper run the other way")
        what = f"sees no ruler page in {len(light)} lines" + (
            f": {len(numbers)} of its markers" if numbers else ""
        )
        raise ScanError(where, what, remedy=PRINT_IT)
    layout_corners = {marker.number: marker.corners_mm for marker in RulerLayout.largest().markers()}
    ruler = _common_map(
        [
            (number, layout_corners[number], seen)
            for number, seen in zip(numbers, corners, strict=True)
            if number in layout_corners
        ]
    )
    if ruler is None:
        what = f"sees {len(numbers)} markers that do not belong to a ruler page"
        raise ScanError(where, what, remedy=PRINT_IT)
    turn = ruler.skew_deg
    if abs(turn) > 135:
        what = "sees the ruler page upside down"
        raise ScanError(
            where,
            what,
            remedy="let the edge that is marked for it pass first, or set ReverseX and turn the page",
        )
    if abs(turn) > 45:
        what = "sees the ruler page sideways"
        raise ScanError(where, what, remedy="let the edge that is marked for it pass first")
    return ruler


def _markers(
    light: NDArray[np.float32], stretches: tuple[float, ...] = STRETCHES
) -> tuple[list[int], list[NDArray[np.float64]]]:
    """Return numbers and corners (4, 2) [pixels] of markers, at the first stretch of the lines that shows some."""
    parameters = cv2.aruco.DetectorParameters()
    # A contour runs half a pixel inside what is black.
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARY), parameters)
    grey = np.clip(light * 200, 0, 255).astype(np.uint8)
    for stretch in stretches:
        extent = np.array([grey.shape[1], grey.shape[0] * stretch])
        size = np.maximum(np.round(extent / max(extent.max() / SEARCH_PIXELS, 1.0)), 8).astype(int)
        small = cv2.resize(grey, size.tolist(), interpolation=cv2.INTER_AREA)
        seen, numbers, _ = detector.detectMarkers(small)
        if numbers is not None and len(numbers) >= FEWEST:
            scale = np.array(grey.shape[::-1]) / size
            places = [(corner[0].astype(np.float64) + 0.5) * scale - 0.5 for corner in seen]
            return [int(number) for number in np.ravel(numbers)], places
    return [], []


def _common_map(
    seen: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]],
) -> DetectedRuler | None:
    """Return the affine map on which most markers agree; None: fewer than ``FEWEST`` do.

    seen: number, corners on the page and in the scan.
    """
    best: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = []
    for _, page, place in seen:
        own = _fitted(page, place)
        extent = np.ptp(page[:, 0])
        side = min(np.hypot(*own[:, 0]), np.hypot(*own[:, 1])) * extent
        # A marker's own map, carried to the end of the page, is off by some of its sides.
        near = [
            one
            for one in seen
            if np.abs(one[1] @ own[:, :2].T + own[:, 2] - one[2]).max()
            < _OFF * side * (1 + np.abs(one[1] - page).max() / extent / 4)
        ]
        best = max(best, near, key=len)
    if len(best) < FEWEST:
        return None
    numbers, pages, places = zip(*best, strict=True)
    page, place = np.concatenate(pages), np.concatenate(places)
    (left, top), (right, bottom) = page.min(axis=0), page.max(axis=0)
    rows, columns = np.divmod(np.array(numbers), MOST_CELLS * SLOTS)
    return DetectedRuler(
        to_pixel=_fitted(page, place),
        box_mm=(float(left), float(top), float(right), float(bottom)),
        groups=(int(rows.min()), int(rows.max())),
        cells=(int(columns.min()) // SLOTS, int(columns.max()) // SLOTS),
        markers=len(best),
    )


def _fitted(page: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    design = np.column_stack([page, np.ones(len(page))])
    return np.asarray(np.linalg.lstsq(design, seen, rcond=None)[0].T)
