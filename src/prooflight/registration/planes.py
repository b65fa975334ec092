"""Register of ink planes that share edges, from their fringes, where tile displacements cannot resolve it.

Where type is set in several inks at once, all planes' edges coincide, and a plane slightly off shows on one
side of a letter and is hidden on the other. The scan is therefore rendered with planes displaced by whole
raster pixels, and the displacements with the least residual are taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INKS
from prooflight.registration.overlaps import overlaps_of
from prooflight.registration.patches import IN_REGISTER, Patches, Steps

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.registration.landmarks import Landmarks
    from prooflight.registration.overlaps import Overlaps
    from prooflight.registration.register import PlacedTiles, Registration
    from prooflight.scans.placement import Placement

ALONE: Final = 1.58
"""Distance beyond which a plane is isolated, in units of the greatest displacement of good planes: in one
print of a thousand one plane is further than that off all three others. Of three planes it would be one print
in a hundred, which is too many."""
MOST_MISFIT: Final = 1.0
"""Cost of a pixel above which a page does not look as designed (0.05 to 0.25 on good prints), at any
displacements."""
HOLLOW: Final = 0.2
"""Cost of a pixel above which other starts are tried."""
TRIED: Final = 4
"""Number of steps of three planes or more, or of starts, that are tried."""
FURTHER: Final = 10.0
"""Logarithm of the odds above which a plane lies further off than those of good prints, a misprint; below it,
fringes leave its place undecided."""

FAR_MM: Final = 0.7
"""Greatest displacement of a plane of a misprint that is looked for. Assumed: a little more than a letter's stroke and
the space beside it, beyond which other planes explain the same fringes."""
FAR_SD_MM: Final = 0.35
"""Standard deviation of the planes of a misprint a priori. Assumed: half of that."""
FAR_STEPS: Final = 3
"""Distance of places from which a plane of a misprint is looked for: strokes are wider. [raster pixels]"""


Ways = tuple[tuple[int, int], ...]
"""Planes, each with -1 or 1: a step of a raster pixel to the left or right, or up or down."""
PAIRS_OF: Final = {count: np.array([*combinations(range(count), 2)]).T for count in (3, 4)}
"""Pairs (2, n) among so many planes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FringeRegister:
    """Register of the planes from fringes, used for prediction; evidence is taken from registration."""

    placement: Placement
    """Placement of the print, with all tiles printed by planes displaced as below."""
    planes_mm: NDArray[np.float64]
    """Displacement of each plane to the right and down within the placement, (4, 2)."""


def register_by_fringes(
    overlaps: Overlaps,
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    registration: Registration,
    *,
    lost: NDArray[np.bool_] | None = None,
    threads: int = 1,
) -> FringeRegister | None:
    """Estimate the register of planes that share edges, in a scan in which the page was registered.

    The result is None where planes lie further off than those of good prints, or too little of the page is
    seen: prediction must not follow a misprint.

    Parameters
    ----------
    scan : (sensors, lines, pixels) [DN]
    landmarks : of the page, on the raster of the overlaps (``Landmarks.finer``)
    registration : of the page
    lost : (sensors, lines) missing lines
    threads : number of threads that render patches
    """
    if registration.tiles is None:
        return None
    patches = Patches.of(overlaps, landmarks, scan, registration, lost=lost, threads=threads)
    if patches is None:
        return None
    steps = _resolved_by_tiles(
        patches, registration.tiles, _searched(patches, _rounded(overlaps, registration.planes_mm))
    )
    planes_mm = overlaps.planes_mm(steps)
    # Of three planes one is too often alone on good prints.
    alone = overlaps.has_edges.all() and isolated(planes_mm, good_mm=overlaps.good_mm).any()
    if patches.misfit > MOST_MISFIT or alone or _goes_further(patches, steps):
        return None
    placement, _ = registration.tiles.placed(planes_mm, overlaps.has_edges)
    further_mm = patches.further_pixels(steps, placement) * landmarks.pitch_mm
    placement, planes_mm = registration.tiles.corrected(further_mm).placed(planes_mm, overlaps.has_edges)
    return FringeRegister(placement=placement, planes_mm=planes_mm)


