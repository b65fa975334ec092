"""What patches of one scan say against planes lying in one place or another: rendered, compared, weighed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.registration.measuring import SUMS
from prooflight.kernels.registration.shared_edges import (
    SensorPatches,
    fringe_sums,
    shared_cost,
    without_light,
)
from prooflight.prediction.quantised_table import quantised_table
from prooflight.registration.overlaps import LEAST_PATCHES, PATCH_PIXELS
from prooflight.registration.tiles import Workspace, pixel_noise

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.registration.landmarks import Landmarks
    from prooflight.registration.overlaps import Overlaps
    from prooflight.scans.placement import Placement

Steps = tuple[int, ...]
"""How many raster pixels each plane lies too far right, CMYK, and then how many too far down."""
IN_REGISTER: Final[Steps] = (0,) * (2 * INKS)

PLANE_SD_MM: Final = 0.048
"""Of each plane, across and along, on good prints (worlds.toml)."""
HALFTONE_MM: Final = 0.03 * 0.254
"""Contrast of halftones times the pixel's pitch (worlds.toml)."""
SLOPE_NOISE: Final = 0.05**2
"""Variance by the squared slope: what edges are off by beyond what is fitted (assumed). [pixels^2]"""
LEVEL_SD: Final = 0.03
"""Of a patch's light, in shares of white, and of its contrast: lamp, paper, gain of inks, tables (worlds.toml)."""
GAIN_SD: Final = 0.1
OWN_SD: Final = 0.08
"""Of where a patch lies beside where registration has it (0.02 to 0.1 on good prints). [pixels]"""
COMMON_SD: Final = 0.15
"""Of where all do: registration's placement is of the planes as their edges count, which is not as they show here."""
MOST_COSTS: Final = 6.0
"""Patches' median cost at which a patch counts half."""
TEMPER: Final = 8.0
"""Pixels that err together (assumed: a letter's stem, 2 x 4)."""
LEAST_COST: Final = 0.05
"""Of a pixel: noise is never less."""


