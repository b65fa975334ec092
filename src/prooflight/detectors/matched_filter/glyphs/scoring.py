"""Likelihood-ratio tests of a scan's glyphs against their rivals, and the score of a page from them.

The residual is r = a d + B b + noise of inverse variance W / s^2. d is the change that a rival would make, a
= 1 if it is printed there and 0 if not, and B b is the variation of a glyph on good prints (its ink, its
place, the level about it, the breadth of its strokes; b is Gaussian, of stated standard deviations). With W'
= W - W B (B' W B + b's inverse variance)^-1 B' W, E = r' W' r is the energy of a correct glyph, and E(a) = E
- 2 a d' W' r + a^2 d' W' d that of a rival in its place.

No print scatters quite as stated: some letters are displaced, spread or reflect otherwise than B allows, and
a rival then explains a part of that. The factor by which a glyph scatters more widely than stated is
therefore its own, and unknown: s^2 t, with nu / t chi-square of nu degrees of freedom. The n pixels' errors
are then t-distributed (Lange, Little and Taylor 1989), and the log likelihood ratio of rival against glyph is

    (nu + n) / 2 ln((nu + E / s^2) / (nu + E(a) / s^2)),

which depends on the share of the energy that a rival explains rather than on its amount, and grows as its
logarithm. L is the lesser of that and the Gaussian's (E - E(a)) / (2 s^2), so that exp L has a mean of 1 at
most on good prints of either kind. Rivals are tested only where E is an outlier, so that all other glyphs
cost next to nothing.

The page's score is S = ln mean(exp L) over all glyphs and rivals: the log likelihood ratio of one wrong
glyph, equally likely anywhere, against none. Its exponential has a mean of 1 at most on good prints that
scatter as stated, so that S exceeds ln(1 / a) with a probability of at most a (Markov's inequality; e-values,
Vovk and Wang 2021). With a probability ``astray`` the page is displaced further than B can follow, and the
score of such a page may be anything: against that mixture exp S is no more than 1 / astray (``capped``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.matched_filter.glyphs.letters import (
    MARGIN,
    RIVALS,
    Letters,
    Optics,
    find_glyphs,
    in_cells,
    lines_of,
)
from prooflight.kernels.statistics.glyphs import NUISANCES, SHARE, Patches, PlacedGlyphs, glyph_energies
from prooflight.pages.parallel import parts_of, shared_out
from prooflight.prediction.predict import expected_light

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.fit.modes import PixelMap
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry

GOOD: Final = (0.07, 0.2, 0.2, 0.1, 0.1, 0.1, 0.3, 0.3)
"""Standard deviations of one glyph on good prints: its ink [share], its place right and down [pixels], the
level about it [contrasts], how much its strokes run out or sharpen, right and down [pixels^2], and the place
of the adjacent content, right and down [pixels]. assumed: at least twice those of whole inks and planes
(``PrintPrior``), and what registration leaves locally."""
LEAST_SPREAD: Final = 4.0
"""s^2: factor by which good prints' residuals at letters scatter more widely than stated; see decision 32."""
OF_ENERGY: Final = 4.0
"""s^2 over the median energy per pixel of a page's glyphs, or of the nearest ones: few glyphs scatter much
more than most, and where a page is locally off its registered place all glyphs there do."""
NEAREST: Final = 12
"""Number of neighbours of a glyph: those in its line and in the lines above and below, two words' worth.
(assumed)"""
OF_NOTHING: Final = 2.0
"""s^2 for missing glyphs: the variation of ink as a whole is stated (``GOOD``)."""
FREEDOM: Final = 4.0
"""nu: degrees of freedom of a glyph's scatter; 4 for data of unknown tails (Lange, Little and Taylor
1989)."""
SHARES: Final = (0.5, 1.0)
"""Values of a that are tested: a rival as it is drawn, or half of the change to it."""
LEAST_RATIO: Final = 14.0
"""Minimum log likelihood ratio: glyphs that cannot reach it are not tested."""
FURTHEST: Final = 0.5
"""Maximum displacement of a glyph relative to the page about it. [pixels]"""
LEAST_SD: Final = 0.1
"""Minimum standard deviation of the page's local displacement, whatever registration states: good prints have
it. [pixels, assumed]"""
MAX_TESTED: Final = 16
"""Maximum number of glyphs of one scan that are tested, those with the greatest excess energy."""
ASIDE: Final = 2
"""Minimum difference in width from which a rival is also tested at a glyph's left and right edge. [cells]"""
NONE: Final = -1000.0
"""S of a page without glyphs, or without any that are outliers."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageGlyphs:
    """A page's glyphs, prepared before its scans."""

    letters: Letters
    optics: Optics
    patches: Patches
    placed: PlacedGlyphs
    outline: NDArray[np.int64]
    """(n,) index of each glyph's outline in ``letters``."""
    corner: NDArray[np.float64]
    """(n, 2) middle of the outline's first cell, right and down, with the page in its nominal place.
    [pixels]"""
    box_mm: NDArray[np.float64]
    """(n, 4) x, y, width and height on the page."""
    line: NDArray[np.int64]
    """(n,) line of text, from 1 at the top."""

    @property
    def count(self) -> int:
        """Number of glyphs."""
        return len(self.box_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredGlyph:
    """Test result of an outlying glyph."""

    glyph: int
    ratio: float
    """Greatest log likelihood ratio of a rival."""
    deviation: float
    """Deviation of its matched filter, in standard deviations."""
    missing: bool
    """Whether that rival is an empty place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredPage:
    """Result of the glyph tests of one scan."""

    score: float
    """S."""
    glyphs: tuple[ScoredGlyph, ...]
    """Glyphs that were tested, the worst first."""


NOTHING: Final = ScoredPage(score=NONE, glyphs=())


def prepare_glyphs(page: Page, *, sensors: Sequence[SensorModel], geometry: ScanGeometry) -> PageGlyphs:
    """Find the glyphs of a page and their letters; sensors, geometry: of binned pixels.

    Patches are for the first sensor's lens, without its far scatter.
    """
    pitch_mm = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    detected = find_glyphs(page)
    optics = Optics.of(sensors[0].footprint, pitch_mm)
    per_cell = [cell / page.pixel_mm for cell in optics.cell_mm]
    letters = Letters.of(
        [in_cells(mask, per_cell) for mask in detected.masks],
        np.bincount(detected.shape, minlength=len(detected.masks)),
        optics,
    )
    used = np.flatnonzero(letters.letter[detected.shape] >= 0)
    outline, box = detected.shape[used], detected.box[used]
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
        (expected_light(detected.ink[used], sensor)[0] - expected_light(detected.ground[used], sensor)[0])
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


def score_glyphs(
    glyphs: PageGlyphs,
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    light: NDArray[np.float32],
    where: PixelMap,
    *,
    astray: float = 0.0,
    threads: int = 1,
) -> ScoredPage:
    """Test every glyph of a scan; return the page's score S and the outlying glyphs.

    Parameters
    ----------
    glyphs : of the page.
    left : (sensors, lines, pixels) residuals [DN].
    weight : (sensors, lines, pixels) inverse variance of residuals [1/DN^2].
    light : (sensors, lines, pixels) expected light [DN].
    where : placement of the page's pixels.
    astray : probability that the page is displaced further than glyphs are followed.
    threads : number of threads that share the glyphs.
    """
    if not glyphs.count:
        return NOTHING
    out = np.zeros((glyphs.count, 4))
    prior_information = 1 / np.square(np.array(GOOD[:NUISANCES]))
    fixed = (left, weight, where.across, where.along, glyphs.patches, glyphs.placed, prior_information)
    shared_out(
        [partial(glyph_energies, *fixed, *part, out) for part in parts_of(glyphs.count, threads)],
        threads=threads,
    )
    energy, pixels = out[:, 0], out[:, 1]
    usual = float(np.median(energy[pixels > 0] / pixels[pixels > 0])) if pixels.any() else 0.0
    spread = max(LEAST_SPREAD, OF_ENERGY * usual)
    excess = energy - usual * pixels - 2 * spread * LEAST_RATIO
    tested = np.argsort(-excess, kind="stable")[: min(MAX_TESTED, int((excess > 0).sum()))]
    ratios: list[NDArray[np.float64]] = []
    results: list[ScoredGlyph] = []
    for glyph in tested:
        about = max(spread, OF_ENERGY * usual_about(glyphs.box_mm, energy, pixels, int(glyph)))
        ratio, deviation, missing = likelihood_ratios(
            glyphs, int(glyph), left, weight, light[0], out[glyph, 2:], about
        )
        if ratio.size:
            worst = int(ratio.argmax())
            ratios.append(ratio)
            results.append(
                ScoredGlyph(
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
    results.sort(key=lambda one: -one.ratio)
    return ScoredPage(score=max(capped(most + float(np.log(mean)), astray), NONE), glyphs=tuple(results))


def chance_astray(sd_pixels: Sequence[float]) -> float:
    """Return the probability that a page is displaced by more than ``FURTHEST``, across or along.

    sd_pixels: (x, y).
    """
    return min(sum(math.erfc(FURTHEST / (math.sqrt(2) * max(sd, LEAST_SD))) for sd in sd_pixels), 1.0)


def capped(score: float, astray: float) -> float:
    """Return the log likelihood ratio against good pages of which a share, ``astray``, is as other pages are.

    >>> round(capped(50.0, 1e-6), 1), round(capped(-3.0, 1e-6), 1), capped(50.0, 1.0)
    (13.8, -3.0, 0.0)
    """
    if astray >= 1:
        return min(score, 0.0)
    return score if astray <= 0 else -float(np.logaddexp(math.log1p(-astray) - score, math.log(astray)))


def usual_about(
    box_mm: NDArray[np.float64], energy: NDArray[np.float64], pixels: NDArray[np.float64], glyph: int
) -> float:
    """Return the median energy per pixel of the ``NEAREST`` visible glyphs about one glyph.

    It is 0 if there are none.
    """
    others = np.flatnonzero(pixels > 0)
    others = others[others != glyph]
    if not others.size:
        return 0.0
    middle = box_mm[:, :2] + box_mm[:, 2:] / 2
    away = np.square(middle[others] - middle[glyph]).sum(axis=1)
    near = others[np.argsort(away, kind="stable")[:NEAREST]]
    return float(np.median(energy[near] / pixels[near]))


def likelihood_ratios(
    glyphs: PageGlyphs,
    glyph: int,
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    light: NDArray[np.float32],
    displaced: NDArray[np.float64],
    spread: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return a glyph's log likelihood ratios, their deviations, and which rival is an empty place.

    light: of the first sensor. displaced: displacement of the page at the glyph, right and down. [pixels]
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
    stood = [_padded(own, (rows, columns), (MARGIN, MARGIN))]
    for rival in letters.rivals(outline):
        instead = letters.cells[rival]
        wider = own.shape[1] - instead.shape[1]
        foot = MARGIN + own.shape[0] - instead.shape[0]
        asides = {wider // 2} | ({0, wider} if abs(wider) >= ASIDE else set())
        stood += [_padded(instead, (rows, columns), (foot, MARGIN + aside)) for aside in sorted(asides)]

    def seen_at(dx: float, dy: float, those: list[NDArray[np.float32]]) -> NDArray[np.float64]:
        down = glyphs.optics.down((lines - y - dy) * SHARE, rows)
        right = glyphs.optics.right((pixels - x - dx) * SHARE, columns)
        return np.matmul(np.matmul(down, np.stack(those)), right.T).astype(np.float64)

    area = (slice(None), slice(lines[0], lines[-1] + 1), slice(pixels[0], pixels[-1] + 1))
    contrast = glyphs.placed.contrast[glyph][:, None, None].astype(np.float64)
    sure = (contrast**2 * weight[area]).sum(axis=0).ravel()
    pushed = (contrast * weight[area] * left[area]).sum(axis=0).ravel()
    expected = seen_at(0.0, 0.0, stood[:1])[0]
    background = light[area[1:]] / contrast[0] - expected
    dx, dy = own_shift(nuisances(expected, background), sure, pushed)
    seen = seen_at(dx, dy, stood)
    pushed -= sure * (seen[0] - expected).ravel()
    differences = np.concatenate([-seen[:1], seen[1:] - seen[:1]]).reshape(len(seen), -1)
    push, power, energy = without_nuisances(differences, nuisances(seen[0], background), sure, pushed)
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
    """Return L of rivals that explain so much of a glyph's energy in a number of pixels.

    Both are divided by s^2.
    """
    left = np.maximum(energy - explained, 0)
    of_t = (freedom + pixels) / 2 * np.log((freedom + energy) / (freedom + left))
    return np.asarray(np.minimum(of_t, explained / 2))


def nuisances(seen: NDArray[np.float64], background: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a glyph's variation on good prints, (8, pixels), from its image (lines, pixels); as ``GOOD``.

    background: the light without the glyph, over its contrast.
    """
    wide = np.pad(seen, 1)
    up, down, before, after = wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]
    about = np.pad(background, 1, mode="edge")
    images = (
        seen,
        (after - before) / 2,
        (down - up) / 2,
        np.ones_like(seen),
        before + after - 2 * seen,
        up + down - 2 * seen,
        (about[1:-1, 2:] - about[1:-1, :-2]) / 2,
        (about[2:, 1:-1] - about[:-2, 1:-1]) / 2,
    )
    return np.stack(images).reshape(len(GOOD), -1)


