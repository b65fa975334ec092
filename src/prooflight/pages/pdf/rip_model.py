"""How a press's RIP makes device pixels of shapes, as parameters, and how sure they are (decision 47).

A RIP that cannot be asked for its rasters is imitated: MuPDF draws by its fill rule, with its thinnest line, on
its grid of pixels, and each ink's shapes then grow by a stated amount. What is not stated stays as it was before
there were such parameters, and its uncertainty is that of a whole device pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.files.fields import NO_OTHER_FIELDS, Number

if TYPE_CHECKING:
    from prooflight.pages.pdf.area_averages import InkLight

FillRule = Literal["centre", "any-part", "area"]
"""Rule by which a shape fills device pixels: those whose centre it covers, those that it touches, or each by the area
that it covers. ``any-part`` is for paths, which are drawn four times, by the corners of pixels: MuPDF's level 10, which
should fill what a path touches, inked no more of a test page than its centres did. Glyphs and lines thinner than a
pixel are filled by centres, as by Ghostscript (PLRM 3, 7.5)."""
FILL_RULES: Final[tuple[FillRule, ...]] = get_args(FillRule)
MIDDLE: Final = (0.5, 0.5)
TOUCHED: Final = 1 / 512
"""Least part of a pixel that counts as any, half the unit in which Ghostscript rounds places: an edge on the border of
two pixels touches one. [pixels]"""
UNKNOWN_DPI: Final = 600.0
"""Assumed resolution of a press whose resolution is unknown. (assumed: no press of letters prints more
coarsely)"""
GROWTH_UM_MAX: Final = 200.0
"""Largest growth: twice the stroke of small letters."""
LINE_UM_MAX: Final = 500.0
OFFSET_UM_MAX: Final = 200.0
SD_UM_MAX: Final = 200.0
MM_PER_INCH: Final = 25.4
Inks = tuple[Number, Number, Number, Number]


def _check(name: str, value: float | None, least: float, most: float) -> None:
    if value is not None and not least <= value <= most:
        raise ValueError(f"{name} must be from {least:g} to {most:g} micrometres, got {value:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class RipModel:
    """Parameters of a press's RIP; what is None is unknown. ValueError where a value can be none of a RIP's."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    fill: FillRule | None = None
    least_line_um: Number | None = None
    """Width to which thinner lines are drawn; None: one device pixel. [um]"""
    offset_um: tuple[Number, Number] | None = None
    """Place of the corner of a device pixel, from the printed page's top left corner to the right and down. [um]"""
    offset_sd_um: Number = 0.0
    growth_um: Inks | None = None
    """Distance by which edges of C, M, Y and K lie outside what is drawn; inside where negative. [um]"""
    growth_sd_um: Inks = (0.0, 0.0, 0.0, 0.0)
    edge_sd_um: Number | None = None
    """Standard deviation, measured, with which single edges lie off what is drawn; None: not measured. [um]"""

    def __post_init__(self) -> None:
        """Check every field."""
        if self.fill is not None and self.fill not in FILL_RULES:
            raise ValueError(f"fill must be {', '.join(FILL_RULES)}")
        _check("least_line_um", self.least_line_um, 0.0, LINE_UM_MAX)
        _check("edge_sd_um", self.edge_sd_um, 0.0, SD_UM_MAX)
        _check("offset_sd_um", self.offset_sd_um, 0.0, SD_UM_MAX)
        for name, values, count, most in (
            ("offset_um", self.offset_um, 2, OFFSET_UM_MAX),
            ("growth_um", self.growth_um, INKS, GROWTH_UM_MAX),
        ):
            if values is not None and len(values) != count:
                of = "of C, M, Y and K" if count == INKS else "to the right and down"
                raise ValueError(f"{name} must be {count} numbers, {of}, in micrometres")
            for value in values or ():
                _check(name, value, -most, most)
        if len(self.growth_sd_um) != INKS:
            raise ValueError(f"growth_sd_um must be {INKS} numbers, of C, M, Y and K, in micrometres")
        for value in self.growth_sd_um:
            _check("growth_sd_um", value, 0.0, SD_UM_MAX)
        if self.offset_sd_um and self.offset_um is None:
            raise ValueError("offset_sd_um goes with offset_um")
        if any(self.growth_sd_um) and self.growth_um is None:
            raise ValueError("growth_sd_um goes with growth_um")

    @property
    def samples(self) -> tuple[tuple[float, float], ...]:
        """Points of a pixel, right and down from its corner; a path that covers one fills the pixel. [pixels]

        Empty: MuPDF decides, whose only sample is the pixel's last corner.
        """
        if self.fill == "any-part":
            ends = TOUCHED, 1 - TOUCHED
            return tuple((right, down) for right in ends for down in ends)
        return (MIDDLE,) if self.fill == "centre" else ()

    @property
    def shapes_mupdf(self) -> bool:
        """Whether anything is stated that another engine than MuPDF decides by itself."""
        return self.fill is not None or self.least_line_um is not None or self.offset_um is not None

    def growth_pixels(self, dpi: float) -> Inks:
        """Return how far the edges of each ink lie outside those that its rule fills. [device pixels]"""
        c, m, y, k = (um * 1e-3 * dpi / MM_PER_INCH for um in self.growth_um or (0.0,) * INKS)
        return c, m, y, k

    def offset_pixels(self, dpi: float) -> tuple[float, float]:
        """Return how far the device's grid lies right of and below the page's corner, in 0..1. [pixels]"""
        right, down = ((um * 1e-3 * dpi / MM_PER_INCH) % 1.0 for um in self.offset_um or (0.0, 0.0))
        return right, down

    def edge_sd_mm(self, dpi: float | None) -> float:
        """Return the standard deviation with which printed edges lie off those of the expected raster.

        Every RIP rounds edges to pixels by a rule of its own, so that an edge is anywhere within one pixel (variance of
        a uniform distribution), unless it was measured, or is by centres of a stated
        grid; by area nothing is rounded. Growth
        that is not known exactly adds the variance of the ink that is known least. [mm]
        """
        pixel_um = 1e3 * MM_PER_INCH / (dpi or UNKNOWN_DPI)
        if self.edge_sd_um is not None:
            rounding = self.edge_sd_um
        elif self.fill == "area":
            rounding = 0.0
        elif self.fill == "centre" and self.offset_um is not None and dpi is not None:
            rounding = min(self.offset_sd_um, pixel_um / math.sqrt(12))
        else:
            rounding = pixel_um / math.sqrt(12)
        return 1e-3 * math.hypot(rounding, max(self.growth_sd_um))


