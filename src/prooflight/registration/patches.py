"""Likelihood of one scan's patches given the displacements of the ink planes, by rendering and comparison."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple, Self

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
from prooflight.registration.landmarks import HALFTONE
from prooflight.registration.overlaps import LEAST_PATCHES, PATCH_PIXELS
from prooflight.registration.tiles import Workspace, pixel_noise
from prooflight.scans.scan import touching

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.kernels.registration.measuring import SensorTaps
    from prooflight.prediction.quantised_table import QuantisedTable
    from prooflight.registration.landmarks import Landmarks
    from prooflight.registration.overlaps import Overlaps
    from prooflight.registration.register import Registration
    from prooflight.scans.placement import Placement

Steps = tuple[int, ...]
"""Displacement of each plane to the right, CMYK, and then down. [raster pixels]"""
IN_REGISTER: Final[Steps] = (0,) * (2 * INKS)

PLANE_SD_MM: Final = 0.048
"""Standard deviation of each plane, across and along, on good prints (worlds.toml)."""
HALFTONE_MM: Final = 0.03 * 0.254
"""Contrast of halftones times the pixel's pitch (worlds.toml)."""
SLOPE_NOISE: Final = 0.05**2
"""Variance per squared slope, from displacements of edges beyond those fitted (assumed). [pixels^2]"""
LEVEL_SD: Final = 0.03
"""Standard deviation of a patch's light, in shares of white: lamp, paper, gain of inks, tables
(worlds.toml)."""
GAIN_SD: Final = 0.1
"""Standard deviation of a patch's contrast. [-]"""
OWN_SD: Final = 0.08
"""Standard deviation of a patch's place about the registered one (0.02 to 0.1 on good prints). [pixels]"""
COMMON_SD: Final = 0.15
"""Standard deviation of the place common to all patches: the registered placement weights planes by their
edges on the whole page, which differ from those in the patches."""
MOST_COSTS: Final = 6.0
"""Cost at which a patch counts half, in units of the patches' median cost."""
TEMPER: Final = 8.0
"""Number of pixels with a common error (assumed: a letter's stem, 2 x 4)."""
LEAST_COST: Final = 0.05
"""Least cost of a pixel: noise is never less."""


class _Renderer(NamedTuple):
    """Renderer of some of the patches for one sensor; it keeps their recipes and light between renderings."""

    patches: SensorPatches
    table: QuantisedTable
    taps: SensorTaps
    noise: NDArray[np.float32]
    workspace: Workspace

    def sums(
        self, right: NDArray[np.int64], down: NDArray[np.int64], shifts: NDArray[np.float64], first: bool
    ) -> NDArray[np.float32]:
        """Return ``fringe_sums``."""
        sums = np.empty((len(right), len(self.patches.packed), SUMS), np.float32)
        patches, table, taps, noise, workspace = self
        fringe_sums(patches, right, down, shifts, table, taps, noise, workspace, first, sums)
        return sums


