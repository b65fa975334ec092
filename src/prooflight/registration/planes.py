"""Where ink planes lie that share their edges, by the fringes that they show: what tiles' displacements cannot tell.

Where type is set in several inks at once all planes' edges lie together, and a plane a little off shows on one side of
a letter and hides on the other. What a scan should show is therefore rendered with the planes displaced by whole raster
pixels, and the displacements that leave least are taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INKS
from prooflight.registration.patches import IN_REGISTER, Patches, Steps

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.registration.landmarks import Landmarks
    from prooflight.registration.overlaps import Overlaps
    from prooflight.registration.register import PlacedTiles, Registration
    from prooflight.scans.placement import Placement

ALONE: Final = 1.58
"""Of the most that good planes are off: further than that off all three others one lies in one print of a thousand. Of
three planes one would in one of a hundred, which is too many."""
MOST_MISFIT: Final = 1.0
"""Cost of a pixel above which a page does not look as designed (0.05 to 0.25 on good prints), wherever planes lie."""
HOLLOW: Final = 0.2
"""Cost of a pixel above which other starts are tried."""
TRIED: Final = 4
"""Steps of three planes or more, or starts, that are tried."""
FURTHER: Final = 10.0
"""Logarithm of the odds from which a plane lies further off than good prints' do, a misprint's; up to which fringes
leave open where it lies."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FringeRegister:
    """What fringes say of planes, for prediction; evidence is what registration says."""

    placement: Placement
    """Where the print lies, all tiles being printed by planes that lie so."""
    planes_mm: NDArray[np.float64]
    """(4, 2) how far each plane lies too far right and down within it."""


def register_by_fringes(
    overlaps: Overlaps,
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    found: Registration,
    *,
    lost: NDArray[np.bool_] | None = None,
    threads: int = 1,
) -> FringeRegister | None:
    """Register of the planes that share edges, in a scan (sensors, lines, pixels) [DN] in which the page was found.

    lost (sensors, lines): lines that were not seen. threads: that share patches out. None where planes lie further off
    than those of good prints, or too little of the page is seen: prediction must not follow a misprint.
    """
    if found.tiles is None:
        return None
    patches = Patches.of(overlaps, landmarks, scan, found, lost=lost, threads=threads)
    if patches is None:
        return None
    steps = _told_by_tiles(patches, found.tiles, _searched(patches, _rounded(overlaps, found.planes_mm)))
    if patches.misfit > MOST_MISFIT or _lies_alone(overlaps, steps) or _goes_further(patches, steps):
        return None
    planes_mm = overlaps.planes_mm(steps)
    placement, _ = found.tiles.placed(planes_mm, overlaps.told)
    further_mm = patches.further_pixels(steps, placement) * landmarks.pitch_mm
    placement, planes_mm = found.tiles.corrected(further_mm).placed(planes_mm, overlaps.told)
    return FringeRegister(placement=placement, planes_mm=planes_mm)


def _told_by_tiles(patches: Patches, tiles: PlacedTiles, found: Steps) -> Steps:
    """Of what fringes leave open, one plane a raster pixel further or not, that which the page's tiles fit best.

    A plane that shows in few patches, and there beside others alone, may make up all the rest of the page.
    """
    near = [found, *_singles(patches, found, 0), *_singles(patches, found, 1)]
    costs = dict(zip(near, patches.costs(near), strict=True))
    open_ = [steps for steps in near if costs[steps] < costs[found] + FURTHER]
    if len(open_) == 1:
        return found
    overlaps = patches.overlaps
    return min(open_, key=lambda steps: costs[steps] + tiles.cost(overlaps.planes_mm(steps), overlaps.told))


def _rounded(overlaps: Overlaps, planes_mm: NDArray[np.float64]) -> Steps:
    """Registration's planes on the raster."""
    steps = np.rint(planes_mm / overlaps.pixel_mm).clip(-overlaps.reach, overlaps.reach)
    steps[[ink for ink in range(INKS) if ink not in overlaps.inks]] = 0
    return tuple(int(step) for step in steps.T.ravel())


def _searched(patches: Patches, start: Steps) -> Steps:
    """The displacements of least cost: a descent, and another with costs as sharp as the first one's end allows.

    Where patches are then left worse than good prints' mostly are, that was no more than a hollow on the way, and
    descents from elsewhere are tried.
    """
    best = _descended(patches, patches.likeliest([IN_REGISTER, start]))
    patches.sharpen(best)
    if patches.misfit > HOLLOW:
        near = [other for axis in range(2) for other in _singles(patches, IN_REGISTER, axis)]
        starts = [near[place] for place in np.argsort(patches.costs(near), kind="stable")[:TRIED]]
        best = patches.likeliest([best, *(_descended(patches, one) for one in starts)])
    best = _descended(patches, best)
    patches.sharpen(best)
    return best