def register_far_planes(
    page: Page,
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    registration: Registration,
    *,
    lost: NDArray[np.bool_] | None = None,
    threads: int = 1,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]] | None:
    """Return the displacements of planes that may lie further off than those of good prints, as a misprint's do.

    Parameters
    ----------
    page, landmarks : of the design
    scan : (sensors, lines, pixels) [DN]
    registration : of the page in the scan
    lost : (sensors, lines) missing lines
    threads : number of threads that render patches

    Returns
    -------
    planes_mm : (4, 2) displacements to the right and down, to the raster pixel, about a place that all have in common
    located : (4,) the planes that have edges beside other planes' [-]
        None where fringes do not tell: the page was not located, its planes share too few edges, or it does not look
        as designed wherever they lie.
    """
    if registration.tiles is None:
        return None
    overlaps = overlaps_of(page, landmarks, good_mm=FAR_MM)
    if overlaps is None:
        return None
    patches = Patches.of(
        overlaps, landmarks, scan, registration, lost=lost, plane_sd_mm=FAR_SD_MM, threads=threads
    )
    if patches is None:
        return None
    start = _rounded(overlaps, registration.planes_mm)
    starts = [start, *_jumps(patches, start)]
    near = [starts[place] for place in np.argsort(patches.costs(starts), kind="stable")[:TRIED]]
    steps = _searched(patches, patches.most_likely([_descended(patches, one) for one in near]))
    steps = _resolved_by_tiles(patches, registration.tiles, steps)
    if patches.misfit > MOST_MISFIT or _goes_further(patches, steps):
        return None
    return overlaps.planes_mm(steps), overlaps.has_edges


def _jumps(patches: Patches, steps: Steps) -> list[Steps]:
    """Return all displacements of one plane by multiples of ``FAR_STEPS`` along an axis, within its reach."""
    reach = patches.overlaps.reach
    return [
        _stepped(steps, axis, {ink: place - steps[INKS * axis + ink]})
        for axis in range(2)
        for ink in patches.overlaps.inks
        for place in range(-reach + 1, reach, FAR_STEPS)
    ]


def _resolved_by_tiles(patches: Patches, tiles: PlacedTiles, best: Steps) -> Steps:
    """Return the neighbouring displacements that the page's tiles fit best among those that fringes leave undecided.

    Neighbours have one plane moved by a raster pixel. A plane that shows in few patches, and there only
    beside others, may make up all the rest of the page.
    """
    near = [best, *_singles(patches, best, 0), *_singles(patches, best, 1)]
    costs = dict(zip(near, patches.costs(near), strict=True))
    open_ = [steps for steps in near if costs[steps] < costs[best] + FURTHER]
    if len(open_) == 1:
        return best
    overlaps = patches.overlaps
    return min(
        open_, key=lambda steps: costs[steps] + tiles.cost(overlaps.planes_mm(steps), overlaps.has_edges)
    )


def _rounded(overlaps: Overlaps, planes_mm: NDArray[np.float64]) -> Steps:
    """Return registration's planes rounded to the raster."""
    steps = np.rint(planes_mm / overlaps.pixel_mm).clip(-overlaps.reach, overlaps.reach)
    steps[[ink for ink in range(INKS) if ink not in overlaps.inks]] = 0
    return tuple(int(step) for step in steps.T.ravel())


def _searched(patches: Patches, start: Steps) -> Steps:
    """Return the displacements of least cost by two descents, the second with costs scaled by the end of the first.

    Where patches are then worse than those of most good prints, the first end was a local minimum, and
    descents from other starts are tried.
    """
    best = _descended(patches, patches.most_likely([IN_REGISTER, start]))
    patches.sharpen(best)
    if patches.misfit > HOLLOW:
        near = [other for axis in range(2) for other in _singles(patches, IN_REGISTER, axis)]
        starts = [near[place] for place in np.argsort(patches.costs(near), kind="stable")[:TRIED]]
        best = patches.most_likely([best, *(_descended(patches, one) for one in starts)])
    best = _descended(patches, best)
    patches.sharpen(best)
    return best


def _descended(patches: Patches, best: Steps) -> Steps:
    """Descend by single planes, by pairs of them, then by more, either axis in turn, until nothing improves.

    Single steps miss pairs: two planes that are off by the same amount hide each other's fringes.
    """
    axes, axis = 0, 0
    while True:
        before = best
        # An axis is gone down to its end before the other's turn; planes go askew where neither goes down any more.
        for near in (_singles, _pairs, _many) if axes < 2 else (_askew, _mirrored):
            best = patches.most_likely([best, *near(patches, best, axis)])
            if best != before:
                break
        if best == before and axes == 2:
            return best
        axis, axes = (axis, 0) if best != before else (1 - axis, axes + 1)


