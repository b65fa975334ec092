"""Search for a page within a centimetre to the right pixel: candidates from the coarse picture, tested on tiles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.kernels.registration.coarse import SHRINK
from prooflight.registration.coarse import peaks, refined, shrunk
from prooflight.registration.pose import Pose, slopes
from prooflight.registration.tiles import measured
from prooflight.scans.scan import in_groups

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from prooflight.registration.landmarks import Landmarks
    from prooflight.registration.tiles import TileMoves

FIRST_TILES: Final = 80
"""Number of tiles on which candidates are tested; a pose of five numbers needs no more."""
NEAR_MM: Final = 3.0
"""Range of the first search, within which a good print with unknown lead-in lies."""
FAR_MM: Final = 12.5
"""Range of the second search; misprints lie up to 12 mm off (worlds.toml)."""
TURNS_DEG: Final = (0.3, -0.3, 0.6, -0.6, 0.9, -0.9)
"""Turns that are searched where no upright candidate will do."""
WIDE_TURNS_DEG: Final = tuple(0.3 * step for step in range(-4, 5))
WIDE_ALONG: Final = (-0.01, -0.005, 0.0, 0.005, 0.01)
"""Turns and elongations of the wide search: office feeders turn sheets by 0.3 degrees and stretch them by 0.8 %. One
step of either moves the end of a sheet of A4 by a coarse pixel. [degrees; -]"""
SKEWED_DEG: Final = tuple(sign * 0.3 * step for step in range(5, 12) for sign in (1, -1))
"""Turns of sheets that were fed askew, searched for without a stretch, so that they are known for misprints."""
_WIDE_GRID: Final = (*product(WIDE_TURNS_DEG, WIDE_ALONG), *product(SKEWED_DEG, (0.0,)))
WIDE_STARTS: Final = 6
WIDE_FITS: Final = 4
"""Starts of the wide search that are tested, and coarse fits of each, since one fit stretches too little."""
RIVAL: Final = 0.7
"""Share of the greatest maximum at which another maximum is tested as well, since text and tables repeat."""
MOST_PEAKS: Final = 4
SURE: Final = 0.7
"""Share of agreeing tiles at which the search stops."""
UNSURE_PIXELS: Final = (1.2, 0.6)
"""Standard deviation of tiles' places in the two steps on them."""
TILE_SD_PIXELS: Final = 0.6
"""Standard deviation of a tile about the pose: warp and register of planes (worlds.toml, 0.3 to 0.6 pixels of
the prototype)."""
POSE_SD: Final = np.array([3.0, 3.0, 0.02, 1e-3, 1e-3])
"""Standard deviations of a weak prior of the pose about its start: what no edge determines stays. [mm,
radian, -]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """A pose and the tiles that agree with it."""

    pose: Pose
    agreeing: float
    """Share of the tiles seen that look like the design and lie where the pose has them. [-]"""
    tiles: int
    """Number of these."""

    def distance_pixels(self, other: Candidate, landmarks: Landmarks) -> float:
        """Return the greatest distance between the places that the two poses give to a corner of the page."""
        half_x, half_y = landmarks.page_width_mm / 2, landmarks.page_height_mm / 2
        x, y = np.array([-half_x, half_x, -half_x, half_x]), np.array([-half_y, -half_y, half_y, half_y])
        moves = [np.stack(each.pose.displacement_mm(x, y), axis=1) for each in (self, other)]
        return float(np.abs((moves[0] - moves[1]) / landmarks.pitch_mm).max())


def candidates(
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    *,
    lost: NDArray[np.bool_] | None = None,
    threads: int = 1,
) -> list[Candidate]:
    """Return the poses tested, best first; the search stops at the first that is beyond doubt.

    lost, threads: see ``measured``.
    """
    seen, design = seen_coarsely(landmarks, scan, lost), landmarks.coarse.picture
    # A scan that ends early must not seem to have an edge there.
    coarse = np.concatenate([seen, design[len(seen) :]])
    holed = None if lost is None else np.asarray(in_groups(lost, SHRINK, len(coarse)).any(axis=0))
    tried: list[Candidate] = []
    tried_on = partial(_tried, landmarks, partial(measured, landmarks, scan, lost=lost, threads=threads))
    for start in _starts(landmarks, coarse):
        if start is None:
            if tried and max(each.agreeing for each in tried) >= SURE:
                break
            continue
        tried.append(tried_on(refined(landmarks.coarse, coarse, start, holed=holed)))
        if tried[-1].agreeing < SURE:
            # Fine print beats with coarse pixels: refined on them, a pose may end a line of type away.
            tried.append(tried_on(start))
    return sorted(tried, key=lambda each: -each.agreeing)


def wide_candidates(
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    *,
    lost: NDArray[np.bool_] | None = None,
    threads: int = 1,
) -> list[Candidate]:
    """Return the poses tested over turns and stretches that no press makes but feeders do, best first.

    It costs many more searches, and is for pages that ``candidates`` does not place.
    lost, threads: see ``measured``.
    """
    seen, design = seen_coarsely(landmarks, scan, lost), landmarks.coarse.picture
    coarse = np.concatenate([seen, design[len(seen) :]])[: len(design)]
    starts = [
        pair
        for turn_deg, along in _WIDE_GRID
        for pair in _peaks(landmarks, coarse, FAR_MM, turn=float(np.deg2rad(turn_deg)), along=along)
    ]
    measure = partial(measured, landmarks, scan, lost=lost, threads=threads)
    tried: list[Candidate] = []
    for _, start in sorted(starts, key=lambda pair: -pair[0])[:WIDE_STARTS]:
        pose = start
        for _ in range(WIDE_FITS):
            pose = refined(landmarks.coarse, coarse, pose)
        tried += [_tried(landmarks, measure, one, wide=True) for one in (pose, start)]
        if tried[-1].agreeing >= SURE or tried[-2].agreeing >= SURE:
            break
    return sorted(tried, key=lambda each: -each.agreeing)


def seen_coarsely(
    landmarks: Landmarks, scan: NDArray[np.uint16], lost: NDArray[np.bool_] | None
) -> NDArray[np.float32]:
    """Return the scan's coarse picture, with the design where lines are missing: they must not seem to be edges.

    lost: (sensors, lines) missing lines.
    """
    seen, design = shrunk(scan, landmarks.sensors), landmarks.coarse.picture
    if lost is not None:
        rows = min(len(seen), len(design))
        holed = in_groups(lost, SHRINK, rows).any(axis=0)
        seen[:rows][holed] = design[:rows][holed]
    return seen


def _starts(landmarks: Landmarks, coarse: NDArray[np.float32]) -> Iterator[Pose | None]:
    """Yield starts, most likely first, and None wherever the search may stop if a candidate is good."""
    for reach_mm in (NEAR_MM, FAR_MM):
        yield from (start for _, start in _peaks(landmarks, coarse, reach_mm))
        yield None
    turned = [
        pair for turn in TURNS_DEG for pair in _peaks(landmarks, coarse, FAR_MM, turn=float(np.deg2rad(turn)))
    ]
    for _, start in sorted(turned, key=lambda pair: -pair[0])[:MOST_PEAKS]:
        yield start
        yield None


def _peaks(
    landmarks: Landmarks,
    coarse: NDArray[np.float32],
    reach_mm: float,
    *,
    turn: float = 0.0,
    along: float = 0.0,
) -> list[tuple[float, Pose]]:
    """Return height and pose of the greatest maximum of a page turned by ``turn``, and of its rivals.

    along: relative elongation of the page along the travel [-]
    """
    if along:
        rows, columns = landmarks.coarse.picture.shape
        longer = np.array([[1, 0, 0], [0, 1 / (1 + along), (rows - 1) / 2 * along / (1 + along)]])
        coarse = cv2.warpAffine(coarse, longer, coarse.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    if turn:
        rows, columns = landmarks.coarse.picture.shape
        matrix = cv2.getRotationMatrix2D(((columns - 1) / 2, (rows - 1) / 2), float(np.rad2deg(turn)), 1.0)
        coarse = cv2.warpAffine(coarse, matrix, coarse.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    maxima = peaks(landmarks.coarse, coarse, reach_mm=reach_mm, turn=turn, most=MOST_PEAKS)
    best = [pair for pair in maxima if pair[0] >= RIVAL * maxima[0][0]] or [(0.0, Pose(turn=turn))]
    return [(height, replace(pose, along=along)) for height, pose in best] if along else best


def _tried(
    landmarks: Landmarks, measure: Callable[..., TileMoves], pose: Pose, *, wide: bool = False
) -> Candidate:
    """Return the pose after two steps on tiles, and the tiles that agree.

    wide: the start's stretch is one that was searched for, from which the pose does not go back to none.
    """
    tiles = spread(landmarks.lines.size, FIRST_TILES)
    if not landmarks.lines.size:
        return Candidate(pose=pose, agreeing=0.0, tiles=0)
    begin = pose if wide else Pose(x_mm=pose.x_mm, y_mm=pose.y_mm, turn=pose.turn)
    for unsure in UNSURE_PIXELS:
        moves = landmarks.moves(pose, tiles)
        tile_moves = measure(tiles, moves, unsure_pixels=unsure)
        further = pose.numbers - begin.numbers
        step, agreeing = _pose_step(landmarks, tiles, tile_moves, further)
        pose = pose.moved(step)
    return Candidate(
        pose=pose, agreeing=float(agreeing.sum() / max(tile_moves.seen.sum(), 1)), tiles=int(agreeing.sum())
    )


def spread(count: int, most: int) -> NDArray[np.int64]:
    """Return at most ``most`` of the numbers below ``count``, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(np.int64))


