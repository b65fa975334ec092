"""Screens: how a press prints tints with pixels that are solid, bare, or of a few levels.

A tint's coverage is the share of the full ink's light that it takes (``tone``), because solid pixels have no dot gain
of their own: so a screened tint takes as much light as the same tint printed continuously (decision 46).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from prooflight.cmyk import INKS
from prooflight.files.fields import NO_OTHER_FIELDS, Number
from prooflight.kernels.screening import (
    BLUR_REACH,
    WHOLE,
    crowd,
    diffuse_error,
    most_crowded,
    screen_by_threshold,
)
from prooflight.rng import stream

if TYPE_CHECKING:
    from prooflight.pages.pdf.area_averages import InkLight

ScreenKind = Literal["am", "fm", "error-diffusion"]
DotShape = Literal["round", "euclidean", "line"]
SCREEN_KINDS: Final[tuple[ScreenKind, ...]] = get_args(ScreenKind)
DOT_SHAPES: Final[tuple[DotShape, ...]] = get_args(DotShape)
BITS: Final = (1, 2, 4)
CELL: Final = 256
"""Steps of a cell's side at which thresholds of AM are tabulated: a quarter of a thousandth of its area each."""
NOISE_TILE: Final = 128
"""Side of the tile of blue noise, which repeats. [device pixels]"""
_BLUR_SD: Final = 1.5
"""Standard deviation of the filter of void and cluster, by Ulichney 1993. [device pixels]"""
_FIRST_DOTS: Final = 0.1
_NOISE_TURNS: Final = (((1, 0), (0, 1)), ((0, 1), (1, 0)), ((-1, 0), (0, 1)), ((0, 1), (-1, 0)))
"""Each ink reads the tile turned or mirrored, because dots of two inks at the same places would change their colour."""
_NOISE_STARTS: Final = ((0.0, 0.0), (0.37, 0.61), (0.71, 0.23), (0.19, 0.83))
"""And from another place in it. [tile] assumed: any that are far apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Screen:
    """Screen of a press, in its device's pixels; ValueError where it is none."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    kind: ScreenKind
    """``am``: dots of varying size on a lattice; ``fm``: scattered dots of one pixel, by blue noise;
    ``error-diffusion``: by Floyd and Steinberg."""
    dpi: Number
    """Resolution of the device, the same in x and y. [pixels/inch]"""
    lpi: Number = 0.0
    """Ruling of ``am``; 0 for the other kinds. [lines/inch]"""
    angles_deg: tuple[Number, Number, Number, Number] = (15.0, 75.0, 0.0, 45.0)
    """Angles of the lattices of C, M, Y and K for ``am``, counter-clockwise from the line across the web as seen."""
    dot: DotShape = "round"
    """Shape of the dots of ``am``. ``round``: circles; ``euclidean``: circles, squares at 50 %, round holes above;
    ``line``: lines along the angle."""
    bits: Annotated[int, Field(strict=True)] = 1
    """Bits of a device pixel: it prints 2^bits levels of ink, from none to solid."""

    def __post_init__(self) -> None:
        """Check every field."""
        if self.kind not in SCREEN_KINDS:
            raise ValueError(f"kind must be {', '.join(SCREEN_KINDS)}")
        if self.dot not in DOT_SHAPES:
            raise ValueError(f"dot must be {', '.join(DOT_SHAPES)}")
        if self.bits not in BITS:
            raise ValueError(f"bits must be {', '.join(map(str, BITS))}: the device's bits a pixel and ink")
        if not 0 < self.dpi < np.inf:
            raise ValueError(f"dpi must be above 0, got {self.dpi:g}")
        if self.kind == "am" and not 0 < 2 * self.lpi <= self.dpi:
            raise ValueError(f"lpi must be above 0 and at most half of the device's {self.dpi:g} dpi")
        if self.kind != "am" and self.lpi:
            raise ValueError(f"lpi goes with kind am: {self.kind} has no ruling")
        if len(self.angles_deg) != INKS or not np.isfinite(self.angles_deg).all():
            raise ValueError("angles_deg must be four numbers, of C, M, Y and K")


def screened(
    plates: NDArray[np.uint8],
    screen: Screen,
    *,
    tone: InkLight | None = None,
    origin: tuple[float, float] = (0.0, 0.0),
    out: NDArray[np.uint8] | None = None,
) -> NDArray[np.uint8]:
    """Screen plates of device pixels.

    Parameters
    ----------
    plates
        Ink amounts (rows, columns, 4) at the screen's resolution, 0 to 255, C-contiguous.
    screen
        The screen; ``fm`` and ``error-diffusion`` take no angles.
    tone
        Light that tints take (``Press.ink_light``); None: a tint's coverage is its amount.
    origin
        Row and column of the first pixel from the device's own origin, where lattices begin: its phase. ``am`` takes
        parts of a pixel, ``fm`` rounds down, ``error-diffusion`` begins anew in each call.
    out
        Where to write, ``plates`` itself if wished; None: a new array.

    Returns
    -------
    NDArray
        Ink amounts (rows, columns, 4) that are printed: with one bit 0 or 255.
    """
    out = np.empty(plates.shape, np.uint8) if out is None else out
    if not plates.flags.c_contiguous or not out.flags.c_contiguous:
        raise ValueError("plates and out must be C-contiguous")
    low, share, levels = _levels(screen.bits, tone)
    if screen.kind == "error-diffusion":
        diffuse_error(plates, low, share, levels, out)
        return out
    tile = blue_noise() if screen.kind == "fm" else _cell(screen.dot)
    down, across, first = _lattice(screen)
    row, column = origin if screen.kind == "am" else np.floor(origin)
    places = (row + 0.5 + np.arange(len(plates)))[:, None, None] * down + (column + 0.5) * across + first
    shift = 32 - int(np.log2(len(tile)))
    screen_by_threshold(plates, tile, shift, _fixed(places), _fixed(across), low, share, levels, out)
    return out