def _singles(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    """Return all steps of one plane by a raster pixel either way, within the range of good prints."""
    return _moved_by(steps, _steps_of_planes(_ways(patches, steps, axis), axis, 1))


def _pairs(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    return _moved_by(steps, _steps_of_planes(_ways(patches, steps, axis), axis, 2))


def _many(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    """Return the steps of three or four planes with the lowest predicted cost, if interactions of pairs add up."""
    ways = _ways(patches, steps, axis)
    here, *ones = patches.costs([steps, *_singles(patches, steps, axis)])
    single = np.array(ones) - here
    pair = np.zeros((len(ways), len(ways)))
    pair[tuple(_of_planes(ways, 2).T)] = patches.costs(_pairs(patches, steps, axis))
    candidates: list[tuple[float, Steps]] = []
    for count in (3, 4):
        more = _of_planes(ways, count)
        i, j = (more[:, places] for places in PAIRS_OF[count])
        of_pairs = (pair[i, j] - here - single[i] - single[j]).sum(axis=1)
        predicted = of_pairs + single[more].sum(axis=1)
        chosen = np.flatnonzero(predicted <= np.sort(predicted)[:TRIED].max(initial=-np.inf))
        stepped = _moved_by(steps, _steps_of_planes(ways, axis, count)[chosen])
        candidates += zip(predicted[chosen].tolist(), stepped, strict=True)
    return [other for _, other in sorted(candidates)[:TRIED]]


@lru_cache(maxsize=64)
def _of_planes(ways: Ways, count: int) -> NDArray[np.int64]:
    """Return the combinations (n, count) of the ways, by their indices, in which every way is of another plane."""
    every = combinations(range(len(ways)), count)
    different = [some for some in every if len({ways[way][0] for way in some}) == count]
    return np.array(different, np.int64).reshape(-1, count)


@lru_cache(maxsize=64)
def _steps_of_planes(ways: Ways, axis: int, count: int) -> NDArray[np.int64]:
    """Return the steps (n, 8) of so many planes at once along an axis, each its way."""
    every = _of_planes(ways, count)
    by = np.zeros((len(every), 2 * INKS), np.int64)
    ink, way = np.array(ways, np.int64).reshape(-1, 2).T
    by[np.arange(len(every))[:, None], INKS * axis + ink[every]] = way[every]
    return by


def _moved_by(steps: Steps, by: NDArray[np.int64]) -> list[Steps]:
    """Return the displacements after each of the steps (n, 8)."""
    return [*map(tuple, (np.array(steps) + by).tolist())]


def _askew(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    """Return all steps of one plane along both axes at once."""
    return [
        _stepped(one, 1 - axis, {ink: way})
        for ink, way in _ways(patches, steps, 1 - axis)
        for one in (_stepped(steps, axis, {own: by}) for own, by in _ways(patches, steps, axis) if own == ink)
    ]


def _mirrored(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    """Return all planes mirrored about register, along either axis or both.

    Thin strokes have similar fringes for either sign, and the path from one to the other leads uphill.
    """
    across, along = steps[:INKS], steps[INKS:]
    back = tuple(-step for step in across), tuple(-step for step in along)
    return [(*back[0], *along), (*across, *back[1]), (*back[0], *back[1])]


def _ways(patches: Patches, steps: Steps, axis: int) -> Ways:
    """Return the planes and the ways in which they may go a raster pixel further."""
    reach, first = patches.overlaps.reach, INKS * axis
    return tuple(
        (ink, way)
        for ink in patches.overlaps.inks
        for way in (-1, 1)
        if abs(steps[first + ink] + way) <= reach
    )


def _stepped(steps: Steps, axis: int, by: dict[int, int]) -> Steps:
    moved = list(steps)
    for ink, way in by.items():
        moved[INKS * axis + ink] += way
    return tuple(moved)


def isolated(planes_mm: NDArray[np.float64], *, good_mm: float) -> NDArray[np.bool_]:
    """Return which planes lie far off all others along an axis, which hardly any good print's does.

    planes_mm: (planes, 2) displacements; a plane alone is not off. good_mm: greatest displacement of planes on good
    prints.

    >>> isolated(np.array([[0.3, 0.0], [0.0, 0.0], [0.1, 0.0]]), good_mm=0.1).tolist()
    [True, False, False]
    """
    count = len(planes_mm)
    distances = np.abs(planes_mm[:, None] - planes_mm)
    distances[np.arange(count), np.arange(count)] = np.inf
    nearest = distances.min(axis=1, initial=np.inf)
    return np.asarray((nearest.max(axis=1) > ALONE * good_mm) & (count > 1))


def _goes_further(patches: Patches, steps: Steps) -> bool:
    """Return whether a plane at the limit of good prints fits better beyond it."""
    beyond = [
        _stepped(steps, axis, {ink: way})
        for axis in range(2)
        for ink in patches.overlaps.inks
        for way in (-1, 1)
        if steps[INKS * axis + ink] == way * patches.overlaps.reach
    ]
    here, *there = patches.costs([steps, *beyond])
    return any(other < here - FURTHER for other in there)
