"""Each glyph of a scan weighed against its rivals, and one number of a page.

Residual r = a d + B b + noise of inverse variance W / s^2: d what a rival would change, a = 1 if it stands there and 0
if not, B b what a good print does with a glyph anyway (its ink, its place, the level about it, the breadth of its
strokes; b Gaussian, of stated standard deviations). With W' = W - W B (B' W B + b's inverse variance)^-1 B' W, E =
r' W' r is the energy of a glyph as it should be, and E(a) = E - 2 a d' W' r + a^2 d' W' d that of a rival in its place.

No print is quite as stated: here and there letters lie, spread or shine otherwise than B says, and a rival then
explains a part of that. So how much wider than stated a glyph scatters is its own, and unknown: s^2 t, with nu / t
chi-square of nu degrees of freedom. The n pixels' errors are then t-distributed (Lange, Little and Taylor 1989), and
the log likelihood ratio of rival against glyph is

    (nu + n) / 2 ln((nu + E / s^2) / (nu + E(a) / s^2)),

which asks what share of the energy a rival explains rather than how much of it, and grows as its logarithm. L is that
or the Gaussian's (E - E(a)) / (2 s^2), whichever is less, so that exp L has a mean of 1 at most on good prints of
either kind. Only where E stands out are rivals asked, and all other glyphs cost next to nothing.

The page's number is S = ln mean(exp L) over all glyphs and rivals: the log likelihood ratio of one wrong glyph,
anywhere alike, against none. Its exponential has a mean of 1 at most on good prints that scatter as stated, so that
S exceeds ln(1 / a) with a chance of at most a (Markov's inequality; e-values, Vovk and Wang 2021). With a chance
``astray`` the page lies where B cannot follow, and such a page may say anything: against that
mixture exp S is no more than 1 / astray (``capped``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.matched_filter.glyphs.finding import find_glyphs, lines_of
from prooflight.detectors.matched_filter.glyphs.letters import MARGIN, RIVALS, Letters, Optics, in_cells
from prooflight.kernels.statistics.glyphs import NUISANCES, SHARE, Patches, PlacedGlyphs, glyph_energies
from prooflight.pages.parallel import parts_of, shared_out
from prooflight.prediction.predict import looked_up

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.modes import PixelMap
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry

GOOD: Final = (0.07, 0.2, 0.2, 0.1, 0.1, 0.1, 0.3, 0.3)
"""Standard deviations of what good prints do with one glyph: its ink [share], its place right and down [pixels], the
level about it [contrasts], how much its strokes run out or sharpen, right and down [pixels^2], and the place of what
stands beside it, right and down [pixels]. assumed: twice and
more of what whole inks and planes do (``PrintPrior``), and what registration leaves from place to place."""
LEAST_SPREAD: Final = 4.0
"""s^2: how much wider than stated good prints' residuals are at letters; see decision 32."""
OF_ENERGY: Final = 4.0
"""s^2 over the energy of a pixel of the middle glyph of a page, or of those nearest: few glyphs scatter much more than
most, and where a page lies a little elsewhere than registration has it all that stand there do."""
NEAREST: Final = 12
"""Glyphs about one: a line's neighbours and those above and below, two words' worth. (assumed)"""
OF_NOTHING: Final = 2.0
"""s^2 of glyphs that are missing: what ink as a whole does is stated (``GOOD``)."""
FREEDOM: Final = 4.0
"""nu: degrees of freedom of what a glyph scatters by; 4 for data of unknown tails (Lange, Little and Taylor 1989)."""
SHARES: Final = (0.5, 1.0)
"""a of what stands in a glyph's place: a rival as it is drawn, or what goes half of the way to it."""
LEAST_RATIO: Final = 14.0
"""Glyphs that cannot have a greater log likelihood ratio are not asked."""
FURTHEST: Final = 0.5
"""By which a glyph may lie elsewhere than the page about it. [pixels]"""
LEAST_SD: Final = 0.1
"""Least standard deviation of the page's place from spot to spot, whatever registration says: good prints have it.
[pixels, assumed]"""
MOST_ASKED: Final = 16
"""Glyphs of one scan, those that stand out most."""
ASIDE: Final = 2
"""Cells by which a rival's width differs if it might also stand at a glyph's left or right edge."""
NONE: Final = -1000.0
"""S of a page that has no glyphs, or none that stands out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageGlyphs:
    """A page's glyphs ahead of its scans."""

    letters: Letters
    optics: Optics
    patches: Patches
    placed: PlacedGlyphs
    outline: NDArray[np.int64]
    """(n,) of ``letters``."""
    corner: NDArray[np.float64]
    """(n, 2) middle of the outline's first cell, right and down, the page in its place. [pixels]"""
    box_mm: NDArray[np.float64]
    """(n, 4) x, y, width, height on the page."""
    line: NDArray[np.int64]
    """(n,) of text, from 1 at the top."""

    @property
    def count(self) -> int:
        """Of glyphs."""
        return len(self.box_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighedGlyph:
    """A glyph that stands out."""

    glyph: int
    ratio: float
    """The greatest log likelihood ratio of a rival."""
    deviation: float
    """Its matched filter's, in standard deviations."""
    missing: bool
    """Whether that rival is that nothing stands there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighedPage:
    """What one scan says of a page's glyphs."""

    score: float
    """S."""
    found: tuple[WeighedGlyph, ...]
    """Those that were asked, the worst first."""


NOTHING: Final = WeighedPage(score=NONE, found=())


def prepare_glyphs(page: Page, *, sensors: Sequence[SensorModel], geometry: ScanGeometry) -> PageGlyphs:
    """Find the glyphs of a page and their letters; sensors, geometry: of pixels taken together.

    Patches are of the first sensor's lens, without what it scatters far.
    """
    pitch_mm = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    found = find_glyphs(page)
    optics = Optics.of(sensors[0].footprint, pitch_mm)
    per_cell = [cell / page.pixel_mm for cell in optics.cell_mm]
    letters = Letters.of(
        [in_cells(mask, per_cell) for mask in found.masks],
        np.bincount(found.shape, minlength=len(found.masks)),
        optics,
    )
    kept = np.flatnonzero(letters.letter[found.shape] >= 0)
    outline, box = found.shape[kept], found.box[kept]
    begin_mm = geometry.left_mm(page.width_mm), geometry.lead_in_mm
    corner = np.stack(
        [
            (page.pixel_mm * box[:, axis] + begin_mm[axis]) / pitch_mm[axis] + 0.5 / SHARE - 0.5
            for axis in (0, 1)
        ],
        axis=1,
    )
    letter = letters.letter[outline]
    off = letters.centroid[outline] - letters.centroid[letters.leader[letter]] - MARGIN
    column = np.rint(corner[:, 0]).astype(np.intp).clip(0, geometry.pixels - 1)
    contrast = [
        (looked_up(found.ink[kept], sensor)[0] - looked_up(found.ground[kept], sensor)[0])
        * sensor.column_gain[column]
        for sensor in sensors
    ]
    return PageGlyphs(
        letters=letters,
        optics=optics,
        patches=letters.patches(optics),
        placed=PlacedGlyphs(
            letter=letter,
            at=(corner + off / SHARE).astype(np.float32),
            contrast=np.stack(contrast, axis=1).astype(np.float32),
        ),
        outline=outline,
        corner=corner,
        box_mm=np.asarray(page.pixel_mm * box, np.float64),
        line=lines_of(box),
    )


def weighed(
    glyphs: PageGlyphs,
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    light: NDArray[np.float32],
    where: PixelMap,
    *,
    astray: float = 0.0,
    threads: int = 1,
) -> WeighedPage:
    """A scan's residuals, (sensors, lines, pixels) [DN], asked of every glyph; weight: their inverse variance [1/DN^2];
    light: what was expected [DN]; astray: the chance that the page lies further off than glyphs are followed.
    """
    if not glyphs.count:
        return NOTHING
    out = np.zeros((glyphs.count, 4))
    known = 1 / np.square(np.array(GOOD[:NUISANCES]))
    fixed = (left, weight, where.across, where.along, glyphs.patches, glyphs.placed, known)
    shared_out(
        [partial(glyph_energies, *fixed, *part, out) for part in parts_of(glyphs.count, threads)],
        threads=threads,
    )
    energy, pixels = out[:, 0], out[:, 1]
    usual = float(np.median(energy[pixels > 0] / pixels[pixels > 0])) if pixels.any() else 0.0
    spread = max(LEAST_SPREAD, OF_ENERGY * usual)
    excess = energy - usual * pixels - 2 * spread * LEAST_RATIO
    asked = np.argsort(-excess, kind="stable")[: min(MOST_ASKED, int((excess > 0).sum()))]
    ratios: list[NDArray[np.float64]] = []
    found: list[WeighedGlyph] = []
    for glyph in asked:
        about = max(spread, OF_ENERGY * usual_about(glyphs.box_mm, energy, pixels, int(glyph)))
        ratio, deviation, missing = weigh(glyphs, int(glyph), left, weight, light[0], out[glyph, 2:], about)
        if ratio.size:
            worst = int(ratio.argmax())
            ratios.append(ratio)
            found.append(
                WeighedGlyph(
                    glyph=int(glyph),
                    ratio=float(ratio[worst]),
                    deviation=float(deviation[worst]),
                    missing=bool(missing[worst]),
                )
            )
    if not ratios:
        return NOTHING
    every = np.concatenate(ratios)
    most = float(every.max())
    mean = np.exp(every - most).sum() / (glyphs.count * (RIVALS + 1))
    found.sort(key=lambda one: -one.ratio)
    return WeighedPage(score=max(capped(most + float(np.log(mean)), astray), NONE), found=tuple(found))


def chance_astray(sd_pixels: Sequence[float]) -> float:
    """Return the chance that a page lies more than ``FURTHEST`` off where it is thought to, either way; sd: (x, y)."""
    return min(sum(math.erfc(FURTHEST / (math.sqrt(2) * max(sd, LEAST_SD))) for sd in sd_pixels), 1.0)


def capped(score: float, astray: float) -> float:
    """The log of a likelihood ratio against good pages of which a share, ``astray``, is as the other pages are.

    >>> round(capped(50.0, 1e-6), 1), round(capped(-3.0, 1e-6), 1), capped(50.0, 1.0)
    (13.8, -3.0, 0.0)
    """
    if astray >= 1:
        return min(score, 0.0)
    return score if astray <= 0 else -float(np.logaddexp(math.log1p(-astray) - score, math.log(astray)))


def usual_about(
    box_mm: NDArray[np.float64], energy: NDArray[np.float64], pixels: NDArray[np.float64], glyph: int
) -> float:
    """Energy of a pixel of the middle one of the ``NEAREST`` glyphs that are seen about one of them; 0: none is."""
    others = np.flatnonzero(pixels > 0)
    others = others[others != glyph]
    if not others.size:
        return 0.0
    middle = box_mm[:, :2] + box_mm[:, 2:] / 2
    away = np.square(middle[others] - middle[glyph]).sum(axis=1)
    near = others[np.argsort(away, kind="stable")[:NEAREST]]
    return float(np.median(energy[near] / pixels[near]))


def weigh(
    glyphs: PageGlyphs,
    glyph: int,
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    light: NDArray[np.float32],
    displaced: NDArray[np.float64],
    spread: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """One glyph's log likelihood ratios against each of its rivals, their deviations, and which is that it is missing.

    light: of the first sensor. displaced: how far right and down of itself it lies. [pixels]
    """
    letters, outline = glyphs.letters, int(glyphs.outline[glyph])
    own = letters.cells[outline]
    rows, columns = (int(size) + 2 * MARGIN for size in own.shape)
    x, y = glyphs.corner[glyph] + displaced - MARGIN / SHARE
    lines = np.arange(int(np.ceil(y)), int(np.floor(y + (rows - 1) / SHARE)) + 1)
    pixels = np.arange(int(np.ceil(x)), int(np.floor(x + (columns - 1) / SHARE)) + 1)
    lines = lines[(lines >= 0) & (lines < left.shape[1])]
    pixels = pixels[(pixels >= 0) & (pixels < left.shape[2])]
    none = np.zeros(0)
    if not lines.size or not pixels.size:
        return none, none, none.astype(bool)
    stood = [_laid(own, (rows, columns), (MARGIN, MARGIN))]
    for rival in letters.rivals(outline):
        instead = letters.cells[rival]
        wider = own.shape[1] - instead.shape[1]
        foot = MARGIN + own.shape[0] - instead.shape[0]
        asides = {wider // 2} | ({0, wider} if abs(wider) >= ASIDE else set())
        stood += [_laid(instead, (rows, columns), (foot, MARGIN + aside)) for aside in sorted(asides)]

    def seen_at(dx: float, dy: float, those: list[NDArray[np.float32]]) -> NDArray[np.float64]:
        down = glyphs.optics.down((lines - y - dy) * SHARE, rows)
        right = glyphs.optics.right((pixels - x - dx) * SHARE, columns)
        return np.matmul(np.matmul(down, np.stack(those)), right.T).astype(np.float64)

    area = (slice(None), slice(lines[0], lines[-1] + 1), slice(pixels[0], pixels[-1] + 1))
    contrast = glyphs.placed.contrast[glyph][:, None, None].astype(np.float64)
    sure = (contrast**2 * weight[area]).sum(axis=0).ravel()
    pushed = (contrast * weight[area] * left[area]).sum(axis=0).ravel()
    expected = seen_at(0.0, 0.0, stood[:1])[0]
    beside = light[area[1:]] / contrast[0] - expected
    dx, dy = own_shift(nuisances(expected, beside), sure, pushed)
    seen = seen_at(dx, dy, stood)
    pushed -= sure * (seen[0] - expected).ravel()
    differences = np.concatenate([-seen[:1], seen[1:] - seen[:1]]).reshape(len(seen), -1)
    push, power, energy = without_nuisances(differences, nuisances(seen[0], beside), sure, pushed)
    missing = np.arange(len(seen)) == 0
    wide = np.where(missing, OF_NOTHING, spread)
    seen_pixels = int((sure > 0).sum())
    parted = [
        log_ratio(energy / wide, (2 * share * push - share**2 * power) / wide, seen_pixels)
        for share in SHARES
    ]
    ratio = np.logaddexp.reduce(parted, axis=0) - np.log(len(SHARES))
    return ratio, push / np.sqrt(np.maximum(power * wide, 1e-9)), missing


def log_ratio(
    energy: float | NDArray[np.float64],
    explained: NDArray[np.float64],
    pixels: int,
    *,
    freedom: float = FREEDOM,
) -> NDArray[np.float64]:
    """L of rivals that explain so much of a glyph's energy in so many pixels; both over s^2."""
    left = np.maximum(energy - explained, 0)
    of_t = (freedom + pixels) / 2 * np.log((freedom + energy) / (freedom + left))
    return np.asarray(np.minimum(of_t, explained / 2))


def nuisances(seen: NDArray[np.float64], beside: NDArray[np.float64]) -> NDArray[np.float64]:
    """(8, pixels) what good prints do with a glyph of image (lines, pixels), in the order of ``GOOD``.

    beside: the light without it, over its contrast.
    """
    wide = np.pad(seen, 1)
    up, down, before, after = wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]
    about = np.pad(beside, 1, mode="edge")
    made = (
        seen,
        (after - before) / 2,
        (down - up) / 2,
        np.ones_like(seen),
        before + after - 2 * seen,
        up + down - 2 * seen,
        (about[1:-1, 2:] - about[1:-1, :-2]) / 2,
        (about[2:, 1:-1] - about[:-2, 1:-1]) / 2,
    )
    return np.stack(made).reshape(len(GOOD), -1)


def own_shift(
    basis: NDArray[np.float64], sure: NDArray[np.float64], pushed: NDArray[np.float64]
) -> tuple[float, float]:
    """How far right and down of where it is expected a glyph lies, no further than ``FURTHEST``. [pixels]

    From there on it is weighed: what is linear in a shift holds for a fifth of a pixel.
    """
    whole = (basis * sure) @ basis.T + np.diag(1 / np.square(GOOD))
    found = np.linalg.solve(whole, basis @ pushed)
    dx, dy = (float(np.clip(-one, -FURTHEST, FURTHEST)) for one in found[1:3])
    return dx, dy


def without_nuisances(
    differences: NDArray[np.float64],
    basis: NDArray[np.float64],
    sure: NDArray[np.float64],
    pushed: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Of W' without nuisances, d' W' r and d' W' d of each of differences (n, pixels), and r' W' r; differences are in
    units of the contrast.

    basis (8, pixels); sure (pixels,): inverse variance W; pushed (pixels,): W r.
    """
    whole = (basis * sure) @ basis.T + np.diag(1 / np.square(GOOD))
    shared = (differences * sure) @ basis.T
    of_nuisances = basis @ pushed
    taken = np.linalg.solve(whole, np.column_stack([shared.T, of_nuisances]))
    push = differences @ pushed - shared @ taken[:, -1]
    power = (differences**2) @ sure - (shared * taken[:, :-1].T).sum(axis=1)
    seen = sure > 0
    energy = float((pushed[seen] ** 2 / sure[seen]).sum() - of_nuisances @ taken[:, -1])
    return push, np.maximum(power, 0), max(energy, 0.0)


def _laid(cells: NDArray[np.float32], shape: tuple[int, int], corner: tuple[int, int]) -> NDArray[np.float32]:
    """An outline in a patch; what would lie beyond is cut off. corner: its row and column."""
    patch = np.zeros(shape, np.float32)
    row, column = corner
    top, first = max(row, 0), max(column, 0)
    inside = cells[top - row : shape[0] - row, first - column : shape[1] - column]
    patch[top : top + inside.shape[0], first : first + inside.shape[1]] = inside
    return patch
