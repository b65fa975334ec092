"""Where a page lies under the camera, from its scan: to a fraction of a pixel, with its uncertainty, or not at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.acquiring.placement import IN_PLACE, Placement, Warp
from prooflight.comparing.registering.field import Field, Prior, fitted
from prooflight.comparing.registering.landmarks import Landmarks, prepare
from prooflight.comparing.registering.search import candidates
from prooflight.comparing.registering.tiles import TileMoves, measured

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.comparing.registering.pose import Pose
    from prooflight.comparing.registering.search import Candidate

__all__ = ["Landmarks", "Prior", "Registration", "prepare", "register"]

NODE_PITCH_MM: Final = 6.0
"""Between nodes of the warp found: a field smooth over 25 mm is linear between them to 0.01 pixels."""
STEPS: Final = ((0.6, 0.1, 2), (0.3, 0.01, 1), (0.1, 0.01, 2))
"""The three steps of the field: how far off tiles may lie [pixels], which waves are negligible, rounds of weighing."""
SHIFT_SD_MM: Final = 1.0
"""Of the pose's last steps: no bound."""
LEAST_TILES: Final = 8
LEAST_PART: Final = 0.5
"""Tiles' worth of ink below which a page counts as blank."""
LEAST_AGREEING: Final = 0.15
"""Share of tiles that must agree: a page whose content is missing altogether still has its own edges."""
RIVAL: Final = 0.9
"""A second place with so much of the agreement makes the page ambiguous."""
RIVAL_APART_PIXELS: Final = 4.0
"""At a corner; closer ones are one place, seen through a warp."""
MOST_RMS_PIXELS: Final = 0.2
"""Of tiles about the page found (0.02 to 0.1 on good prints); tiles that only look alike scatter more."""
MOST_SD_PIXELS: Final = 0.33
"""Standard deviation of the print's shift from which it counts as lost: three make a pixel."""
WRONG_SHIFT_MM: Final = 1.8
WRONG_SKEW_DEG: Final = 0.3
"""worlds.toml: a page this far off is a misprint."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Registration:
    """Where a page lies, and how well that is known."""

    placement: Placement
    """Where the print lies: what prediction needs. Of the planes together, as their edges count on this page."""
    found: bool
    """Whether the placement may be relied on; if not it is the best guess, or the page's place."""
    reason: str = ""
    """Why not; empty if found."""
    planes_mm: NDArray[np.float64]
    """(4, 2) how far each ink plane lies too far right and down within the print; 0 where nothing tells."""
    plane_parts: NDArray[np.float64]
    """(2, 4) how much each plane counts in the placement across and along: 1 together, 0 if only the sheet shows."""
    sheet_mm: tuple[float, float] = (0.0, 0.0)
    """How far the sheet's own edges lie too far right and down of the print."""
    shift_sd_mm: tuple[float, float] = (np.inf, np.inf)
    """Standard deviation of the print's place at its tiles, rms (x, y). [mm]"""
    skew_sd_deg: float = np.inf
    tiles_used: int = 0
    tiles_matching: float = 0.0
    """Share of the tiles seen that look like the design. [-]"""
    tiles_foreign: float = 0.0
    """Share of the tiles seen that show something else. [-]"""
    residual_rms_pixels: float = np.inf
    """Of the tiles used about the placement and the planes, rms of x and y. [pixels]"""

    @property
    def off_place(self) -> bool:
        """Whether the page was found where no good print lies: the misprint ``wrong-page``."""
        far = max(abs(shift) for shift in self.placement.shift_mm) >= WRONG_SHIFT_MM
        return self.found and (far or abs(self.placement.skew_deg) >= WRONG_SKEW_DEG)


def register(landmarks: Landmarks, scan: NDArray[np.uint16], *, prior: Prior | None = None) -> Registration:
    """Find the page of ``landmarks`` in a scan (sensors, lines, pixels) [DN].

    A coarse search, a pose from some tiles, then pose, register of planes and smooth field together from all tiles.
    """
    tried = candidates(landmarks, scan)
    best = tried[0]
    reason = _doubt(tried, landmarks)
    if best.tiles < LEAST_TILES:
        none = np.zeros((4, 2))
        return Registration(
            placement=IN_PLACE, found=False, reason=reason, planes_mm=none, plane_parts=none.T
        )
    return _fielded(landmarks, scan, best.pose, prior or Prior(), reason)


