"""What patches of one scan say against planes lying in one place or another: rendered, compared, weighed."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.registration.measuring import SUMS
from prooflight.kernels.registration.shared_edges import (
    SensorPatches,
    fringe_sums,
    shared_costs,
    without_light,
)
from prooflight.pages.parallel import parts_of, shared_out
from prooflight.prediction.quantised_table import quantised_table
from prooflight.registration.overlaps import LEAST_PATCHES, PATCH_PIXELS
from prooflight.registration.tiles import Workspace, pixel_noise
from prooflight.scans.scan import touching

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.registration.landmarks import Landmarks
    from prooflight.registration.overlaps import Overlaps
    from prooflight.registration.register import Registration
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
    displaced: NDArray[np.float64]
    """(every patch of the design, 2) how far the placement displaces it. [pixels]"""
    lines: int
    """Of the scan."""
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
    threads: int = 1
    """That share patches out."""
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
        found: Registration,
        *,
        lost: NDArray[np.bool_] | None = None,
        threads: int = 1,
    ) -> Self | None:
        """The patches that a scan shows of a page found there; None if they are too few.

        lost (sensors, lines): lines that were not seen; no patch that lies on one counts.
        """
        moves = _moves(overlaps, landmarks, found.placement, scan.shape[1])
        whole = np.rint(moves).astype(np.int64)
        left, top = overlaps.columns + whole[:, 0], overlaps.lines + whole[:, 1]
        seen = (left >= 0) & (left + PATCH_PIXELS <= scan.shape[2])
        seen &= (top >= 0) & (top + PATCH_PIXELS <= scan.shape[1])
        if lost is not None:
            seen &= ~touching(lost, top, PATCH_PIXELS).any(axis=0)
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
            parts=found.plane_parts,
            displaced=moves,
            lines=scan.shape[1],
            packed=overlaps.packed[seen],
            origins=overlaps.origins[seen],
            light=np.stack(light).astype(np.float32),
            moves=(moves - whole)[seen] * landmarks.ratio,
            base=np.empty(np.shape(light), np.float32),
            threads=threads,
        )
        self.sharpen(IN_REGISTER)
        return self

    def costs(self, many: Sequence[Steps]) -> list[float]:
        """Minus the logarithm of the likelihood that planes lie so, and of that beforehand, each way. [-]"""
        self._look_at(many)
        return [self.known[steps][0] for steps in many]

    def likeliest(self, many: Sequence[Steps]) -> Steps:
        """The first that costs least."""
        return many[int(np.argmin(self.costs(many)))]

    def further_pixels(self, steps: Steps, placement: Placement) -> NDArray[np.float64]:
        """(2,) by how much they lie further right and down than a placement has them, if planes lie so."""
        self._look_at([steps])
        further = self._centred([steps])[0] / self.landmarks.ratio + self.known[steps][1:]
        there = _moves(self.overlaps, self.landmarks, placement, self.lines)
        return np.asarray((self.displaced - there).mean(axis=0) + further)

    def _centred(self, many: Sequence[Steps]) -> NDArray[np.float64]:
        """Where the page lies if the placement, which is of planes as they count, is right. (k, 2) [raster pixels]"""
        return -np.asarray((self.parts * np.array(many).reshape(-1, 2, INKS)).sum(axis=2))

    def _look_at(self, many: Sequence[Steps]) -> None:
        """Know what all of these cost."""
        if new := [steps for steps in dict.fromkeys(many) if steps not in self.left]:
            self.left.update(zip(new, self._rendered(new), strict=True))
        if new := [steps for steps in dict.fromkeys(many) if steps not in self.known]:
            found, _ = self._shared(new)
            off = np.array(new) * (self.overlaps.pixel_mm / PLANE_SD_MM)
            costs = found[:, 0] / self.scale + np.square(off).sum(axis=1) / 2
            moves = found[:, 1:].tolist()
            self.known.update(
                (steps, (cost, x, y)) for steps, cost, (x, y) in zip(new, costs.tolist(), moves, strict=True)
            )

    def _shared(self, many: Sequence[Steps]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """``shared_costs`` of what was rendered."""
        left = np.stack([self.left[steps] for steps in many])
        found, costs = np.empty((len(many), 3)), np.empty(left.shape[:2])
        shared_costs(left, OWN_SD, COMMON_SD, self.most, found, costs)
        return found, costs

    def sharpen(self, steps: Steps) -> None:
        """Take what is left with planes there for what a good patch leaves."""
        self._look_at([steps])
        _, (costs,) = self._shared([steps])
        self.misfit = float(np.median(costs)) / (PATCH_PIXELS**2 * len(self.light))
        cost = max(self.misfit, LEAST_COST)
        self.most = MOST_COSTS * cost * PATCH_PIXELS**2 * len(self.light)
        self.scale = 2 * TEMPER * cost
        self.known.clear()

    def _rendered(self, many: Sequence[Steps]) -> NDArray[np.float64]:
        """``without_light`` of every patch with the planes so, (k, patches, 6)."""
        landmarks, overlaps = self.landmarks, self.overlaps
        right, down = np.array(many).reshape(-1, 2, INKS).transpose(1, 0, 2).copy()
        shifts = self._centred(many)
        halftone2 = (HALFTONE_MM / landmarks.geometry.pixel_pitch_mm) ** 2
        noise = [
            pixel_noise(sensor, halftone2=halftone2, by_slope=SLOPE_NOISE) for sensor in landmarks.sensors
        ]
        parts = parts_of(len(self.packed), self.threads)

        def summed(index: int, part: slice) -> NDArray[np.float32]:
            sensor, taps = landmarks.sensors[index], landmarks.taps[index]
            patches = SensorPatches(
                light=self.light[index, part],
                base=self.base[index, part],
                packed=self.packed[part],
                margin=overlaps.margin,
                origins=self.origins[part],
                moves=self.moves[part],
            )
            sums = np.empty((len(many), len(patches.packed), SUMS), np.float32)
            fringe_sums(
                patches,
                right,
                down,
                shifts,
                quantised_table(sensor.mean_dn),
                taps,
                noise[index],
                Workspace.of(self.packed.shape[2] - 2 * overlaps.margin, taps, size=PATCH_PIXELS),
                not self.left,
                sums,
            )
            return sums

        every = range(len(self.light))
        found = shared_out(
            [partial(summed, index, slice(*part)) for index in every for part in parts], threads=self.threads
        )
        sums = np.concatenate(found, axis=1).reshape(len(many), len(every), -1, SUMS).swapaxes(0, 1)
        left = np.empty((len(many), len(self.packed), 6))
        level_sd = np.array([LEVEL_SD * one.white_dn for one in landmarks.sensors])
        without_light(sums.reshape(len(sums), -1, SUMS), level_sd, GAIN_SD, left.reshape(-1, 6))
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
