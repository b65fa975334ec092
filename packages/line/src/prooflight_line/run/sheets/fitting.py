"""Registration of a scan's thumbnail to a page's: their similarity, and where the sheet is too long or too short."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.kernels.thumbnails import SHRINK, STEPS, log_ratio
from prooflight.registration.foreign import SURROUND, detail

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.scans.geometry import ScanGeometry
    from prooflight_line.run.sheets.thumbnails import Thumbnail

BAND_ROWS: Final = 24
"""Height of the bands in which a displacement is measured, 20 mm: some lines of type."""
REACH: Final = 3
"""Displacement of a page that is searched either way, in thumbnail pixels: 2.5 mm."""
MARGIN: Final = 2
"""Margin inside the sheet's edges, in thumbnail pixels: the edges move with the sheet, not with the print."""
CHANGE: Final = 0.05
"""Penalty on a change of displacement by one row from band to band, in likeness. [-]"""
SHARP: Final = 0.02
"""Least sharpness of a band's maximum for its displacement to count, in mean likeness of bands. [-]"""
BLANK: Final = 0.006
"""Detail of a page without print, rms: the paper's cloudiness gives 0.002, a line of type 0.015. [white]"""
PAPER: Final = 0.6
"""Reflectance relative to white above which most of a line of bare paper lies. [white]"""
WHOLE: Final = 0.9
"""Share of the lines between the first and the last of a blank sheet that are bare paper. Assumed: dirt hides few."""
FLOOR, BLUR, INK = 0.01, 0.25, 0.05
"""Deviations of a good print's thumbnail: in white; in thumbnail pixels of displacement; as a share of
darkness."""
TAPE_STEP: Final = 0.05
"""Least difference of a tape from the page, rms across. [white]"""
TAPE_EVEN: Final = 0.03
"""Greatest standard deviation across of a tape's light. [white]"""
TAPE_LIGHTEST: Final = 0.9
"""Greatest light of a tape: lighter rows are bare paper. [white]"""
HOPELESS: Final = -300.0
"""Log likelihood ratio, from a quarter of the rows, below which a page is given up. [nat]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """A scan registered to a page."""

    page: Thumbnail
    likeness: float
    """Correlation of their detail, 1 for identical ones. [-]"""
    light: NDArray[np.float32]
    """The scan, resampled on the page's thumbnail (rows, columns) [white]."""
    box: tuple[int, int, int, int]
    """Interior of the page: first and last row, first and last column, the last excluded."""
    rows: NDArray[np.float64]
    """Centres of the bands whose displacement is known (n,)."""
    drop: NDArray[np.float64]
    """Downward displacement of the print there. [rows]"""


