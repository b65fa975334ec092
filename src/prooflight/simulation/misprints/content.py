"""Misprints of a page's content: an echo of it, a blurred area, a block missing, the wrong page, or off its place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.scans.placement import Placement
from prooflight.simulation.misprints.drawing import ALL_INKS, FULL, Box, Drawn, Mishap, inks_named, plateau
from prooflight.simulation.worlds import entry

if TYPE_CHECKING:
    from prooflight.pages.raster import Page

GHOST_WIDTH_MM = (40.0, 250.0)
GHOST_HEIGHT_MM = (15.0, 90.0)
"""assumed: size of the block that leaves an echo, from a picture to the width of a roller."""
GHOST_EDGE_MM = 2.0
"""assumed: distance over which the echo fades at its sides."""
BLUR_EDGE = 0.25
"""assumed: width of the transition to the blurred area, as a share of its side."""
BLUR_REACH = 4
"""Number of standard deviations of the blur that are computed."""
FINE_SIGMA = 3.0
"""Standard deviation to which a wide blur is brought by halving the raster. [pixels]"""
BLOCK_SHARE = (1 / 6, 2 / 3)
"""assumed: share of the page's sides that a wrong block covers at severity 0 and 1."""
LEAST_TURN_DEG = 0.3
"""Rotation of a page that is off its place by turning, at severity 0 (worlds.toml).

It grows with severity as the shift does.
"""


def ghost_smear(mishap: Mishap) -> Drawn:
    """Print an echo of the page's own content further along the travel, in one ink or all: ink on bare paper."""
    strength = mishap.amount("strength_percent") / 100
    offset_mm = mishap.between("offset_mm")
    rows = mishap.page.cmyk.shape[0]
    offset = min(max(round(offset_mm / mishap.page.pixel_mm), 1), rows - 1)
    inks = mishap.one_or_all_inks()
    width_mm, height_mm = mishap.by_octaves(*GHOST_WIDTH_MM), mishap.by_octaves(*GHOST_HEIGHT_MM)
    row, column = mishap.content(inks, rows=max(rows - offset, 1))
    source = Box.around(mishap.page, (row, column), width_mm=width_mm, height_mm=height_mm)
    box = Box(
        top=min(source.top + offset, rows - 1),
        left=source.left,
        bottom=min(source.bottom + offset, rows),
        right=source.right,
    )
    taper = GHOST_EDGE_MM / mishap.page.pixel_mm
    down = plateau(source.bottom - source.top, taper)[: box.shape[0]] * np.float32(strength / FULL)
    across = plateau(box.shape[1], taper)
    original = mishap.page.cmyk

    def echo(values: NDArray[np.float32], band: slice) -> None:
        top = box.top - offset
        ink = original[top + band.start : top + band.stop, box.columns, inks].astype(np.float32)
        ink *= (down[band, None] * across)[..., None]
        values += (np.float32(FULL) - values) * ink

    cmyk = mishap.rewritten(box, inks, echo)
    detail = (
        f"ghost of {inks_named(inks)}, {strength:.0%}, {offset * mishap.page.pixel_mm:.1f} mm further down"
    )
    return mishap.drawn(detail, cmyk=cmyk, boxes=[box])


def local_blur(mishap: Mishap) -> Drawn:
    """Smear ink inside a soft-edged area, as by a Gaussian."""
    sigma_mm = mishap.amount("sigma_mm")
    size_mm = mishap.between("size_mm")
    slim = 2 ** mishap.rng.uniform(-0.5, 0.5)
    box = Box.around(mishap.page, mishap.edge(), width_mm=size_mm * slim, height_mm=size_mm / slim)
    sigma = sigma_mm / mishap.page.pixel_mm
    blurred = _blurred(mishap.page.cmyk, box, sigma)
    down, across = (plateau(count, count * BLUR_EDGE) for count in box.shape)

    def smear(values: NDArray[np.float32], rows: slice) -> None:
        values += (blurred[rows] - values) * (down[rows, None] * across)[..., None]

    cmyk = mishap.rewritten(box, ALL_INKS, smear)
    detail = f"smeared by {sigma_mm:.2f} mm over {size_mm:.0f} mm"
    return mishap.drawn(detail, cmyk=cmyk, boxes=[box])


def missing_content(mishap: Mishap) -> Drawn:
    """Leave out a block: a picture or a field that did not arrive. ``size_mm``: the root of its area."""
    size_mm = mishap.amount("size_mm")
    slim = 2 ** mishap.rng.uniform(-0.5, 0.5)
    box = Box.around(mishap.page, mishap.content(), width_mm=size_mm * slim, height_mm=size_mm / slim)
    cmyk = mishap.page.cmyk.copy()
    cmyk[box.rows, box.columns] = 0
    height, width = (extent * mishap.page.pixel_mm for extent in box.shape)
    return mishap.drawn(f"a block of {width:.0f} x {height:.0f} mm missing", cmyk=cmyk, boxes=[box])


