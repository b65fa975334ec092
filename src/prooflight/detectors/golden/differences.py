"""Differences of a scan from a golden one, beyond displaced edges and changed levels; no raster is needed.

Several good scans of one page make one golden: the mean of each pixel, and how much it differs between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.golden.place import TILE_PIXELS, GoldenPlace, place, residual_pixels
from prooflight.errors import ScanError

BLOCK_PIXELS: Final = 16
PRIOR_SD: Final = 0.03
"""Prior standard deviation of each term's coefficient: two good prints differ by 1 to 2 % of ink and lamp
(worlds.toml). [contrast]"""
BLOCK_SD: Final = 0.01
"""Standard deviation of a block's mean about the smooth difference (cloudiness of paper, halftone).
[contrast]"""
MOST: Final = 0.05
"""Limit of the correction: a page whose density is 7 % off is a misprint (worlds.toml). [contrast]"""
WAVES: Final = 4
"""Number of cosines across the page, for the lamp."""
BUSY: Final = 0.1
"""Variation within the edge tolerance at which a block has half the weight. [contrast]"""
TONES: Final = 8
"""Number of steps of lightness that have equal weight, however little of the page has them."""
LEAST_BLOCKS: Final = 30
MOST_BLOCKS: Final = 4000


def level_difference(
    golden: NDArray[np.float32], scan: NDArray[np.float32], varying: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the correction of ``golden`` (lines, pixels) [contrast].

    varying: its variation around each pixel.

    It is a robust least-squares fit (Cauchy weights) to blocks of 16 x 16 pixels: a plane, waves across the
    page, tone, and tone by place; at most 5 %.
    """
    lines, pixels = golden.shape
    rows, columns = lines // BLOCK_PIXELS, pixels // BLOCK_PIXELS
    if rows * columns < LEAST_BLOCKS:
        return np.zeros_like(golden)
    chosen = np.arange(rows * columns)[:: max(1, rows * columns // MOST_BLOCKS)]
    tone, off, busy = (_blocks(image, rows, columns)[chosen] for image in (golden, scan - golden, varying))
    across = ((chosen % columns) + 0.5) * BLOCK_PIXELS / pixels
    along = ((chosen // columns) + 0.5) * BLOCK_PIXELS / lines
    model = np.stack(_terms(across, along, tone), axis=1)
    step = np.clip((tone * TONES).astype(np.intp), 0, TONES - 1)
    base_weight = 1 / (1 + (busy / BUSY) ** 2)
    of_step = np.bincount(step, base_weight, TONES)
    base_weight *= base_weight.sum() / TONES / np.maximum(of_step, LEAST_BLOCKS)[step]
    weight = base_weight
    for _ in range(8):
        weighted = model * (weight / BLOCK_SD**2)[:, None]
        normal = weighted.T @ model + np.eye(model.shape[1]) / PRIOR_SD**2
        coefficients = np.linalg.solve(normal, weighted.T @ off)
        weight = base_weight / (1 + ((off - model @ coefficients) / BLOCK_SD) ** 2)
    x = ((np.arange(pixels, dtype=np.float32) + 0.5) / pixels)[None, :]
    y = ((np.arange(lines, dtype=np.float32) + 0.5) / lines)[:, None]
    total = np.zeros_like(golden)
    for coefficient, term in zip(coefficients, _terms(x, y, golden), strict=True):
        total += np.float32(coefficient) * term.astype(np.float32)
    return np.clip(total, -MOST, MOST)


def _blocks(image: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float64]:
    """Return means of blocks, (rows * columns,)."""
    whole = image[: rows * BLOCK_PIXELS, : columns * BLOCK_PIXELS]
    return cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA).ravel().astype(np.float64)


def _terms(
    across: NDArray[np.floating], along: NDArray[np.floating], tone: NDArray[np.floating]
) -> list[NDArray[np.floating]]:
    """Return the terms of the fit at places (0..1 of the page) and tones (0 dark, 1 light)."""
    ink = 1 - tone
    waves = [np.cos(np.pi * wave * across) for wave in range(1, WAVES + 1)]
    tones = [ink, ink**2, ink**3]
    return [np.ones_like(across), along - 0.5, *waves, *tones, ink * (across - 0.5), ink * (along - 0.5)]


__all__ = ["GoldenDifference", "GoldenPlace", "Tolerance", "compare", "contrast_range", "in_contrasts"]

LEAST_CONTRAST: Final = 0.1
"""Minimum contrast of a channel, as a share of its lightest value: a golden page of bare paper has none of
its own."""
EXTREMES_PERCENT: Final = (0.1, 99.9)
FLAT: Final = 0.1
"""Variation within the edge tolerance up to which a golden is flat. [contrast]"""
EDGE_SIGMAS: Final = 4.0
"""Variation within the edge tolerance below which it is noise and raises no tolerance. [noise standard
deviations]"""
NOISE_SIGMAS: Final = 6.0
"""Threshold of a difference relative to those of the whole page at its scale. [standard deviations]"""
LEAST_SD: Final = 0.002
"""Minimum standard deviation of a pixel: rounding of both scans to 8 bits (sqrt(2 / 12) / 255). [contrast]"""
MAD_TO_SD: Final = 1.4826
LEVELS: Final = 8
"""Number of steps of lightness at which noise is measured."""
LEAST_SAMPLES: Final = 200
EDGE: Final = 0.5
"""Variation within the edge tolerance above which a golden has an edge. [contrast]"""
WIDE_PIXELS: Final = 8
"""Displacement below which an edge is the same edge, displaced; beyond, it is missing or additional."""
EDGES_OFF: Final = 0.1
"""Share of displaced edges above which a tile is displaced."""
MOST_MISFIT: Final = 0.4
"""Share of displaced tiles, of those with edges, above which two scans do not fit: one large defect on a
board with few edges must not reach it. Pairs of the tuning half have at most 0.11; most of them 0.49 or more
if they are displaced by 3 pixels. [-]"""
LEAST_EDGES: Final = 32
"""Minimum number of edge pixels of a tile that counts. [pixels]"""
MOVED_IN: Final = 0.1
"""Share of a pixel's light that comes from an ignored place, above which it is not judged. [-]"""
STREAK_SHARE: Final = 0.7
"""Minimum share of a streak's window that differs by half as much as a streak must: a spot fills less. [-]"""
SPREAD_SIGMAS: Final = 2.0
"""Difference that is excused where several goldens differ. [standard deviations of a pixel over them]"""
VOID_SHARE: Final = 0.6
"""Least share of its ink that a window loses by a void. Windows of good sheets of docs/results/detector/real.md lose at
most 0.42, specks aside; voids whose outline is blurred by 0.6 pixels take 0.7 or more (both were seen before it was
chosen). [-]"""
LEAST_INK: Final = 0.2
"""Least ink of a window, as a mean, in which a void is searched for: 5 black pixels of 25, which is a line of 0.1 mm at
300 dpi. A void on less removes hardly any ink. [contrast]"""
MOST_INK: Final = 0.9
"""Mean ink above which print fills a window: what is missing there shows in the mean itself (``_blots``). [contrast]"""
INK: Final = 0.5
"""Ink above which a pixel belongs to print. [contrast]"""
MOSTLY: Final = 0.8
"""Minimum share of displaced edges in all differences for two scans not to fit; of another page's
differences, half at most are near an edge by chance. [-]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """Variation of a good print relative to the golden.

    It was tuned on half of a set of real pairs (docs/results/detector/golden.md).
    """

    edge_pixels: float = 2.0
    """Displacement that an edge may have relative to the golden, once the page as a whole is aligned."""
    least: tuple[tuple[int, float], ...] = ((1, 0.4), (5, 0.2), (17, 0.08))
    """Side of a window [pixels, odd] and the minimum mean difference in it that counts [contrast]. The last
    two: a good print differs from another by 2.7 % of an ink (worlds.toml: sqrt(2) times the root of 1.2 and
    1.5 % squared and added), and three times that make 0.08."""
    streak: tuple[int, int, float] | None = None
    """Width and length of the window of a streak [pixels, the width odd], and the minimum mean difference in it
    [contrast]; None: streaks are found only where they fill the windows above."""
    blot: int | None = None
    """Side of the window in which a void or a spot among fine print is searched for [pixels, odd]; None: in none."""
    in_strokes: bool = True
    """Whether voids are searched for in strokes that are thinner than that window, too (``_voids``)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoldenDifference:
    """Content of a scan that its golden does not explain."""

    excess: NDArray[np.float32]
    """(lines, pixels) difference beyond what edges may move by, in the channel where it is greatest; above 0:
    lighter than the golden. [contrast]"""
    weight: NDArray[np.float32]
    """(lines, pixels) part of it that counts, 0 where it is noise or too faint. [contrast]"""
    place: GoldenPlace
    misfit: float = 0.0
    """Share of tiles with edges where these are displaced too far, but within ``WIDE_PIXELS``. It is 0 if few
    edges differ, or if much else differs: that is another page, or a corrupted one. [-]"""

    @property
    def fits(self) -> bool:
        """Whether the scan can be compared with the golden, place by place."""
        return not self.place.bent and self.misfit <= MOST_MISFIT


def in_contrasts(
    golden: NDArray[np.floating], *scans: NDArray[np.floating]
) -> tuple[NDArray[np.float32], ...]:
    """Scale images (channels, lines, pixels) to 0..1 from the golden's darkest to its lightest value."""
    scaled = [np.empty(image.shape, np.float32) for image in (golden, *scans)]
    for channel, sheet in enumerate(golden):
        dark, contrast = contrast_range(sheet)
        for image, target in zip((golden, *scans), scaled, strict=True):
            target[channel] = (image[channel] - np.float32(dark)) / np.float32(contrast)
    return tuple(scaled)


def contrast_range(sheet: NDArray[np.floating]) -> tuple[float, float]:
    """Return the darkest value of one channel (lines, pixels), and the contrast up to the lightest one."""
    dark, light = (float(np.percentile(sheet[::2, ::2], percent)) for percent in EXTREMES_PERCENT)
    return dark, max(light - dark, LEAST_CONTRAST * light, 1e-9)


def place_of(golden: NDArray[np.floating], scan: NDArray[np.floating]) -> GoldenPlace:
    """Return where ``scan`` shows ``golden``, both (channels, lines, pixels) of one shape in any unit."""
    golden, scan = in_contrasts(golden, scan)
    return place(golden.mean(axis=0), scan.mean(axis=0))


def residual_of(golden: NDArray[np.floating], scan: NDArray[np.floating], where: GoldenPlace) -> float:
    """Return ``residual_pixels`` of the place that ``place_of`` has found for these scans."""
    golden, scan = in_contrasts(golden, scan)
    return residual_pixels(golden.mean(axis=0), scan.mean(axis=0), where)


def compare(
    golden: NDArray[np.floating],
    scan: NDArray[np.floating],
    *,
    tolerance: Tolerance | None = None,
    where: GoldenPlace | None = None,
    spread: NDArray[np.floating] | None = None,
    ignored: NDArray[np.bool_] | None = None,
    border: NDArray[np.bool_] | None = None,
) -> GoldenDifference:
    """Compare two scans of one page, both (channels, lines, pixels) in any one unit of light.

    The golden is moved to where the scan shows it (``where``, if that is known), adapted to the scan's
    levels, and not smoothed; its noise counts as the scan's does. spread: standard deviation of each of its
    pixels, where it is the mean of several goldens, in their unit. ignored: (lines, pixels) places of the
    golden that are not judged. border: (lines, pixels) places that are not judged in either scan.
    """
    allowed = tolerance or Tolerance()
    spreads: list[NDArray[np.float32] | None] = [None] * len(golden)
    if spread is not None:
        contrasts = [contrast_range(sheet)[1] for sheet in golden]
        spreads = [np.asarray(one / far, np.float32) for one, far in zip(spread, contrasts, strict=True)]
    golden, scan = in_contrasts(golden, scan)
    if where is None:
        where = place(golden.mean(axis=0), scan.mean(axis=0))
    excess = np.zeros(golden.shape[1:], np.float32)
    weight = np.zeros_like(excess)
    loose, misfit = where.loose_pixels(excess.shape), 0.0
    judged = np.ones(excess.shape, np.bool_) if border is None else ~border
    for places in (ignored, border):
        if places is not None:
            judged &= ~(np.nan_to_num(where.moved(places.astype(np.float32)), nan=1.0) > MOVED_IN)
    for one, other, each in zip(golden, scan, spreads, strict=True):
        excused = None if each is None else np.nan_to_num(where.moved(each))
        channel_excess, counted, off = _of_channel(where.moved(one), other, allowed, loose, judged, excused)
        misfit = max(misfit, off)
        stronger = np.abs(channel_excess) > np.abs(excess)
        excess[stronger] = channel_excess[stronger]
        np.maximum(weight, counted, out=weight)
    return GoldenDifference(excess=excess, weight=weight, place=where, misfit=misfit)


def _of_channel(
    moved: NDArray[np.float32],
    scan: NDArray[np.float32],
    allowed: Tolerance,
    loose: NDArray[np.uint8],
    judged: NDArray[np.bool_],
    spread: NDArray[np.float32] | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32], float]:
    """Return excess, weight and misfit of one channel."""
    valid = np.isfinite(moved) & _inner(moved.shape, allowed.edge_pixels) & judged
    moved = np.where(valid, moved, scan)
    disc = _disc(allowed.edge_pixels)
    varying = _range(moved, disc)
    flat = valid & (varying < FLAT)
    moved = moved + level_difference(moved, scan, varying)
    sd = _noise_sd(moved, scan - moved, flat)
    noise = EDGE_SIGMAS * sd / np.sqrt(2)
    excess = np.where(valid, _excess(moved, scan, disc, noise), 0)
    missing = excess > allowed.least[0][1] / 2
    for more in range(1, int(loose.max()) + 1):
        if (loose == more).any():
            looser = _excess(moved, scan, _disc(allowed.edge_pixels + more), noise)
            excess = np.where(valid & (loose == more), looser, excess)
    if spread is not None:
        excused = SPREAD_SIGMAS * cv2.dilate(spread, np.ones((3, 3), np.uint8))
        excess = np.sign(excess) * np.maximum(np.abs(excess) - excused, 0)
    misfit = _misfit(moved, scan, excess, valid & (varying > EDGE), noise, allowed.least[0][1])
    weight = np.zeros_like(excess)
    for side, least in allowed.least:
        if side == 1:
            mean, noise = excess, sd
        else:
            # Results of smaller windows are masked with their surroundings, which only blur their outline.
            seen = cv2.dilate((weight > 0).astype(np.uint8), np.ones((side, side), np.uint8))
            mean = cv2.blur(np.where(seen, 0, excess), (side, side), borderType=cv2.BORDER_REFLECT)
            noise = np.minimum(np.float32(_sd(mean[flat])), least / 2)
        enough = np.abs(mean) > np.maximum(least, NOISE_SIGMAS * noise)
        if side > 1:
            enough &= np.abs(excess) > least / 2
        np.maximum(weight, np.where(enough, np.abs(mean), 0), out=weight)
    if allowed.streak is not None:
        np.maximum(weight, _streaks(excess, flat, allowed.streak), out=weight)
    if allowed.blot is not None:
        difference, ink = np.where(valid, scan - moved, 0), np.maximum(1 - moved, 0)
        missing &= _strokes(ink, allowed.blot)
        if spread is not None:
            difference = np.sign(difference) * np.maximum(np.abs(difference) - excused, 0)
            ink = np.maximum(ink - excused, 0)
        blots = _blots(difference, allowed.blot, allowed.edge_pixels, loose)
        stronger = (blots > 0) & (np.abs(difference) > np.abs(excess))
        excess = np.where(stronger, difference, excess)
        np.maximum(weight, blots, out=weight)
        if allowed.in_strokes:
            voids = _voids(difference, ink, missing, allowed.blot, loose)
            np.maximum(excess, voids, out=excess)
            np.maximum(weight, voids, out=weight)
    return excess, weight, misfit


def _blots(
    difference: NDArray[np.float32], side: int, edge_pixels: float, loose: NDArray[np.uint8]
) -> NDArray[np.float32]:
    """Return the weight of voids and spots among fine print (lines, pixels), 0 elsewhere. [contrast]

    The edge tolerance hides a void in a thin stroke, since each of its pixels is near an edge. But the stroke's two
    edges, each displaced by ``edge_pixels`` and both outwards, change the mean over a window of ``side`` pixels by no
    more than ``2 * edge_pixels / side``. Where the page lies off by ``loose`` pixels more, a stroke is displaced as a
    whole, which hardly changes the mean, and a single edge by ``edge_pixels + loose``.
    """
    mean = cv2.blur(difference, (side, side), borderType=cv2.BORDER_REFLECT)
    least = (np.maximum(2 * edge_pixels, edge_pixels + loose) / side).astype(np.float32)
    weight = np.zeros_like(difference)
    for sign in (1, -1):
        enough = np.where(sign * mean > least, np.abs(mean), 0)
        covered = cv2.dilate(enough, np.ones((side, side), np.uint8))
        np.maximum(weight, np.where(sign * difference > least / 2, covered, 0), out=weight)
    return weight


def _voids(
    difference: NDArray[np.float32],
    ink: NDArray[np.float32],
    missing: NDArray[np.bool_],
    side: int,
    loose: NDArray[np.uint8],
) -> NDArray[np.float32]:
    """Return the share of its ink that the window about a void's pixel has lost (lines, pixels), 0 elsewhere. [-]

    A void takes all ink of a stroke, however thin, but a thin stroke fills little of a window, so that the mean
    difference there is small. The difference is therefore related to the ink of the golden, in two ways of which the
    lesser counts: by their means, which a stroke that is displaced within the window does not change; and by the
    matched filter for the ink that is expected there, which gains nothing from what is lighter beside the stroke.
    Where the page lies off by ``loose`` pixels more, the lost ink must be missing from a window that is greater by as
    many on each side. The centre of a void is a pixel of a stroke that is ``missing``, and is marked with its
    neighbours: windows that are six tenths on the void have their centres within it.
    """
    mean, lost, squared, matched = (
        cv2.blur(image, (side, side), borderType=cv2.BORDER_REFLECT)
        for image in (ink, difference, ink * ink, difference * ink)
    )
    for more in range(1, int(loose.max()) + 1):
        wide = side + 2 * more
        around = cv2.blur(difference, (wide, wide), borderType=cv2.BORDER_REFLECT) * np.float32(
            (wide / side) ** 2
        )
        lost = np.where(loose == more, np.minimum(lost, around), lost)
    share = np.minimum(
        lost / np.maximum(mean, np.float32(LEAST_INK)),
        matched / np.maximum(squared, np.float32(LEAST_INK**2)),
    )
    lost_share = np.where(missing & (share > VOID_SHARE) & (mean < MOST_INK), share, np.float32(0))
    return np.asarray(cv2.dilate(lost_share, np.ones((3, 3), np.uint8)), np.float32)


def _strokes(ink: NDArray[np.float32], side: int) -> NDArray[np.bool_]:
    """Return where print is greater than a window (lines, pixels): a smaller one may be the golden's own speck."""
    _, labels, boxes, _ = cv2.connectedComponentsWithStats((ink > INK).astype(np.uint8))
    extent = boxes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    extent[0] = 0
    return np.asarray((extent > side)[labels], np.bool_)


def _streaks(
    excess: NDArray[np.float32], flat: NDArray[np.bool_], streak: tuple[int, int, float]
) -> NDArray[np.float32]:
    """Return the weight of streaks across and along (lines, pixels), 0 elsewhere. [contrast]

    A streak is a narrow window of flat pixels that differ in one direction almost all along it.
    """
    width, length, least = streak
    weight, even = np.zeros_like(excess), flat.astype(np.float32)
    for size in ((width, length), (length, width)):
        count = np.maximum(cv2.boxFilter(even, -1, size, normalize=False), 1)
        mean = cv2.boxFilter(excess * even, -1, size, normalize=False) / count
        enough = np.maximum(np.float32(least), NOISE_SIGMAS * np.float32(min(_sd(mean[flat]), least / 2)))
        for sign in (1, -1):
            far = flat & (sign * excess > least / 2)
            share = cv2.boxFilter(far.astype(np.float32), -1, size, normalize=False) / count
            whole = (sign * mean > enough) & (share >= STREAK_SHARE) & (count >= width * length / 2)
            covered = cv2.dilate(np.where(whole, np.abs(mean), 0), np.ones(size[::-1], np.uint8))
            np.maximum(weight, np.where(far, covered, 0), out=weight)
    return weight


def _misfit(
    golden: NDArray[np.float32],
    scan: NDArray[np.float32],
    excess: NDArray[np.float32],
    edges: NDArray[np.bool_],
    noise: NDArray[np.float32],
    least: float,
) -> float:
    """See ``GoldenDifference``."""
    off = np.abs(excess) > least
    if np.count_nonzero(off) <= EDGES_OFF * MOST_MISFIT * np.count_nonzero(edges):
        return 0.0
    square = np.ones((2 * WIDE_PIXELS + 1, 2 * WIDE_PIXELS + 1), np.uint8)
    near = off & (np.abs(_excess(golden, scan, square, noise)) <= least / 2)
    if np.count_nonzero(near) < MOSTLY * np.count_nonzero(off):
        return 0.0
    each, misplaced = (_tile_counts(image) for image in (edges, near))
    counted = each >= LEAST_EDGES
    return float((misplaced > EDGES_OFF * each)[counted].mean()) if counted.any() else 0.0


def _tile_counts(image: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Return the number of set pixels in every tile, (rows, columns)."""
    lines, pixels = (-extent % TILE_PIXELS for extent in image.shape)
    whole = np.pad(image, ((0, lines), (0, pixels)))
    rows, columns = whole.shape[0] // TILE_PIXELS, whole.shape[1] // TILE_PIXELS
    return np.asarray(whole.reshape(rows, TILE_PIXELS, columns, TILE_PIXELS).sum(axis=(1, 3)), np.int_)


def _inner(shape: tuple[int, ...], edge_pixels: float) -> NDArray[np.bool_]:
    """Return where an edge may be displaced in any direction and still be within the scan."""
    border = int(np.ceil(edge_pixels))
    inner = np.zeros(shape, np.bool_)
    inner[border : shape[0] - border, border : shape[1] - border] = True
    return inner


def _excess(
    golden: NDArray[np.float32],
    scan: NDArray[np.float32],
    disc: NDArray[np.uint8],
    noise: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return scan minus golden, less what either image shows within the edge tolerance of a pixel.

    Each image must be within the other's local range: a line that is missing is within the golden's range but
    not within the scan's. Where either varies by less than ``noise``, its range raises no tolerance.
    """
    difference = scan - golden
    greatest = np.zeros_like(difference)
    for image, sign in ((golden, 1.0), (scan, -1.0)):
        above = cv2.dilate(image, disc) - image
        below = image - cv2.erode(image, disc)
        above[above < noise] = 0
        below[below < noise] = 0
        off = np.float32(sign) * difference
        left = np.float32(sign) * (np.maximum(off - above, 0) - np.maximum(-off - below, 0))
        greatest = np.where(np.abs(left) > np.abs(greatest), left, greatest)
    return greatest


def _disc(radius: float) -> NDArray[np.uint8]:
    reach = int(np.ceil(radius))
    along, across = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return (across**2 + along**2 <= radius**2 + 1e-9).astype(np.uint8)


def _range(image: NDArray[np.float32], disc: NDArray[np.uint8]) -> NDArray[np.float32]:
    return cv2.dilate(image, disc) - cv2.erode(image, disc)


def _sd(values: NDArray[np.float32]) -> float:
    return MAD_TO_SD * float(np.median(np.abs(values))) if values.size else 0.0


def _noise_sd(
    golden: NDArray[np.float32], difference: NDArray[np.float32], flat: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Return the standard deviation of both scans' difference at each pixel's lightness (lines, pixels).

    [contrast]
    """
    level, off = golden[flat][::7], difference[flat][::7]
    step = np.clip((level * LEVELS).astype(np.intp), 0, LEVELS - 1)
    by_step = [_sd(off[step == at]) if (step == at).sum() > LEAST_SAMPLES else np.nan for at in range(LEVELS)]
    sds = np.array(by_step)
    measured = np.isfinite(sds)
    centres = (np.arange(LEVELS) + 0.5) / LEVELS
    if not measured.any():
        return np.full(golden.shape, LEAST_SD, np.float32)
    return np.maximum(np.interp(golden, centres[measured], sds[measured]), LEAST_SD).astype(np.float32)


def mean_and_spread(
    goldens: Sequence[NDArray[np.float32]], names: Sequence[str]
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Return the mean of good scans of one page, and the standard deviation of a further one from it.

    Both have the shape (channels, lines, pixels) and the unit of the first scan, to which the others are
    registered, turned by 180 degrees if need be, and whose levels they take. A pixel that another scan does
    not show counts as in the first one. The spread is None for one scan; with n it holds the uncertainty of
    the mean too, a factor sqrt(1 + 1 / n).

    ScanError: a scan is of another size or number of channels than the first, or shows another page.
    """
    first = goldens[0]
    if len(goldens) == 1:
        return first, None
    aligned = [first]
    for golden, name in zip(goldens[1:], names[1:], strict=True):
        if golden.shape != first.shape:
            own, wanted = (" x ".join(map(str, image.shape)) for image in (golden, first))
            what = f"has {own} channels, lines and pixels, but {names[0]} has {wanted}"
            raise ScanError(name, what, remedy="give goldens of one page that were scanned in one way")
        aligned.append(_aligned(first, golden, name, names[0]))
    stack = np.stack(aligned)
    spread = stack.std(axis=0, ddof=1) * np.sqrt(1 + 1 / len(stack))
    return stack.mean(axis=0), np.asarray(spread, np.float32)


def _aligned(
    first: NDArray[np.float32], golden: NDArray[np.float32], name: str, of: str
) -> NDArray[np.float32]:
    """Return ``golden`` as it would look where ``first`` lies, in its levels."""
    where = place_of(golden, first)
    if not where.located:
        golden = np.ascontiguousarray(golden[:, ::-1, ::-1])
        where = place_of(golden, first)
    if not where.located or where.bent:
        remedy = "leave it out, or name it as the page that it shows"
        raise ScanError(name, f"does not show the page that {of} shows", remedy=remedy)
    result = np.empty_like(first)
    for channel, (one, other) in enumerate(zip(first, golden, strict=True)):
        moved = where.moved(other)
        moved = np.where(np.isfinite(moved), moved, one)
        (scaled,), (target,) = in_contrasts(moved[None], one[None])
        contrast = np.float32(np.ptp(moved) / max(float(np.ptp(scaled)), 1e-9))
        result[channel] = moved + contrast * level_difference(scaled, target, np.zeros_like(scaled))
    return result
