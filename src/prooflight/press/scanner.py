"""Press file of an office scanner: the preset ``scanner.toml``, for a resolution, a width, and grey or RGB."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prooflight.pages.raster import MM_PER_INCH
from prooflight.press.press_file import PressFile, preset_text

if TYPE_CHECKING:
    from prooflight.press.artefact import Press
    from prooflight.scans.scanner.feeder import FeederPrior

PRESET: Final = "scanner.toml"
PRESET_DPI: Final = 150.0
"""Resolution of the preset. Finer scans are averaged over whole pixels down to it: what a device sharpens, and a
printer's own fuzz, is then no difference of a print. [pixels/inch]"""
WIDTHS_MM: Final = (216.0, 304.0)
"""Widths of field, so that one trained press serves most jobs: Letter and A4, Tabloid and A3."""
GREY: Final = "green"
"""Sensor that stands for a grey scan: green carries 72 % of sRGB's luminance."""
LUMINANCE_CD_M2: Final = 8900.0
"""Luminance of the preset, for pixels of its resolution."""
UM_PER_MM: Final = 1000
MAGNIFICATION: Final = 600 / (5466 - 600)
"""Size of a pixel over the place that it sees, by the preset's lens. [-]"""


def press_dpi(scan_dpi: float) -> float:
    """Return the resolution at which scans of ``scan_dpi`` are inspected: theirs, or a whole part of it."""
    return scan_dpi / max(1, round(scan_dpi / PRESET_DPI))


def field_mm(sizes_mm: Sequence[tuple[float, float]]) -> float:
    """Return the width of field for pages of these widths and heights, each upright or turned by a quarter."""
    widest = max(min(size) for size in sizes_mm)
    return next((width for width in WIDTHS_MM if widest <= width), widest)


def scanner_press_text(*, dpi: float = PRESET_DPI, grey: bool = False, width_mm: float = WIDTHS_MM[0]) -> str:
    """Return the text of the press file of an office scanner.

    Parameters
    ----------
    dpi
        Resolution at which scans are inspected, ``press_dpi``. [pixels/inch]
    grey
        Whether scans are grey: the press then has one sensor.
    width_mm
        Width of the field.
    """
    text = preset_text(PRESET)
    if grey:
        head, *sensors = text.split("[[sensor]]")
        rest = sensors[-1][sensors[-1].index("[transport]") :]
        grey_block = next(one for one in sensors if f'name = "{GREY}"' in one)
        text = f"{head}[[sensor]]{grey_block}{rest}"
    pitch_mm = MM_PER_INCH / dpi
    numbers = {
        "pixels": f"{math.ceil(width_mm / pitch_mm)}",
        "pixel_pitch_um": f"{UM_PER_MM * MAGNIFICATION * pitch_mm:.4f}",
        # A larger pixel takes more light: paper then fills as much of the swing at any resolution.
        "luminance_cd_m2": f"{LUMINANCE_CD_M2 * (dpi / PRESET_DPI) ** 2:.1f}",
    }
    for name, number in numbers.items():
        text = re.sub(rf"^{name} = [0-9.]+", f"{name} = {number}", text, flags=re.MULTILINE)
    return text


def scanner_press_file(*, dpi: float, grey: bool, width_mm: float) -> PressFile:
    """Return the press file of an office scanner; see ``scanner_press_text``."""
    return PressFile(Path(PRESET), scanner_press_text(dpi=dpi, grey=grey, width_mm=width_mm))


def feeder_of(press: Press) -> FeederPrior:
    """Return the feeder that the press's file states, or that of the preset."""
    text = press.origin.get("press_file", "")
    stated = PressFile(Path(press.name), text).feeder if text else None
    feeder = stated or PressFile.preset(PRESET).feeder
    assert feeder is not None
    return feeder