def wrong_page(mishap: Mishap) -> Drawn:
    """Print another page of the job, a block of one, or the right page shifted or turned too far.

    Without other pages it is always the last.
    """
    way = int(mishap.rng.integers(4)) if mishap.others else 2 + int(mishap.rng.integers(2))
    if way >= 2:
        return _off_place(mishap, turned=way == 3)
    other = mishap.fetch(int(mishap.rng.choice(np.asarray(mishap.others))))
    foreign = _fitted(other, mishap.page)
    if way == 0:
        return mishap.drawn(f"page {other.number} printed instead", cmyk=foreign)
    share = BLOCK_SHARE[0] + (BLOCK_SHARE[1] - BLOCK_SHARE[0]) * mishap.severity
    width_mm, height_mm = share * mishap.page.width_mm, share * mishap.page.height_mm
    box = Box.around(mishap.page, mishap.content(), width_mm=width_mm, height_mm=height_mm)
    cmyk = mishap.page.cmyk.copy()
    cmyk[box.rows, box.columns] = foreign[box.rows, box.columns]
    return mishap.drawn(f"a block of page {other.number}", cmyk=cmyk, boxes=[box])


def _off_place(mishap: Mishap, *, turned: bool) -> Drawn:
    """Displace the whole page; its content is right."""
    distance_mm = mishap.amount("shift_mm")
    if turned:
        least_mm = entry(mishap.kind)["shift_mm"]["at_0"]
        skew_deg = LEAST_TURN_DEG * distance_mm / least_mm * (1 if mishap.rng.random() < 0.5 else -1)
        detail = f"the page is turned by {abs(skew_deg):.2f} degrees"
        return mishap.drawn(detail, placement=Placement(skew_deg=skew_deg))
    angle = mishap.rng.uniform(0, 2 * np.pi)
    shift_mm = (float(distance_mm * np.cos(angle)), float(distance_mm * np.sin(angle)))
    detail = f"the page lies {distance_mm:.1f} mm off its place"
    return mishap.drawn(detail, placement=Placement(shift_mm=shift_mm))


def _fitted(other: Page, page: Page) -> NDArray[np.uint8]:
    """Return another page's raster at a page's resolution, top-left corners aligned, cropped or filled with paper."""
    cmyk = other.cmyk
    if other.dpi != page.dpi:
        size = [max(round(extent / page.pixel_mm), 1) for extent in (other.width_mm, other.height_mm)]
        cmyk = cv2.resize(cmyk, size, interpolation=cv2.INTER_NEAREST)
    fitted = np.zeros_like(page.cmyk)
    rows, columns = min(cmyk.shape[0], fitted.shape[0]), min(cmyk.shape[1], fitted.shape[1])
    fitted[:rows, :columns] = cmyk[:rows, :columns]
    return fitted


def _blurred(cmyk: NDArray[np.uint8], box: Box, sigma: float) -> NDArray[np.float32]:
    """Blur a box of the raster (rows, columns, 4) by a Gaussian of ``sigma`` pixels.

    Beyond the raster its edge goes on.

    A wide blur is done on a raster of f times coarser pixels. Averaging over them adds a variance of (f^2 -
    1) / 12, and going back between their centres one of about f^2 / 6; that much less is left for the
    Gaussian. [pixels^2]
    """
    factor = max(int(sigma / FINE_SIGMA), 1)
    margin = int(np.ceil(BLUR_REACH * sigma)) + factor
    more = [-(extent + 2 * margin) % factor for extent in box.shape]
    edges = (box.top - margin, box.bottom + margin + more[0], box.left - margin, box.right + margin + more[1])
    rows, columns = cmyk.shape[:2]
    above, below = max(-edges[0], 0), max(edges[1] - rows, 0)
    before, behind = max(-edges[2], 0), max(edges[3] - columns, 0)
    inside = cmyk[max(edges[0], 0) : edges[1], max(edges[2], 0) : edges[3]]
    part = cv2.copyMakeBorder(inside, above, below, before, behind, cv2.BORDER_REPLICATE).astype(np.float32)
    if factor == 1:
        wide = cv2.GaussianBlur(part, (0, 0), sigma)
    else:
        size = (part.shape[1], part.shape[0])
        coarse = cv2.resize(part, (size[0] // factor, size[1] // factor), interpolation=cv2.INTER_AREA)
        left = sigma**2 - (factor**2 - 1) / 12 - factor**2 / 6
        wide = cv2.resize(cv2.GaussianBlur(coarse, (0, 0), left**0.5 / factor), size)
    height, width = box.shape
    cut: NDArray[np.float32] = wide[margin : margin + height, margin : margin + width]
    return cut