@dataclass(slots=True, kw_only=True, eq=False)
class Patches:
    """Patches of one scan, and their cost as a function of the planes' displacements."""

    overlaps: Overlaps
    landmarks: Landmarks
    parts: NDArray[np.float64]
    """Weight of each plane in the placement, (2, 4)."""
    displaced: NDArray[np.float64]
    """Displacement by the placement of every patch of the design, (patches of the design, 2). [pixels]"""
    lines: int
    """Lines of the scan."""
    packed: NDArray[np.uint32]
    """Raster as in ``Overlaps`` of the patches inside the scan."""
    origins: NDArray[np.float64]
    light: NDArray[np.float32]
    """Light of the scan, columns corrected, (sensors, patches, side, side). [DN]"""
    moves: NDArray[np.float64]
    """Fraction of the displacement beyond the whole pixels at which light was taken, (patches, 2). [raster
    pixels]"""
    most: float = np.inf
    """Cost at which a patch counts half."""
    plane_sd_mm: float = PLANE_SD_MM
    """Standard deviation of each plane a priori."""
    threads: int = 1
    """Number of threads that render patches."""
    scale: float = 1.0
    """Divisor of the costs that makes their differences logarithms of odds."""
    misfit: float = 0.0
    """Cost of a pixel of the median patch at the best displacements. [-]"""
    renderers: list[_Renderer] = field(default_factory=list)
    """Renderers of the patches, made at the first rendering."""
    left: dict[Steps, NDArray[np.float64]] = field(default_factory=dict)
    """Results of ``without_light`` by displacement."""
    cached_costs: dict[Steps, tuple[float, float, float]] = field(default_factory=dict)
    """Costs by displacement, each with the common displacement at which it is attained [pixels]."""

    @classmethod
    def of(
        cls,
        overlaps: Overlaps,
        landmarks: Landmarks,
        scan: NDArray[np.uint16],
        registration: Registration,
        *,
        lost: NDArray[np.bool_] | None = None,
        plane_sd_mm: float = PLANE_SD_MM,
        threads: int = 1,
    ) -> Self | None:
        """Return the patches that a scan shows of a page registered there, or None if they are too few.

        Parameters
        ----------
        lost : (sensors, lines) missing lines; a patch on one of them is left out
        plane_sd_mm : standard deviation of each plane a priori
        threads : number of threads that render patches
        """
        moves = _moves(overlaps, landmarks, registration.placement, scan.shape[1])
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
            parts=registration.plane_parts,
            displaced=moves,
            lines=scan.shape[1],
            packed=overlaps.packed[seen],
            origins=overlaps.origins[seen],
            light=np.stack(light).astype(np.float32),
            moves=(moves - whole)[seen] * landmarks.ratio,
            plane_sd_mm=plane_sd_mm,
            threads=threads,
        )
        self.sharpen(IN_REGISTER)
        return self

    def costs(self, many: Sequence[Steps]) -> list[float]:
        """Return minus the logarithm of likelihood times prior of each set of displacements. [-]"""
        self._evaluate(many)
        return [self.cached_costs[steps][0] for steps in many]

    def most_likely(self, many: Sequence[Steps]) -> Steps:
        """Return the first set of displacements with the least cost."""
        return many[int(np.argmin(self.costs(many)))]

    def further_pixels(self, steps: Steps, placement: Placement) -> NDArray[np.float64]:
        """Return the patches' mean displacement right and down of a placement, (2,), with planes at ``steps``."""
        self._evaluate([steps])
        further = self._centred([steps])[0] / self.landmarks.ratio + self.cached_costs[steps][1:]
        there = _moves(self.overlaps, self.landmarks, placement, self.lines)
        return np.asarray((self.displaced - there).mean(axis=0) + further)

    def _centred(self, many: Sequence[Steps]) -> NDArray[np.float64]:
        """Return the page's offsets (k, 2) that keep the weighted mean of the planes in place. [raster pixels]"""
        return -np.asarray((self.parts * np.array(many).reshape(-1, 2, INKS)).sum(axis=2))

    def _evaluate(self, many: Sequence[Steps]) -> None:
        """Compute and store the costs of all these displacements."""
        if not (new := [steps for steps in dict.fromkeys(many) if steps not in self.cached_costs]):
            return
        if unseen := [steps for steps in new if steps not in self.left]:
            self.left.update(zip(unseen, self._rendered(unseen), strict=True))
        shared, _ = self._shared(new)
        off = np.array(new) * (self.overlaps.pixel_mm / self.plane_sd_mm)
        costs = shared[:, 0] / self.scale + np.square(off).sum(axis=1) / 2
        values = zip(costs.tolist(), *shared[:, 1:].T.tolist(), strict=True)
        self.cached_costs.update(zip(new, values, strict=True))

    def _shared(self, many: Sequence[Steps]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return ``shared_costs`` of the stored renderings."""
        left = np.array([self.left[steps] for steps in many])
        shared, costs = np.empty((len(many), 3)), np.empty(left.shape[:2])
        shared_costs(left, OWN_SD, COMMON_SD, self.most, shared, costs)
        return shared, costs

    def sharpen(self, steps: Steps) -> None:
        """Set the scale of costs to what is left with planes at ``steps``, taken as the residual of a good patch."""
        self._evaluate([steps])
        _, (costs,) = self._shared([steps])
        self.misfit = float(np.median(costs)) / (PATCH_PIXELS**2 * len(self.light))
        cost = max(self.misfit, LEAST_COST)
        self.most = MOST_COSTS * cost * PATCH_PIXELS**2 * len(self.light)
        self.scale = 2 * TEMPER * cost
        self.cached_costs.clear()

    def _rendered(self, many: Sequence[Steps]) -> NDArray[np.float64]:
        """Return ``without_light`` of every patch for each set of displacements, (k, patches, 6)."""
        right, down = np.array(many).reshape(-1, 2, INKS).transpose(1, 0, 2).copy()
        first = not self.renderers
        if first:
            self.renderers = self._all_renderers()
        shifts, sensors = self._centred(many), self.landmarks.sensors
        tasks = [partial(each.sums, right, down, shifts, first) for each in self.renderers]
        sums = np.concatenate(shared_out(tasks, threads=self.threads), axis=1)
        sums = sums.reshape(len(many), len(sensors), -1, SUMS).swapaxes(0, 1)
        left = np.empty((len(many), len(self.packed), 6))
        level_sd = np.array([LEVEL_SD * one.white_dn for one in sensors])
        without_light(sums.reshape(len(sums), -1, SUMS), level_sd, GAIN_SD, left.reshape(-1, 6))
        return left

    def _all_renderers(self) -> list[_Renderer]:
        """Return the renderers of each sensor's parts of the patches, sensor by sensor."""
        landmarks, overlaps = self.landmarks, self.overlaps
        # A stated screen has more contrast than tiles are allowed where none is.
        beyond = landmarks.halftone**2 - HALFTONE**2
        halftone2 = (HALFTONE_MM / landmarks.geometry.pixel_pitch_mm) ** 2 + beyond
        height, width = (extent - 2 * overlaps.margin for extent in self.packed.shape[1:])
        renderers = []
        for index, (sensor, taps) in enumerate(zip(landmarks.sensors, landmarks.taps, strict=True)):
            for part in (slice(*each) for each in parts_of(len(self.packed), self.threads)):
                packed = self.packed[part]
                patches = SensorPatches(
                    light=self.light[index, part],
                    base=np.empty(self.light[index, part].shape, np.float32),
                    packed=packed,
                    margin=overlaps.margin,
                    origins=self.origins[part],
                    moves=self.moves[part],
                    seen=np.empty((len(packed), height, width), np.uint32),
                    window=np.empty((len(packed), height, width), np.float32),
                )
                renderer = _Renderer(
                    patches=patches,
                    table=quantised_table(sensor.mean_dn),
                    taps=taps,
                    noise=pixel_noise(sensor, halftone2=halftone2, by_slope=SLOPE_NOISE),
                    workspace=Workspace.of(width, size=PATCH_PIXELS),
                )
                renderers.append(renderer)
        return renderers


def _moves(overlaps: Overlaps, landmarks: Landmarks, placement: Placement, lines: int) -> NDArray[np.float64]:
    """Return the displacement of the patches by a placement, (patches, 2). [pixels]"""
    geometry, middle = landmarks.geometry, (PATCH_PIXELS - 1) / 2
    width_mm, height_mm = landmarks.page_width_mm, landmarks.page_height_mm
    x = geometry.centres_x_mm(width_mm)[overlaps.columns] + middle * geometry.pixel_pitch_mm
    y = geometry.centres_y_mm(lines)[overlaps.lines] + middle * geometry.line_pitch_mm
    at_x, at_y = x, y
    for _ in range(3):  # to where the patch itself is seen; displacements change little over a millimetre
        seen_x, seen_y = placement.seen_mm(at_x, at_y, page_width_mm=width_mm, page_height_mm=height_mm)
        at_x, at_y = at_x + x - seen_x, at_y + y - seen_y
    return np.stack([at_x - x, at_y - y], axis=1) / landmarks.pitch_mm