def _pose_step(
    landmarks: Landmarks, tiles: NDArray[np.int64], tile_moves: TileMoves, further: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the step of the pose (5,) by robust least squares (Cauchy weights), and which tiles agree (n,).

    further: (5,) by how much the pose has moved from its start.
    """
    pitch = landmarks.pitch_mm
    model = slopes(*landmarks.basis.points_mm[tiles].T)
    moves = tile_moves.moves * pitch
    covariance = np.linalg.inv(tile_moves.precision + np.eye(2) * 1e-6) + TILE_SD_PIXELS**2 * np.eye(2)
    precision = np.linalg.inv(covariance * np.outer(pitch, pitch))
    weight = tile_moves.good.astype(np.float64)
    for _ in range(4):
        weighted = precision * weight[:, None, None]
        pulls = np.einsum("anj,nab->nbj", model, weighted)
        normal = np.einsum("nbj,bnk->jk", pulls, model) + np.diag(1 / POSE_SD**2)
        step = np.linalg.solve(normal, np.einsum("nbj,nb->j", pulls, moves) - further / POSE_SD**2)
        left = moves - np.einsum("anj,j->na", model, step)
        far2 = np.einsum("na,nab,nb->n", left, precision, left)
        weight = tile_moves.good / (1 + far2 / 4)
    return step, tile_moves.good & (far2 < 9)