def _descended(patches: Patches, best: Steps) -> Steps:
    """From there down by single planes, by pairs of them, then by more, either axis in turn, until nothing helps.

    Pairs are what single steps miss: two planes that are off together hide each other's fringes.
    """
    axes, axis = 0, 0
    while True:
        before = best
        # An axis is gone down to its end before the other's turn; planes go askew where neither goes down any more.
        for near in (_singles, _pairs, _many) if axes < 2 else (_askew, _mirrored):
            best = patches.likeliest([best, *near(patches, best, axis)])
            if best != before:
                break
        if best == before and axes == 2:
            return best
        axis, axes = (axis, 0) if best != before else (1 - axis, axes + 1)


def _singles(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    """Every one of the planes a raster pixel further either way, as far as good prints' go."""
    return [_stepped(steps, axis, {ink: way}) for ink, way in _ways(patches, steps, axis)]


def _pairs(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    ways = _ways(patches, steps, axis)
    return [_stepped(steps, axis, dict((ways[i], ways[j]))) for i, j in _of_planes(tuple(ways), 2)]


def _many(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    """Steps of three planes or four that promise most, if what pairs do to each other adds up."""
    ways = _ways(patches, steps, axis)
    here, *ones = patches.costs([steps, *_singles(patches, steps, axis)])
    single = np.array(ones) - here
    pair = np.zeros((len(ways), len(ways)))
    places = np.array(_of_planes(tuple(ways), 2), np.int64).reshape(-1, 2)
    pair[tuple(places.T)] = patches.costs(_pairs(patches, steps, axis))
    promised: list[tuple[float, Steps]] = []
    for count in (3, 4):
        if more := _of_planes(tuple(ways), count):
            i, j = np.array([list(combinations(some, 2)) for some in more]).transpose(2, 0, 1)
            of_pairs = (pair[i, j] - here - single[i] - single[j]).sum(axis=1)
            promise = of_pairs + single[np.array(more)].sum(axis=1)
            stepped = [_stepped(steps, axis, dict(ways[way] for way in some)) for some in more]
            promised += zip(promise.tolist(), stepped, strict=True)
    return [other for _, other in sorted(promised)[:TRIED]]


@lru_cache(maxsize=64)
def _of_planes(ways: tuple[tuple[int, int], ...], count: int) -> list[tuple[int, ...]]:
    """Which ``count`` of the ways, by their numbers, are of as many planes."""
    return [
        some for some in combinations(range(len(ways)), count) if len({ways[way][0] for way in some}) == count
    ]


def _askew(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    """Every plane along both axes at once."""
    return [
        _stepped(one, 1 - axis, {ink: way})
        for ink, way in _ways(patches, steps, 1 - axis)
        for one in (_stepped(steps, axis, {own: by}) for own, by in _ways(patches, steps, axis) if own == ink)
    ]


def _mirrored(patches: Patches, steps: Steps, axis: int) -> list[Steps]:
    """All planes as far off the other way, along either axis or both: of thin strokes either side's fringes look alike,
    and the way from one to the other leads uphill.
    """
    across, along = steps[:INKS], steps[INKS:]
    back = tuple(-step for step in across), tuple(-step for step in along)
    return [(*back[0], *along), (*across, *back[1]), (*back[0], *back[1])]


def _ways(patches: Patches, steps: Steps, axis: int) -> list[tuple[int, int]]:
    """Planes and the ways in which they may go a raster pixel further."""
    return [
        (ink, way)
        for ink in patches.overlaps.inks
        for way in (-1, 1)
        if abs(steps[INKS * axis + ink] + way) <= patches.overlaps.reach
    ]


def _stepped(steps: Steps, axis: int, by: dict[int, int]) -> Steps:
    moved = list(steps)
    for ink, way in by.items():
        moved[INKS * axis + ink] += way
    return tuple(moved)


def _lies_alone(overlaps: Overlaps, found: Steps) -> bool:
    """Whether a plane lies far off all three others, which hardly any good print's does."""
    for axis in np.array(found).reshape(2, INKS)[:, overlaps.told]:
        apart = np.abs(axis[:, None] - axis) + np.eye(axis.size, dtype=int) * 99
        if axis.size == INKS and apart.min(axis=1).max() * overlaps.pixel_mm > ALONE * overlaps.good_mm:
            return True
    return False


def _goes_further(patches: Patches, found: Steps) -> bool:
    """Whether a plane that lies as far off as those of good prints lies further off still."""
    beyond = [
        _stepped(found, axis, {ink: way})
        for axis in range(2)
        for ink in patches.overlaps.inks
        for way in (-1, 1)
        if found[INKS * axis + ink] == way * patches.overlaps.reach
    ]
    here, *there = patches.costs([found, *beyond])
    return any(other < here - FURTHER for other in there)
