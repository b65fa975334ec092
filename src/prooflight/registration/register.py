"""Registration of a page in its scan to a fraction of a pixel, with its uncertainty, or the reason why it failed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.kernels.registration.solving import MOST_GAIN_SD
from prooflight.registration.field import Field, Prior, fitted, trust
from prooflight.registration.foreign import coarse_inside, detail, foreign_print
from prooflight.registration.landmarks import Landmarks, prepare
from prooflight.registration.search import candidates, seen_coarsely, spread, wide_candidates
from prooflight.registration.tiles import TileMoves, measured
from prooflight.scans.placement import IN_PLACE, Placement, Warp

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.registration.pose import Pose
    from prooflight.registration.search import Candidate

__all__ = ["Landmarks", "Prior", "Registration", "prepare", "register"]

NODE_PITCH_MM: Final = 6.0
"""Pitch of the nodes of the estimated warp: a field smooth over 25 mm is linear between them to 0.01
pixels."""
ROUGH: Final = 0.1
"""Waves with less than this share are left out until the last fit."""
FIELD_TILES: Final = 120
"""Number of tiles of the first field; it is smooth over 25 mm, and these lie 23 mm apart on A4."""
UNSURE_PIXELS: Final = (0.6, 0.2, 0.1)
"""Standard deviation of tiles' places at the pose of the search, at the first field and at the field of all
tiles."""
AGAIN_PIXELS: Final = 0.2
"""Distance of a tile from where it was rendered above which it is measured again: one linear step leaves a
tenth."""
PRESENT: Final = 0.4
"""Share of its contrast above which an ink plane counts as printed."""
PRESENCE_SD: Final = (0.2, 0.1)
"""Standard deviations of a tile's contrast given its inks' presence, and of a plane's presence a priori.
[-]"""
LEAST_TILES: Final = 8
LEAST_PART: Final = 0.5
"""Ink in units of tiles below which a page counts as blank."""
LEAST_SHARE: Final = 0.05
"""Least share of a tile's edges that lets planes make up for others."""
SHARED: Final = 0.2
"""Share of a tile's edges made by planes other than its main one, above which planes share its edges."""
SD_TILES: Final = 12
"""Number of tiles whose standard deviations stand for all."""
LEAST_AGREEING: Final = 0.15
"""Share of tiles that must agree: a page whose content is missing altogether still has its own edges."""
RIVAL: Final = 0.9
"""Share of the best candidate's agreement at which a second place makes the page ambiguous."""
RIVAL_DISTANCE_PIXELS: Final = 4.0
"""Distance at a corner above which two candidates are different places; closer ones are one place with a
warp."""
MOST_RMS_PIXELS: Final = 0.2
"""Greatest rms residual of tiles (0.02 to 0.1 on good prints); tiles that only look alike scatter more."""
MATCHING, MATCHING_RMS_PIXELS = 0.9, 0.4
"""Share of the tiles seen that look like the design from which this is that greatest residual: such tiles are the
page's own, and scatter by up to 0.25 pixels where planes share most edges (lines of orange on rich black, printed by
another RIP). assumed: twice the other, still far below the three pixels within which tiles are measured."""
MOST_SD_PIXELS: Final = 0.33
"""Standard deviation of the print's shift above which it counts as lost: three make a pixel."""
DOUBTFUL: Final = 0.3
"""Share of the print's tiles that match below which the scan is tested for showing another page."""
PRINTED: Final = 0.5
"""Share of a tile's edges made by inks above which it belongs to the print, not to the sheet."""
FOREIGN_PRINT, FOREIGN_PAGE, FOREIGN_WIDTH = 0.55, 0.08, 0.3
"""Least foreign shares of the print, of the page and of its width for a scan to show another page."""
TURNED_PRINT: Final = 0.6
"""Ratio of foreign print, turned by 180 degrees to upright, below which the scan shows this page turned."""
WRONG_SHIFT_MM: Final = 1.8
WRONG_SKEW_DEG: Final = 0.3
"""Shift and skew at which a page is a misprint (worlds.toml)."""
TOO_LITTLE: Final = "too little is printed to locate the page"
IN_PARTS: Final = "parts of the page are at different positions"
REPEATS: Final = "the content of the page repeats: it fits at several positions"
WIDE_TURN_DEG, WIDE_STRETCH_PERCENT = 1.0, 1.0
"""Standard deviations of turn and stretch in the wide search, in which a sheet may lie as office feeders lay it."""
LEAST_WIDE: Final = 0.6
"""Share of the print's tiles that must match for a place of the wide search: assumed, twice ``DOUBTFUL``, since more
places are tried."""
LEAST_PRINT: Final = 0.5
"""Share of the design's detail above which a scan shows print that has to lie somewhere; less is a blank sheet, or
one that lacks its ink. assumed: midway between none and all."""
SURE: Final = 3.0
"""Number of standard deviations of its place by which a page must lie beyond these."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedTiles:
    """Measured tiles of a scan, from which the page can be placed again once its planes' register is known."""

    landmarks: Landmarks
    pose: Pose
    """Pose about which displacements are small."""
    off_mm: NDArray[np.float64]
    """Displacement of each tile to the right and down of where the pose has it, (tiles, 2)."""
    precision: NDArray[np.float64]
    """Precision of these, (tiles, 2, 2). [1/mm^2]"""
    weight: NDArray[np.float64]
    """Weight of each tile, (tiles,)."""
    shares: NDArray[np.float64]
    """Shares of inks in the tiles' edges across and along, (tiles, 2, 4)."""
    waves_root: NDArray[np.float64] | None = None
    """``Field.root`` of the fit of these tiles with other planes given."""
    roots: dict[bytes, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    """``Field.root`` by the planes that are given: it does not depend on where they are."""

    def placed(
        self, planes_mm: NDArray[np.float64], given: NDArray[np.bool_]
    ) -> tuple[Placement, NDArray[np.float64]]:
        """Return where the print lies given the register of some planes, and the planes' displacements within it.

        A tile lies where its own planes do, so a tile of black rules implies another place of the page than
        one of a title in colour.

        Parameters
        ----------
        planes_mm : (4, 2) displacements of the planes [mm]
        given : (4,) which of them are given

        Returns
        -------
        placement : of the print
        planes_mm : (4, 2) displacements of all planes within it [mm]
        """
        field, of_print = self._field(planes_mm, given)
        placement = _placement(self.landmarks, self.pose.moved(field.step), field, of_print)
        return placement, np.where(given[:, None], planes_mm, field.planes_mm - of_print)

    def cost(self, planes_mm: NDArray[np.float64], given: NDArray[np.bool_]) -> float:
        """Return minus the logarithm of the tiles' likelihood times the page's prior, with planes at these places."""
        return self._field(planes_mm, given)[0].cost(self.precision)

    def _field(
        self, planes_mm: NDArray[np.float64], given: NDArray[np.bool_]
    ) -> tuple[Field, NDArray[np.float64]]:
        """Return the field, and how far the print lies off its sheet, (2,) [mm]."""
        every, first = np.arange(len(self.off_mm)), int(np.argmax(given))
        off = self.off_mm - np.einsum("nap,pa->na", self.shares * given, planes_mm)
        shares = np.where(given, 0.0, self.shares)
        shares[..., first] = (self.shares * given).sum(axis=2)  # what they have in common
        fit = fitted(
            self.landmarks.basis,
            every,
            off,
            self.precision,
            shares,
            pose=self.pose,
            weight=self.weight,
            root=self.roots.get(given.tobytes()),
            waves_root=self.waves_root,
        )
        self.roots[given.tobytes()] = fit.root
        return fit, fit.planes_mm[first]

    def corrected(self, by_mm: NDArray[np.float64]) -> PlacedTiles:
        """Return the tiles with those whose planes share edges moved right and down by (2,) [mm].

        The shares by which planes add up to a tile's place are only valid for edges that each plane makes by
        itself.
        """
        by_plane = self.shares.sum(axis=1)
        others = by_plane.sum(axis=1) - by_plane.max(axis=1)
        shared = others > SHARED * np.maximum(by_plane.sum(axis=1), LEAST_SHARE)
        return replace(self, off_mm=self.off_mm + np.outer(shared, by_mm))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Registration:
    """Placement of a page and its uncertainty."""

    placement: Placement
    """Placement of the print, as prediction needs it: a mean of the planes, weighted by their edges on this
    page."""
    located: bool
    """Whether the placement is reliable; if not, it is the best guess or the nominal place."""
    reason: str = ""
    """Why it is not; empty if it is."""
    planes_mm: NDArray[np.float64]
    """Displacement of each ink plane to the right and down within the print, (4, 2); 0 where unknown."""
    plane_parts: NDArray[np.float64]
    """Weight of each plane in the placement across and along, (2, 4): they add up to 1, or are 0 if only the
    sheet shows."""
    sheet_mm: tuple[float, float] = (0.0, 0.0)
    """Displacement of the sheet's own edges to the right and down of the print."""
    shift_sd_mm: tuple[float, float] = (np.inf, np.inf)
    """Standard deviation of the print's place at its tiles, rms (x, y). [mm]"""
    skew_sd_deg: float = np.inf
    tiles: PlacedTiles | None = None
    """Tiles that determined the placement; None if the search failed."""
    tiles_used: int = 0
    tiles_matching: float = 0.0
    """Share of the tiles seen that look like the design. [-]"""
    print_matching: float = 0.0
    """Share of the print's tiles seen, without the sheet's edges, that look like the design; 0 if it has
    none. [-]"""
    tiles_foreign: float = 0.0
    """Share of the tiles seen that show something else. [-]"""
    residual_rms_pixels: float = np.inf
    """Residual of the tiles used about the placement and the planes, rms weighted by tiles' precision. [pixels]"""
    foreign: bool = False
    """Whether the scan shows print all over that the design does not predict: another page's."""
    turned: bool = False
    """Whether that is this page turned by 180 degrees."""

    print_seen: float = 1.0
    """Detail of the scan's print as a share of the design's, wherever it lies; 1 unless the page was in doubt. [-]"""

    @property
    def unplaced(self) -> bool:
        """Whether the scan has print that seems this page's, and it is not known where: no page to be judged.

        A page of which little is printed is judged in its nominal place, and so is a scan that lacks its print. Where
        parts of the page lie apart they were found: planes far out of register do that, and are a misprint.
        """
        has_position = self.located or self.foreign or self.reason in (TOO_LITTLE, IN_PARTS)
        return not has_position and self.print_seen >= LEAST_PRINT

    @property
    def off_place(self) -> bool:
        """Whether the page certainly lies where no good print does: the misprint ``wrong-page``."""
        far = any(
            abs(shift) - SURE * sd >= WRONG_SHIFT_MM
            for shift, sd in zip(self.placement.shift_mm, self.shift_sd_mm, strict=True)
        )
        turned = abs(self.placement.skew_deg) - SURE * self.skew_sd_deg >= WRONG_SKEW_DEG
        return self.located and (far or turned)


def register(
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    *,
    lost: NDArray[np.bool_] | None = None,
    threads: int = 1,
) -> Registration:
    """Find the page of ``landmarks`` in a scan.

    A coarse search, then a pose from some tiles, then pose, register of planes and smooth field together from
    all tiles. An ink plane that is not printed does not count in the print's place.

    Parameters
    ----------
    scan : (sensors, lines, pixels) [DN]
    lost : (sensors, lines) missing lines, which are left out; None if none is missing
    threads : number of threads that measure tiles
    """
    where = _placed(landmarks, scan, lost, threads)
    if where.located and where.print_matching >= DOUBTFUL:
        return where
    where = _recognised(where, landmarks, seen_coarsely(landmarks, scan, lost))
    # A wider search of a page that repeats itself finds one of its periods and cannot tell which.
    if where.located or where.reason in (TOO_LITTLE, REPEATS) or where.print_seen < LEAST_PRINT:
        return where
    basis = landmarks.basis.loosened(turn_deg=WIDE_TURN_DEG, stretch_percent=WIDE_STRETCH_PERCENT)
    wide = _placed(replace(landmarks, basis=basis), scan, lost, threads, search=wide_candidates)
    return wide if wide.located and wide.print_matching >= LEAST_WIDE else where


def _placed(
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    lost: NDArray[np.bool_] | None,
    threads: int,
    *,
    search: Callable[..., list[Candidate]] = candidates,
) -> Registration:
    tried = search(landmarks, scan, lost=lost, threads=threads)
    best = tried[0]
    reason = _doubt(tried, landmarks)
    if best.tiles < LEAST_TILES:
        none = np.zeros((4, 2))
        return Registration(
            placement=IN_PLACE, located=False, reason=reason, planes_mm=none, plane_parts=none.T
        )
    measure = partial(measured, landmarks, scan, lost=lost, threads=threads)
    return _fielded(landmarks, measure, best.pose, reason)


def _recognised(where: Registration, landmarks: Landmarks, seen: NDArray[np.float32]) -> Registration:
    """Return the registration, marked if the scan's coarse picture shows another page."""
    design = landmarks.coarse.picture
    if landmarks.ignored is not None:  # nothing is known of these pixels, so they must not look foreign
        rows = min(len(seen), len(design))
        seen[:rows] = np.where(landmarks.ignored[:rows], design[:rows], seen[:rows])
    inside = coarse_inside(landmarks.geometry, landmarks.page_width_mm, landmarks.page_height_mm)
    where = replace(where, print_seen=_print_seen(seen, design, inside))
    foreign = foreign_print(seen, design, inside)
    if (np.array(foreign) < (FOREIGN_PRINT, FOREIGN_PAGE, FOREIGN_WIDTH)).any():
        return where
    turned = foreign_print(seen[: len(design)][::-1, ::-1], design, inside)
    return replace(where, foreign=True, turned=turned.of_print < TURNED_PRINT * foreign.of_print)


def _print_seen(seen: NDArray[np.float32], design: NDArray[np.float32], inside: tuple[slice, slice]) -> float:
    """Return the detail of a scan's print, wherever it lies, as a share (rms) of that of its design. [-]"""
    rows = min(len(seen), len(design))
    there, due = (float((detail(one[:rows])[inside] ** 2).sum()) for one in (seen, design))
    return float(np.sqrt(there / due)) if due else 0.0


def _doubt(tried: list[Candidate], landmarks: Landmarks) -> str:
    """Return why the best candidate is not reliable; empty if it is."""
    best = tried[0]
    if best.tiles < LEAST_TILES or best.agreeing < LEAST_AGREEING:
        return f"{best.agreeing:.0%} of the expected content is present, and not at one position"
    for other in tried[1:]:
        if (
            other.agreeing >= RIVAL * best.agreeing
            and best.distance_pixels(other, landmarks) > RIVAL_DISTANCE_PIXELS
        ):
            return REPEATS
    return ""


def _fielded(
    landmarks: Landmarks, measure: Callable[..., TileMoves], pose: Pose, reason: str
) -> Registration:
    pitch, basis, shares = landmarks.pitch_mm, landmarks.basis, landmarks.shares

    def measured_within_reach(
        tiles: NDArray[np.intp], places: NDArray[np.float64], unsure_pixels: float
    ) -> TileMoves:
        return measure(tiles, places, unsure_pixels=unsure_pixels).within_reach()

    every = np.arange(landmarks.lines.size)

    def fit(
        tiles: NDArray[np.intp], tile_moves: TileMoves, places: NDArray[np.float64], **how: Any
    ) -> tuple[Field, Pose, NDArray[np.float64]]:
        """Return the field, the pose it moves to, and the places of all tiles by both. [mm]"""
        off = places - landmarks.moves(pose, tiles) * pitch
        precision = tile_moves.precision / np.outer(pitch, pitch)
        field = fitted(basis, tiles, off, precision, shares[tiles], pose=pose, **how)
        moved = pose.moved(field.step)
        return field, moved, landmarks.moves(moved, every) * pitch + field.moves_mm(shares)

    some = spread(every.size, FIELD_TILES)
    start = landmarks.moves(pose, some)
    tile_moves = measured_within_reach(some, start, UNSURE_PIXELS[0])
    _, pose, now = fit(some, tile_moves, (start + tile_moves.moves) * pitch, negligible=ROUGH)
    tile_moves = measured_within_reach(every, now / pitch, UNSURE_PIXELS[1])
    shares = printed_shares(landmarks.shares, tile_moves)
    places = now + tile_moves.moves * pitch
    _, pose, better = fit(every, tile_moves, places, negligible=ROUGH)
    again = np.flatnonzero((np.abs((better - now) / pitch) > AGAIN_PIXELS).any(axis=1) & tile_moves.seen)
    if again.size:
        more = measured_within_reach(again, better[again] / pitch, UNSURE_PIXELS[2])
        tile_moves.put(again, more)
        places[again] = better[again] + more.moves * pitch
    precision = tile_moves.precision / np.outer(pitch, pitch)
    weight = trust(places - better, precision)
    field, pose, _ = fit(every, tile_moves, places, weight=weight)
    off = places - landmarks.moves(pose, every) * pitch
    tiles = PlacedTiles(
        landmarks=landmarks,
        pose=pose,
        off_mm=off,
        precision=precision,
        weight=weight,
        shares=shares,
        waves_root=field.root,
    )
    return replace(_registration(landmarks, shares, pose, field, tile_moves, reason), tiles=tiles)


def printed_shares(shares: NDArray[np.float64], tile_moves: TileMoves) -> NDArray[np.float64]:
    """Return ``shares`` (tiles, 2, 4) without the planes that are not printed; a tile's other planes make up for them.

    A tile's contrast is modelled as the presence of its planes and of the page's own edge, weighted by their
    shares.
    """
    informative = tile_moves.seen & (tile_moves.gain_sd < MOST_GAIN_SD)
    edge = 1 - shares.sum(axis=2, keepdims=True)
    model, (tile_sd, plane_sd) = np.concatenate([shares, edge], axis=2).mean(axis=1)[informative], PRESENCE_SD
    off = tile_moves.gain[informative] - model.sum(axis=1)
    weight = np.ones(off.size)
    for _ in range(4):
        weighted = model * weight[:, None]
        less = np.linalg.solve(model.T @ weighted + np.eye(5) * (tile_sd / plane_sd) ** 2, weighted.T @ off)
        weight = 1 / (1 + ((off - model @ less) / tile_sd) ** 2)
    printed = shares * (1 + less[:4] > PRESENT)
    return np.asarray(
        printed * (shares.sum(axis=2) / np.maximum(printed.sum(axis=2), LEAST_SHARE))[..., None]
    )


def _registration(
    landmarks: Landmarks,
    shares: NDArray[np.float64],
    pose: Pose,
    field: Field,
    tile_moves: TileMoves,
    reason: str,
) -> Registration:
    pitch = landmarks.pitch_mm
    seen, good = tile_moves.seen & ~landmarks.mixed, tile_moves.good & ~landmarks.mixed
    used = good & (field.weight > 0.5)
    part = shares[used].sum(axis=0)
    part /= np.maximum(part.sum(axis=1, keepdims=True), LEAST_PART)
    of_print = np.einsum("ap,pa->a", part, field.planes_mm)
    clear = np.flatnonzero(~landmarks.mixed) if not landmarks.mixed.all() else np.arange(len(shares))
    some = clear[spread(clear.size, SD_TILES)]
    sd = np.sqrt(np.mean(field.sd_mm(some, shares[some]) ** 2, axis=0))
    # Whether this is the page at all is asked of every tile; how well it is placed, of those that can say.
    of_inks = tile_moves.seen & (landmarks.shares.sum(axis=2).max(axis=1) >= PRINTED)
    # By the whole precision: a tile of slanted lines does not say where along them it lies.
    precision, left = tile_moves.precision[used], field.left_mm[used] / pitch
    far2, information = np.einsum("ni,nij,nj->", left, precision, left), np.einsum("nii->", precision)
    rms = float(np.sqrt(max(far2, 0.0) / max(information, 1e-9)))
    matching = float(good.sum() / max(int(seen.sum()), 1))
    most_rms = MATCHING_RMS_PIXELS if matching >= MATCHING else MOST_RMS_PIXELS
    if not reason and (used.sum() < max(LEAST_TILES, good.sum() / 2) or rms > most_rms):
        reason = IN_PARTS
    if not reason and (sd / pitch).max() > MOST_SD_PIXELS:
        reason = TOO_LITTLE
    return Registration(
        placement=_placement(landmarks, pose, field, of_print),
        located=not reason,
        reason=reason,
        planes_mm=np.where(part.T > 0.01, field.planes_mm - of_print, 0.0),
        plane_parts=part,
        sheet_mm=(-float(of_print[0]), -float(of_print[1])),
        shift_sd_mm=(float(sd[0]), float(sd[1])),
        skew_sd_deg=float(np.rad2deg(field.turn_sd())),
        tiles_used=int(used.sum()),
        tiles_matching=matching,
        print_matching=float((tile_moves.good & of_inks).sum() / max(int(of_inks.sum()), 1)),
        tiles_foreign=float(tile_moves.foreign.sum() / max(int(seen.sum()), 1)),
        residual_rms_pixels=rms,
    )


def _placement(landmarks: Landmarks, pose: Pose, field: Field, of_print: NDArray[np.float64]) -> Placement:
    """Return the print's placement from pose and field, the field on nodes over the shifted page.

    The displacement of the nodes by turn and stretch is neglected: 2.6 mm at a corner of A4 turned by a
    degree, 0.04 pixels.
    """
    width, height = landmarks.page_width_mm, landmarks.page_height_mm
    columns, rows = (int(np.ceil(extent / NODE_PITCH_MM)) + 1 for extent in (width, height))
    nodes = field.warp_mm(
        np.arange(columns) * NODE_PITCH_MM - width / 2, np.arange(rows) * NODE_PITCH_MM - height / 2
    )
    return Placement(
        shift_mm=(pose.x_mm + float(of_print[0]), pose.y_mm + float(of_print[1])),
        skew_deg=float(np.rad2deg(pose.turn)),
        stretch_percent=(100 * pose.across, 100 * pose.along),
        warp=Warp(nodes_mm=nodes.astype(np.float32), pitch_mm=NODE_PITCH_MM, first_mm=(pose.x_mm, pose.y_mm)),
    )