@dataclass(slots=True, kw_only=True, eq=False)
class Patches:
    """Patches of one scan, and what they cost wherever planes may lie."""

    overlaps: Overlaps
    landmarks: Landmarks
    parts: NDArray[np.float64]
    """(2, 4) how much each plane counts in the placement."""
    packed: NDArray[np.uint32]
    """As ``Overlaps`` has them, of the patches that are seen."""
    origins: NDArray[np.float64]
    light: NDArray[np.float32]
    """(sensors, patches, side, side) the scan's, columns evened out. [DN]"""
    moves: NDArray[np.float64]
    """(patches, 2) how far the page is displaced beyond the whole pixels at which light was taken. [raster pixels]"""
    base: NDArray[np.float32]
    """As light: inverse variance, of planes in register. [1/DN^2]"""
    most: float = np.inf
    """Cost at which a patch counts half."""
    scale: float = 1.0
    """Of costs, so that their differences are logarithms of odds."""
    misfit: float = 0.0
    """Cost of a pixel of most patches where planes lie best. [-]"""
    left: dict[Steps, NDArray[np.float64]] = field(default_factory=dict)
    """What was rendered: ``without_light``."""
    known: dict[Steps, tuple[float, float, float]] = field(default_factory=dict)
    """Costs, and the common displacement that they ask for [pixels]."""

    @classmethod
    def of(
        cls,
        overlaps: Overlaps,
        landmarks: Landmarks,
        scan: NDArray[np.uint16],
        placement: Placement,
        parts: NDArray[np.float64],
    ) -> Self | None:
        """The patches that a scan of a page that lies so shows; None if they are too few."""
        moves = _moves(overlaps, landmarks, placement, scan.shape[1])
        whole = np.rint(moves).astype(np.int64)
        left, top = overlaps.columns + whole[:, 0], overlaps.lines + whole[:, 1]
        seen = (left >= 0) & (left + PATCH_PIXELS <= scan.shape[2])
        seen &= (top >= 0) & (top + PATCH_PIXELS <= scan.shape[1])
        if seen.sum() < LEAST_PATCHES:
            return None
        side = np.arange(PATCH_PIXELS)
        columns, rows = left[seen, None, None] + side, top[seen, None, None] + side[:, None]
        light = [
            (image[rows, columns] - sensor.column_offset_dn[columns]) / sensor.column_gain[columns]
            for image, sensor in zip(scan, landmarks.sensors, strict=True)
        ]
        self = cls(
            overlaps=overlaps,
            landmarks=landmarks,
            parts=parts,
            packed=overlaps.packed[seen],
            origins=overlaps.origins[seen],
            light=np.stack(light).astype(np.float32),
            moves=(moves - whole)[seen] * landmarks.ratio,
            base=np.empty(np.shape(light), np.float32),
        )
        self.cost(IN_REGISTER)
        self.sharpen(IN_REGISTER)
        return self

    def cost(self, steps: Steps) -> float:
        """Minus the logarithm of the likelihood that planes lie so, and of that beforehand. [-]"""
        return self._found(steps)[0]

    def shift_pixels(self, steps: Steps) -> NDArray[np.float64]:
        """(2,) by how much all lie further right and down than registration has it, if planes lie so."""
        return self._centred(steps) / self.landmarks.ratio + self._found(steps)[1:]

    def _centred(self, steps: Steps) -> NDArray[np.float64]:
        """Where the page lies if the placement, which is of planes as they count, is right. (2,) [raster pixels]"""
        return -np.asarray((self.parts * np.array(steps).reshape(2, INKS)).sum(axis=1))

    def _found(self, steps: Steps) -> tuple[float, float, float]:
        if steps not in self.known:
            if steps not in self.left:
                self.left[steps] = self._rendered(steps)
            costs = np.empty(len(self.packed))
            total, x, y = shared_cost(self.left[steps], OWN_SD, COMMON_SD, self.most, costs)
            off = np.array(steps) * self.overlaps.pixel_mm / PLANE_SD_MM
            self.known[steps] = total / self.scale + float(off @ off) / 2, x, y
        return self.known[steps]

    def sharpen(self, steps: Steps) -> None:
        """Take what is left with planes there for what a good patch leaves."""
        costs = np.empty(len(self.packed))
        shared_cost(self.left[steps], OWN_SD, COMMON_SD, self.most, costs)
        self.misfit = float(np.median(costs)) / (PATCH_PIXELS**2 * len(self.light))
        cost = max(self.misfit, LEAST_COST)
        self.most = MOST_COSTS * cost * PATCH_PIXELS**2 * len(self.light)
        self.scale = 2 * TEMPER * cost
        self.known.clear()

    def _rendered(self, steps: Steps) -> NDArray[np.float64]:
        """``without_light`` of every patch with the planes there, (patches, 6)."""
        landmarks, overlaps = self.landmarks, self.overlaps
        right, down = np.array(steps).reshape(2, INKS)
        halftone2 = (HALFTONE_MM / landmarks.geometry.pixel_pitch_mm) ** 2
        sums = np.empty((*self.light.shape[:2], SUMS), np.float32)
        for index, (sensor, taps) in enumerate(zip(landmarks.sensors, landmarks.taps, strict=True)):
            patches = SensorPatches(
                light=self.light[index],
                base=self.base[index],
                packed=self.packed,
                margin=overlaps.margin,
                origins=self.origins,
                moves=self.moves + self._centred(steps),
            )
            fringe_sums(
                patches,
                right,
                down,
                quantised_table(sensor.mean_dn),
                taps,
                pixel_noise(sensor, halftone2=halftone2, by_slope=SLOPE_NOISE),
                Workspace.of(self.packed.shape[2] - 2 * overlaps.margin, taps),
                not self.left,
                sums[index],
            )
        left = np.empty((len(self.packed), 6))
        without_light(sums, np.array([LEVEL_SD * one.white_dn for one in landmarks.sensors]), GAIN_SD, left)
        return left


def _moves(overlaps: Overlaps, landmarks: Landmarks, placement: Placement, lines: int) -> NDArray[np.float64]:
    """How far a page that lies so displaces the patches, (patches, 2). [pixels]"""
    geometry, middle = landmarks.geometry, (PATCH_PIXELS - 1) / 2
    width_mm, height_mm = landmarks.page_width_mm, landmarks.page_height_mm
    x = geometry.centres_x_mm(width_mm)[overlaps.columns] + middle * geometry.pixel_pitch_mm
    y = geometry.centres_y_mm(lines)[overlaps.lines] + middle * geometry.line_pitch_mm
    at_x, at_y = x, y
    for _ in range(3):  # to where the patch itself is seen; displacements change little over a millimetre
        seen_x, seen_y = placement.seen_mm(at_x, at_y, page_width_mm=width_mm, page_height_mm=height_mm)
        at_x, at_y = at_x + x - seen_x, at_y + y - seen_y
    return np.stack([at_x - x, at_y - y], axis=1) / landmarks.pitch_mm