UNSTATED: Final = RipModel()


def growth_margin(growth: Inks) -> int:
    """Return how many pixels beyond a band growth looks. [pixels]"""
    return math.ceil(max(map(abs, growth)))


def grown(plates: NDArray[np.uint8], growth: Inks, light: InkLight | None = None) -> NDArray[np.uint8]:
    """Return plates whose shapes of each ink have grown by parts of a pixel.

    The edge of a shape moves by n whole pixels, and the pixel beyond takes the share f of the step in light: an edge's
    mean place moves by exactly n + f. Corners grow as squares. Shapes narrower than twice a negative growth vanish.

    Parameters
    ----------
    plates
        Ink amounts (rows, columns, 4), 0 to 255.
    growth
        Of each ink; negative where shapes shrink. [pixels]
    light
        Light that amounts take (``Press.ink_light``); None: as amounts.

    Returns
    -------
    NDArray
        Ink amounts (rows, columns, 4); ``plates`` itself where nothing grows.
    """
    if not any(growth):
        return plates
    out, bytes_ = plates.copy(), np.arange(256)
    for ink, by in enumerate(growth):
        plate = plates[..., ink]
        if not by or not plate.any():
            continue
        whole, part = int(abs(by)), abs(by) - int(abs(by))
        extreme = np.maximum if by > 0 else np.minimum
        for _ in range(whole):
            plate = _widened(plate, extreme)
        if part:
            curve = (0.0, 1.0) if light is None else light[ink]
            takes = np.interp(bytes_, np.linspace(0, 255, len(curve)), curve)
            wider = _widened(plate, extreme)
            changed = wider != plate
            plate = plate.copy()
            mixed = (1 - part) * takes[plate[changed]] + part * takes[wider[changed]]
            plate[changed] = np.rint(np.interp(mixed, takes, bytes_))
        out[..., ink] = plate
    return out


def _widened(plate: NDArray[np.uint8], extreme: np.ufunc) -> NDArray[np.uint8]:
    """Return the extreme of each pixel and its eight neighbours; beyond the plate its edge goes on."""
    for axis in (0, 1):
        ahead, behind = [slice(None)] * 2, [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        wider = plate.copy()
        extreme(wider[tuple(behind)], plate[tuple(ahead)], out=wider[tuple(behind)])
        extreme(wider[tuple(ahead)], plate[tuple(behind)], out=wider[tuple(ahead)])
        plate = wider
    return plate