def _lattice(screen: Screen) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return cell coordinates a pixel down and a pixel across, and those of the origin; (4, 2) each. [cells]"""
    if screen.kind == "fm":
        turns = np.array(_NOISE_TURNS, np.float64) / NOISE_TILE
        return turns[:, 1], turns[:, 0], np.array(_NOISE_STARTS)
    angle = np.radians(screen.angles_deg)
    cells = screen.lpi / screen.dpi
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1) * cells
    down = np.stack([-np.sin(angle), np.cos(angle)], axis=1) * cells
    return down, across, np.zeros((INKS, 2))


def _fixed(cells: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Return cell coordinates modulo whole cells, in units of 2^-32 of a cell."""
    return np.asarray(np.floor((cells % 1.0) * 2**32).astype(np.uint64) & 0xFFFFFFFF).astype(np.uint32)


@lru_cache(maxsize=8)
def _levels(
    bits: int, tone: InkLight | None
) -> tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.uint8]]:
    """Return ``low`` and ``share`` of each byte, (4, 256), and the bytes of the levels."""
    levels = np.rint(np.linspace(0, 255, 2**bits)).astype(np.uint8)
    bytes_ = np.arange(256)
    curves = ((0.0, 1.0),) * INKS if tone is None else tone
    low, share = np.zeros((INKS, 256), np.uint8), np.zeros((INKS, 256), np.uint16)
    for ink, curve in enumerate(curves):
        light = np.interp(bytes_, np.linspace(0, 255, len(curve)), curve)
        of_levels = light[levels]
        place = np.interp(light, of_levels, np.arange(len(levels)))
        place[levels] = np.arange(len(levels))  # exactly, so that solids have no holes
        low[ink] = np.minimum(np.floor(place), len(levels) - 1)
        share[ink] = np.rint((place - low[ink]) * WHOLE)
    return low, share, levels


@lru_cache(maxsize=4)
def _cell(dot: DotShape) -> NDArray[np.uint16]:
    """Return the thresholds of one cell of AM, (CELL, CELL): those below a share fill just that share of it."""
    place = (np.arange(CELL) + 0.5) / CELL - 0.5
    v, u = np.meshgrid(place, place, indexing="ij")
    order = {
        "round": u**2 + v**2,
        "euclidean": -np.cos(2 * np.pi * u) - np.cos(2 * np.pi * v),
        "line": np.abs(v),
    }[dot]
    return _thresholds(np.argsort(order, axis=None, kind="stable"), CELL)


@lru_cache(maxsize=1)
def blue_noise() -> NDArray[np.uint16]:
    """Return a tile of thresholds by void and cluster (Ulichney 1993), (NOISE_TILE, NOISE_TILE).

    Dots are spread evenly whatever the threshold: the next one goes where the largest void is.
    """
    reach = np.arange(-BLUR_REACH, BLUR_REACH + 1)
    blur = np.exp(-(reach[:, None] ** 2 + reach**2) / (2 * _BLUR_SD**2))
    dots = np.zeros((NOISE_TILE, NOISE_TILE), np.uint8)
    crowded = np.zeros(dots.shape)
    count = int(_FIRST_DOTS * dots.size)
    for place in stream(None, "blue-noise").choice(dots.size, count, replace=False):
        _put(dots, crowded, blur, divmod(int(place), NOISE_TILE), 1)
    for _ in range(dots.size):  # until the most crowded dot is what fills the largest void
        cluster = most_crowded(crowded, dots, 1)
        _put(dots, crowded, blur, cluster, 0)
        void = most_crowded(crowded, dots, 0)
        _put(dots, crowded, blur, void, 1)
        if void == cluster:
            break
    first, first_crowded = dots.copy(), crowded.copy()
    order = []
    for _ in range(count):
        order.append(most_crowded(crowded, dots, 1))
        _put(dots, crowded, blur, order[-1], 0)
    order.reverse()
    for _ in range(dots.size - count):
        order.append(most_crowded(first_crowded, first, 0))
        _put(first, first_crowded, blur, order[-1], 1)
    return _thresholds(np.array([row * NOISE_TILE + column for row, column in order]), NOISE_TILE)


def _put(
    dots: NDArray[np.uint8],
    crowded: NDArray[np.float64],
    blur: NDArray[np.float64],
    place: tuple[int, int],
    dot: int,
) -> None:
    dots[place] = dot
    crowd(crowded, blur, 1.0 if dot else -1.0, *place)


def _thresholds(order: NDArray[np.int64], side: int) -> NDArray[np.uint16]:
    """Return thresholds (side, side) that are passed in the order of flat places ``order``, evenly over the shares."""
    tile = np.empty(side * side, np.uint16)
    tile[order] = np.arange(side * side) * WHOLE // (side * side)
    return tile.reshape(side, side)