def _doubt(tried: list[Candidate], landmarks: Landmarks) -> str:
    """Why the best candidate may not be believed; empty if it may."""
    best = tried[0]
    if best.tiles < LEAST_TILES or best.agreeing < LEAST_AGREEING:
        return f"{best.agreeing:.0%} of what should be there is, and in no one place"
    for other in tried[1:]:
        if (
            other.agreeing >= RIVAL * best.agreeing
            and best.apart_pixels(other, landmarks) > RIVAL_APART_PIXELS
        ):
            return "the page repeats itself: it may lie in several places"
    return ""


def _fielded(
    landmarks: Landmarks, scan: NDArray[np.uint16], pose: Pose, prior: Prior, reason: str
) -> Registration:
    tiles = np.arange(landmarks.lines.size)
    pitch, points = landmarks.pitch_mm, landmarks.from_centre_mm
    found: Field | None = None
    for unsure, negligible, rounds in STEPS:
        base = landmarks.moves(pose, tiles) * pitch
        now = base if found is None else base + found.moves_mm(points + base, landmarks.shares)
        said = measured(landmarks, scan, tiles, now / pitch, unsure_pixels=unsure)
        found = fitted(
            points + base,
            now + said.moves * pitch - base,
            said.precision / np.outer(pitch, pitch),
            landmarks.shares,
            page_width_mm=landmarks.page_width_mm,
            page_height_mm=landmarks.page_height_mm,
            prior=prior,
            shift_sd_mm=SHIFT_SD_MM,
            negligible=negligible,
            rounds=rounds,
        )
        pose = pose.moved(found.step)
    assert found is not None
    return _registration(landmarks, pose, found, said, reason)


def _registration(
    landmarks: Landmarks, pose: Pose, field: Field, said: TileMoves, reason: str
) -> Registration:
    pitch = landmarks.pitch_mm
    used = said.good & (field.weight > 0.5)
    part = landmarks.shares[used].sum(axis=0)
    part /= np.maximum(part.sum(axis=1, keepdims=True), LEAST_PART)
    of_print = np.einsum("ap,pa->a", part, field.planes_mm)
    x, y = landmarks.from_centre_mm[::7].T
    sd = np.sqrt(np.mean(field.sd_mm(x, y, landmarks.shares[::7]) ** 2, axis=0))
    seen = max(int(said.seen.sum()), 1)
    weight = said.precision[used][:, [0, 1], [0, 1]]
    left2 = (field.left_mm[used] / pitch) ** 2
    rms = float(np.sqrt((weight * left2).sum() / max(weight.sum(), 1e-9)))
    if not reason and (used.sum() < max(LEAST_TILES, said.good.sum() / 2) or rms > MOST_RMS_PIXELS):
        reason = "parts of the page lie in different places"
    if not reason and (sd / pitch).max() > MOST_SD_PIXELS:
        reason = "too little is printed to tell where"
    return Registration(
        placement=_placement(landmarks, pose, field, of_print),
        found=not reason,
        reason=reason,
        planes_mm=np.where(part.T > 0.01, field.planes_mm - of_print, 0.0),
        plane_parts=part,
        sheet_mm=(-float(of_print[0]), -float(of_print[1])),
        shift_sd_mm=(float(sd[0]), float(sd[1])),
        skew_sd_deg=float(np.rad2deg(field.turn_sd())),
        tiles_used=int(used.sum()),
        tiles_matching=float(said.good.sum() / seen),
        tiles_foreign=float(said.foreign.sum() / seen),
        residual_rms_pixels=rms,
    )


def _placement(landmarks: Landmarks, pose: Pose, field: Field, of_print: NDArray[np.float64]) -> Placement:
    """Pose and field of the print, the field on nodes over the page."""
    width, height = landmarks.page_width_mm, landmarks.page_height_mm
    columns, rows = (int(np.ceil(extent / NODE_PITCH_MM)) + 1 for extent in (width, height))
    x, y = np.meshgrid(
        np.arange(columns) * NODE_PITCH_MM - width / 2, np.arange(rows) * NODE_PITCH_MM - height / 2
    )
    nodes = field.warp_mm(x.ravel(), y.ravel()).reshape(rows, columns, 2)
    return Placement(
        shift_mm=(pose.x_mm + float(of_print[0]), pose.y_mm + float(of_print[1])),
        skew_deg=float(np.rad2deg(pose.turn)),
        stretch_percent=(100 * pose.across, 100 * pose.along),
        warp=Warp(nodes_mm=nodes.astype(np.float32), pitch_mm=NODE_PITCH_MM),
    )
