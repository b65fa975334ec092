"""The signal chain of an office scanner: how a page's light becomes a file's numbers, and what is uncertain of it.

Toner spreads beyond its outline, the device blurs and sharpens, and stores numbers for the eye. The print's outline
grows by some micrometres; a small symmetric kernel then stands for optics and sharpening, both in linear light; the
numbers are sRGB's (IEC 61966-2-1), clipped at black and white.

``DrawnDetector`` compares scans with the page itself, drawn as that scanner would show a good print of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.base import Inspection, PlannedPage, PreparedOnly, PressContext
from prooflight.detectors.golden.detector import Golden, GoldenDetector, GoldenSheet, PictureDetector
from prooflight.detectors.placing import WRONG_PAGE_KIND
from prooflight.detectors.verdict import Verdict
from prooflight.errors import RequestError
from prooflight.scans.scan import Scan

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel

GROWN_PIXELS: Final = 2
"""Greatest growth, in pixels of the page's raster: 85 um at 600 dpi. assumed: laser printers spread less."""
RINGS: Final = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
"""Offsets of a kernel's parts, each with all its mirror images. [pixels]"""
SRGB_TOE: Final = 0.0031308
"""Light up to which sRGB's curve is straight. [-]"""
UM_PER_MM: Final = 1000
NAME: Final = "drawn"
GUARANTEE: Final = "none: docs/results/detector/real.md states how often sheets of two real copies alarm"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalChain:
    """Chain of one device and printer, as fitted to sheets."""

    growth_um: float
    """Growth of what is printed, on each side."""
    growth_sd_um: float
    """Its standard deviation."""
    kernels: NDArray[np.float64]
    """(channels, rings) weights by which the darkness of each ring's mean counts; they add up to 1. [-]"""
    edge_sd: float
    """Standard deviation of a pixel's number, as a share of what the page varies by within a pixel of it. [-]"""
    sheets: int
    """Number of sheets to whose edges it was fitted."""

    def numbers(self, grown: NDArray[np.float32], raster_mm: float) -> NDArray[np.float32]:
        """Return the numbers, 0 to 1, that are expected of a page.

        Parameters
        ----------
        grown
            Light of the page for each growth, ``grown_light``, (growths, channels, lines, pixels). [paper]
        raster_mm
            Pixel of the page's raster.
        """
        dark = 1 - between(grown, self.growth_um / UM_PER_MM / raster_mm)
        light = [
            1 - np.tensordot(np.asarray(kernel, np.float32), rings(one), axes=1)
            for kernel, one in zip(self.kernels, dark, strict=True)
        ]
        return to_numbers(np.stack(light))

    def spread(self, numbers: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the standard deviation of each of the ``numbers`` that are expected, by the chain's uncertainty."""
        square = np.ones((3, 3), np.uint8)
        return np.stack(
            [np.float32(self.edge_sd) * (cv2.dilate(one, square) - cv2.erode(one, square)) for one in numbers]
        )


def to_numbers(light: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the numbers of sRGB for light, both 0 to 1 and clipped there."""
    whole = np.clip(light, 0, 1).astype(np.float32)
    curved = np.float32(1.055) * np.power(np.maximum(whole, SRGB_TOE), np.float32(1 / 2.4)) - np.float32(
        0.055
    )
    return np.where(whole <= SRGB_TOE, np.float32(12.92) * whole, curved)


def slope_of_numbers(light: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the slope of ``to_numbers`` at light, as if it were not clipped at white. [-]"""
    curved = 1.055 / 2.4 * np.power(np.maximum(light, SRGB_TOE), 1 / 2.4 - 1)
    return np.asarray(np.where(light <= SRGB_TOE, 12.92, curved), np.float64)


def rings(dark: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the mean of each ring about each pixel of one channel (lines, pixels), (rings, lines, pixels)."""
    return np.stack(
        [cv2.filter2D(dark, -1, _ring(*offset), borderType=cv2.BORDER_REPLICATE) for offset in RINGS]
    )


def _ring(down: int, across: int) -> NDArray[np.float32]:
    kernel = np.zeros((5, 5), np.float32)
    for y, x in ((down, across), (across, down)):
        for one in (-1, 1):
            kernel[2 + one * y, 2 + x] = kernel[2 + one * y, 2 - x] = 1
    return kernel / np.float32(kernel.sum())


def between(grown: NDArray[np.float32], pixels: float) -> NDArray[np.float32]:
    """Return light for a growth of so many pixels of the raster, (channels, lines, pixels), between its neighbours."""
    below = min(int(pixels), len(grown) - 2)
    share = np.float32(pixels - below)
    return np.asarray(grown[below] * (1 - share) + grown[below + 1] * share, np.float32)


def grown_light(page: Page, press_context: PressContext) -> NDArray[np.float32]:
    """Return the light that is expected of a page whose print has grown by 0, 1 and 2 pixels of its raster.

    A flat tint does not grow: it has no outline. Returns (growths, channels, lines, pixels) [paper], at most 1.
    """
    cmyk, cross = page.cmyk, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    lights = []
    for _ in range(GROWN_PIXELS + 1):
        expected = press_context.predict(replace(page, cmyk=cmyk))
        lights.append(np.clip(bare_light(expected, press_context.sensors), 0, 1))
        cmyk = cv2.dilate(cmyk, cross)
    return np.stack(lights)


def bare_light(expected: Prediction, sensors: Sequence[SensorModel]) -> NDArray[np.float32]:
    """Return the light of a prediction, of bare columns, (channels, lines, pixels). [paper]"""
    return light_of(expected.expected_dn, sensors)


def light_of(dn: NDArray[np.generic], sensors: Sequence[SensorModel]) -> NDArray[np.float32]:
    """Return the light of a camera's numbers (channels, lines, pixels) [DN], of bare columns. [paper]"""
    return np.stack(
        [
            (lines - one.column_offset_dn) / (one.column_gain * np.float32(one.white_dn))
            for lines, one in zip(dn.astype(np.float32), sensors, strict=True)
        ]
    ).astype(np.float32, copy=False)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnDetector(PictureDetector):
    """Detector that compares with the page as the chain of a scanner would show it."""

    chains: Mapping[str, SignalChain]
    """Chains by page name; under the empty name: of every page that has none of its own."""
    name: str = NAME
    guarantee: str = GUARANTEE

    def prepare(self, planned: PlannedPage) -> DrawnSheet:
        """See ``Detector``; RequestError: nothing states the chain of this page."""
        page = planned.page
        chain = self.chains.get(page.name) or self.chains.get("")
        if chain is None:
            remedy = "scan more of its pages, or choose --detector matched_filter"
            raise RequestError(page.name, "no sheet shows how its scanner reproduces print", remedy=remedy)
        numbers = chain.numbers(grown_light(page, self.press_context), page.pixel_mm)
        golden = Golden(name=page.name, light=numbers, spread=chain.spread(numbers))
        pictures = replace(
            self.press_context, sensors=()
        )  # the drawn page is compared with numbers, not with light
        sheet = GoldenDetector(press_context=pictures, goldens={page.name: golden}).prepare(planned)
        return DrawnSheet(
            golden=replace(sheet, is_drawn=True), sensors=self.press_context.sensors, expected=planned
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnSheet(PreparedOnly):
    """One page as its scan should look."""

    golden: GoldenSheet
    sensors: tuple[SensorModel, ...]
    expected: PlannedPage

    def residual_pixels(self, scan: Scan) -> float:
        """See ``GoldenSheet``."""
        return self.golden.residual_pixels(self._picture(scan))

    def _picture(self, scan: Scan) -> Scan:
        numbers: NDArray[np.float32] = to_numbers(light_of(scan.dn, self.sensors))
        return Scan(dn=numbers, name=scan.name)

    def inspect(self, scan: Scan, *, seed: int = 0) -> Inspection:
        """See ``PreparedPage``. A scan that cannot be laid on its page is not inspected."""
        done = self.golden.inspect(self._picture(scan))
        verdict = done.verdict
        if verdict.kind == WRONG_PAGE_KIND:
            verdict = Verdict.skipped(verdict.page, f"the page could not be placed: {verdict.reason}")
            verdict = replace(verdict, detector=NAME)
        else:
            reason = verdict.reason.replace("the golden", "the page").replace("its golden", "its page")
            verdict = replace(verdict, detector=NAME, reason=reason)
        planned = self.expected
        return replace(
            done, verdict=verdict, measured_dn=scan.dn[:, *done.area], expect=lambda: planned.expected
        )