def inside(page: Thumbnail, geometry: ScanGeometry) -> tuple[int, int, int, int]:
    """Return the page's interior in its thumbnail: see ``Fit.box``."""
    lines, columns = geometry.on_page(page.width_mm, page.height_mm)
    rows, across = page.light.shape
    return (
        -(-lines.start // SHRINK) + MARGIN,
        min(lines.stop // SHRINK, rows) - MARGIN,
        -(-columns.start // SHRINK) + MARGIN,
        min(columns.stop // SHRINK, across) - MARGIN,
    )


def lay(seen: NDArray[np.float32], page: Thumbnail, geometry: ScanGeometry, *, longer: float = 0.0) -> Fit:
    """Register a scan's light (rows, columns) to a page. longer: the sheet's length less the page's. [rows]"""
    rows, box = len(page.light), inside(page, geometry)
    expected = page.white
    seen = seen[:rows] if len(seen) >= rows else np.pad(seen, ((0, rows - len(seen)), (0, 0)), mode="edge")
    expected_detail = detail(expected)
    reach = REACH + int(np.ceil(max(-longer, 0))), REACH + int(np.ceil(max(longer, 0)))
    at, drop, aside, tilt = _displacements(detail(seen), expected_detail, box, reach)
    light = _moved(seen, at, drop, aside, tilt, box)
    inner = slice(box[0], box[1]), slice(box[2], box[3])
    level = float((light[inner] * expected[inner]).sum() / max((expected[inner] ** 2).sum(), 1e-9))
    light /= np.float32(np.clip(level, 0.8, 1.25))
    return Fit(
        page=page,
        likeness=_likeness(detail(light)[inner], expected_detail[inner]),
        light=light,
        box=box,
        rows=at,
        drop=drop,
    )


def is_blank(light: NDArray[np.float32], box: tuple[int, int, int, int]) -> bool:
    """Return whether nothing is printed on light (rows, columns) inside a box, or on a smaller sheet within it."""
    inner = light[box[0] : box[1], box[2] : box[3]]
    light_there = inner > PAPER
    rows, columns = (
        np.flatnonzero(2 * np.count_nonzero(light_there, axis=axis) > light_there.shape[axis])
        for axis in (1, 0)
    )
    if min(rows.size, columns.size) < SURROUND:
        return False
    # A sheet is paper throughout: print on a page whose other half is bare is no backing beside a smaller sheet.
    if any(some.size < WHOLE * (some[-1] - some[0] + 1) for some in (rows, columns)):
        return False
    edge = min(SURROUND // 2 + 1, rows.size // 4, columns.size // 4)
    top, left = rows[0] + edge, columns[0] + edge
    sheet = detail(inner)[top : rows[-1] + 1 - edge, left : columns[-1] + 1 - edge]
    return bool(_rms(sheet) < BLANK)


def evidence(fit: Fit, there: Thumbnail, taped: NDArray[np.bool_]) -> float:
    """Return log P(scan | there) - log P(scan | the page of the fit); -inf if the two pages differ in size.

    taped (rows,): where a tape hides the print.
    """
    here = fit.page
    if here.light.shape != there.light.shape or here.width_mm != there.width_mm:
        return -np.inf
    return float(log_ratio(fit.light, here.light, there.light, fit.box, taped, FLOOR, BLUR, INK, HOPELESS))


def taped_rows(fit: Fit) -> NDArray[np.bool_]:
    """Return the rows (rows,) that are one even tone across, darker than paper, and unlike the page."""
    top, bottom, left, right = fit.box
    seen = fit.light[top:bottom, left:right]
    expected = fit.page.light[top:bottom, left:right].astype(np.float32) / np.float32(STEPS)
    other = np.sqrt(np.mean((seen - expected) ** 2, axis=1)) > TAPE_STEP
    even = (seen.std(axis=1) < TAPE_EVEN) & (seen.mean(axis=1) < TAPE_LIGHTEST)
    rows = np.zeros(len(fit.page.light), np.bool_)
    rows[top:bottom] = other & even
    return rows


def _parts(box: tuple[int, int, int, int]) -> list[tuple[int, int]]:
    count = max((box[1] - box[0]) // BAND_ROWS, 1)
    edges = np.linspace(box[0], box[1], count + 1).astype(int)
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def _displacements(
    seen: NDArray[np.float32],
    expected: NDArray[np.float32],
    box: tuple[int, int, int, int],
    reach: tuple[int, int],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """Measure where bands of ``expected`` lie in ``seen``, both as detail.

    The downward displacement is tracked from band to band by dynamic programming (Viterbi): the path of greatest
    likeness, with a penalty on changes. A band of vertical rules, or of nothing, thereby follows its neighbours,
    and is left out.

    Parameters
    ----------
    seen, expected
        (rows, columns) detail of the scan and of the page.
    box
        Interior of the page, as ``Fit.box``.
    reach
        Displacements searched, up and down. [rows]

    Returns
    -------
    at, drop
        Centres of the bands, and their downward displacements. [rows]
    right
        Displacement of the whole to the right. [columns]
    tilt
        Slope of the displacement across the page. [rows / column]
    """
    parts, up, middle = _parts(box), reach[0], (box[2] + box[3]) // 2
    padded = np.pad(seen, (reach, (REACH, REACH)))
    maps = np.stack(
        [
            [
                _likeness_map(expected[top:bottom, left:right], padded, top, left, sum(reach))
                for left, right in ((box[2], middle), (middle, box[3]))
            ]
            for top, bottom in parts
        ]
    )
    across = int(maps.sum(axis=(0, 1, 2)).argmax())
    band_likeness = maps.sum(axis=1)[:, :, max(across - 1, 0) : across + 2].max(axis=2)
    path = _best_path(band_likeness)
    whole = maps.sum(axis=(0, 1))[:, across]
    right = across - REACH + _vertex_at(maps.sum(axis=(0, 1))[int(whole.argmax())], across)
    at, drop, tilts, sharpnesses = [], list[float](), list[float](), list[float]()
    for (top, bottom), halves, likeness, row in zip(parts, maps, band_likeness, path, strict=True):
        if not 0 < row < likeness.size - 1 or likeness[row] < likeness[row - 1 : row + 2].max():
            continue
        sharp = 2 * likeness[row] - likeness[row - 1] - likeness[row + 1]
        if sharp < SHARP * len(parts) ** -1 * maps.max(axis=(2, 3)).sum() or likeness[row] <= 0:
            continue
        at.append((top + bottom - 1) / 2)
        drop.append(row - up + _vertex_at(likeness, row))
        left_half, right_half = halves[0, :, across], halves[-1, :, across]
        tilts.append(_vertex_at(right_half, row) - _vertex_at(left_half, row))
        sharpnesses.append(float(sharp))
    tilt = float(np.average(tilts, weights=sharpnesses)) if sharpnesses else 0.0
    return np.array(at), np.array(drop), right, tilt / ((box[3] - box[2]) / 2)


def _likeness_map(
    tile: NDArray[np.float32], padded: NDArray[np.float32], top: int, left: int, reach: int
) -> NDArray[np.float32]:
    """Return a tile's likeness times its energy at every displacement (down, right) within reach."""
    area = padded[top : top + len(tile) + reach, left : left + tile.shape[1] + 2 * REACH]
    energy = float((tile**2).sum())
    if energy < tile.size * BLANK**2:
        return np.zeros((reach + 1, 2 * REACH + 1), np.float32)
    likeness = cv2.matchTemplate(area, tile, cv2.TM_CCOEFF_NORMED)
    return np.where(np.isfinite(likeness), likeness, 0).astype(np.float32) * np.float32(energy)


def _best_path(of_bands: NDArray[np.float32]) -> list[int]:
    """Return the path through (bands, places) of the greatest sum, less the penalties on its changes."""
    places = np.arange(of_bands.shape[1])
    change = CHANGE * float(of_bands.max(axis=1).mean()) * np.abs(places[:, None] - places)
    total, before = of_bands[0].astype(np.float64), []
    for band in of_bands[1:]:
        best = total[None, :] - change
        before.append(best.argmax(axis=1))
        total = best.max(axis=1) + band
    path = [int(total.argmax())]
    for arrived in reversed(before):
        path.append(int(arrived[path[-1]]))
    return path[::-1]


def _vertex_at(values: NDArray[np.float32], place: int) -> float:
    """Return the offset from ``place`` of the vertex of a parabola through the values around it."""
    if not 0 < place < values.size - 1:
        return 0.0
    before, here, after = values[place - 1 : place + 2].tolist()
    bend = 2 * here - before - after
    return float(np.clip((after - before) / (2 * bend), -0.5, 0.5)) if bend > 0 else 0.0


def _moved(
    seen: NDArray[np.float32],
    at: NDArray[np.float64],
    drop: NDArray[np.float64],
    aside: float,
    tilt: float,
    box: tuple[int, int, int, int],
) -> NDArray[np.float32]:
    row, column = np.arange(seen.shape[0]), np.arange(seen.shape[1])
    down = row + (np.interp(row, at, drop) if at.size else 0.0)
    map_y = down[:, None] + tilt * (column - (box[2] + box[3]) / 2)[None, :]
    map_x = np.broadcast_to(column + aside, map_y.shape)
    maps = np.ascontiguousarray(map_x, np.float32), map_y.astype(np.float32)
    return cv2.remap(seen, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _likeness(seen: NDArray[np.float32], expected: NDArray[np.float32]) -> float:
    blank = _rms(seen) < BLANK, _rms(expected) < BLANK
    if any(blank):
        return float(all(blank))
    a, b = seen - seen.mean(), expected - expected.mean()
    return float((a * b).sum() / np.sqrt(float((a**2).sum()) * float((b**2).sum())))


def _rms(values: NDArray[np.float32]) -> float:
    return float(np.sqrt(np.mean(values**2, dtype=np.float64)))