def own_shift(
    basis: NDArray[np.float64], sure: NDArray[np.float64], pushed: NDArray[np.float64]
) -> tuple[float, float]:
    """Return a glyph's displacement right and down from its expected place, ``FURTHEST`` at most. [pixels]

    It is tested there, because the linear model of a shift holds for a fifth of a pixel.
    """
    whole = (basis * sure) @ basis.T + np.diag(1 / np.square(GOOD))
    solution = np.linalg.solve(whole, basis @ pushed)
    dx, dy = (float(np.clip(-one, -FURTHEST, FURTHEST)) for one in solution[1:3])
    return dx, dy


def without_nuisances(
    differences: NDArray[np.float64],
    basis: NDArray[np.float64],
    sure: NDArray[np.float64],
    pushed: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return d' W' r and d' W' d of each difference d, and r' W' r, with the nuisances projected out of W'.

    differences (n, pixels), in units of the contrast; basis (8, pixels); sure (pixels,): inverse variance W;
    pushed (pixels,): W r.
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


def _padded(
    cells: NDArray[np.float32], shape: tuple[int, int], corner: tuple[int, int]
) -> NDArray[np.float32]:
    """Place an outline in a patch, cropped to it; corner: its row and column."""
    patch = np.zeros(shape, np.float32)
    row, column = corner
    top, first = max(row, 0), max(column, 0)
    inside = cells[top - row : shape[0] - row, first - column : shape[1] - column]
    patch[top : top + inside.shape[0], first : first + inside.shape[1]] = inside
    return patch


GLYPH_SHARE: Final = 0.1
"""Share of the guaranteed false-alarm rate that the glyph test has. A wrong digit deviates by some tens of
standard deviations of good pages and needs no larger share; the ranking loses hardly any power."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GlyphThreshold:
    """Threshold and p-values of the glyph score S, from a press's own good pages."""

    own: NDArray[np.float64]
    """(pages,) S of good pages; ``NONE`` for pages without outlying glyphs."""
    rate: float
    """False-alarm rate of the glyph test: one good page in 1 / rate alarms. [-]"""

    @property
    def tail(self) -> tuple[float, float]:
        """The share of good pages whose S is above 0, with one more counted, and the mean of S there.

        On pages that scatter as stated the mean is 1 at most (``weighing``); one such page is counted in
        addition to the press's own, and the mean is never less.
        """
        above = self.own[self.own > 0]
        mean = (1 + float(above.sum())) / (1 + above.size)
        return (1 + above.size) / (1 + self.own.size), max(1.0, mean)

    @property
    def threshold(self) -> float:
        """S that good pages exceed at ``rate``: ln(1 / rate), or more if its own good pages require it."""
        share, mean = self.tail
        drawn = mean * math.log(max(share / self.rate, 1.0))
        return max(-math.log(self.rate), drawn, float(self.own.max(initial=NONE)))

    def p_value(self, score: float) -> float:
        """Return a bound on the probability that a good page's S is so high.

        It is 1 where there is no evidence of a wrong glyph.
        """
        if score <= 0:
            return 1.0
        share, mean = self.tail
        by_tail = max(math.exp(-min(score, 700.0)), share * math.exp(-min(score / mean, 700.0)))
        if score > self.threshold:
            return min(by_tail, self.rate)
        return max(by_tail, self.rate)


def combined_score(score: float, threshold: float, glyphs: float, glyphs_threshold: float) -> float:
    """Combine the scores of both tests.

    The result is above the ranking's threshold if and only if one of them alarms.
    """
    if not math.isfinite(score) or glyphs <= glyphs_threshold:
        return score
    return max(score, threshold + glyphs - glyphs_threshold)
