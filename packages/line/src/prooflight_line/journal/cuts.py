"""Stored parts of a sheet's scan, as signal of which bare paper is 1, and as shades of a screen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np

from prooflight.spectra import srgb_encoded
from prooflight_line.journal.arrays import NAME, unpacked

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Region
    from prooflight.press.artefact import Press

MOST_CUTS: Final = 16
MOST_CUT: Final = 1200
"""Pixels along the longer side of a scan of an unknown page."""
LEAST_RANGE: Final = 0.1
"""Least range of light that a thumbnail's contrast is stretched from: a smaller one would show noise alone."""
AROUND: Final = 3.0
"""Range of light of a thumbnail, in multiples of the defect's contrast."""
_SHOWN: Final = srgb_encoded(np.linspace(0, 1, 4097)).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cut:
    """A stored part of the scan."""

    signal: NDArray[np.float32]
    """(lines, pixels), bare paper 1."""
    box_mm: tuple[float, float, float, float]
    """x, y, width and height on the page as printed."""
    region: int | None = None
    """Index of the verdict's region that it shows; None: it shows the whole sheet."""
    moved_mm: tuple[float, float] = (0.0, 0.0)
    """Displacement by ``aligned``. [mm]"""


def cuts_of(
    evidence: Mapping[str, NDArray[Any]] | None,
    press: Press | None,
    *,
    page_width_mm: float | None,
    shift_mm: tuple[float, float] | None,
) -> tuple[Cut, ...]:
    """Return the stored cuts of the first sensor; without a press the brightest of each counts as paper."""
    cuts = []
    for index in range(MOST_CUTS):
        stored, where = ((evidence or {}).get(f"cut{index}{end}") for end in ("", "_mm"))
        if stored is None or where is None:
            break
        box = np.asarray(where, float).ravel()
        if (
            stored.ndim != 3
            or not stored.size
            or box.size != 4
            or not np.isfinite(box).all()
            or min(box[2:]) <= 0
        ):
            continue
        x, y, width, height = (float(part) for part in box)
        light = stored[0].astype(np.float32)
        signal = signal_of(light, (x, width), press, page_width_mm=page_width_mm, shift_mm=shift_mm)
        cuts.append(Cut(signal=signal, box_mm=(x, y, width, height), region=index))
    return tuple(cuts)


def signal_of(
    light: NDArray[np.float32],
    across_mm: tuple[float, float],
    press: Press | None,
    *,
    page_width_mm: float | None,
    shift_mm: tuple[float, float] | None,
) -> NDArray[np.float32]:
    """Return a part of the first sensor's scan (lines, pixels) [DN] as signal, bare paper 1.

    across_mm: x on the page as printed, and width. Without press or page the brightest is taken for paper.
    """
    if press is None or page_width_mm is None:
        return np.asarray(light / max(float(np.percentile(light, 99.5)), 1.0), np.float32)
    sensor, geometry = press.sensors[0], press.geometry
    off_mm = geometry.left_mm(page_width_mm) + (shift_mm or (0.0, 0.0))[0]
    first = round((across_mm[0] + off_mm) / geometry.pixel_pitch_mm)
    step = max(round(across_mm[1] / geometry.pixel_pitch_mm / light.shape[1]), 1)  # halved: 2
    columns = np.clip(first + step * np.arange(light.shape[1]), 0, geometry.pixels - 1)
    scale = sensor.column_gain[columns] * sensor.white_dn
    return np.asarray((light - sensor.column_offset_dn[columns]) / scale, np.float32)


def whole_cut(
    evidence: Mapping[str, NDArray[Any]] | None, press: Press | None, **told: Any
) -> tuple[Cut, ...]:
    """Return the whole scan as one coarse cut; none if it is not stored. told: see ``signal_of``."""
    read = None if evidence is None or NAME not in evidence else whole_scan(evidence)
    if read is None:
        return ()
    light, box = read
    signal = signal_of(light, (box[0], box[2]), press, **told)
    scale = min(MOST_CUT / max(signal.shape), 1.0)
    size = max(round(signal.shape[1] * scale), 1), max(round(signal.shape[0] * scale), 1)
    return (
        Cut(
            signal=cv2.resize(signal, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0]),
            box_mm=box,
        ),
    )


def whole_scan(
    evidence: Mapping[str, NDArray[Any]],
) -> tuple[NDArray[np.float32], tuple[float, float, float, float]] | None:
    """Return a whole scan [DN] with x, y, width and height on the page [mm]; None: none that can be read is stored."""
    light, where = unpacked(evidence), evidence.get(f"{NAME}_mm")
    if light is None or where is None:
        return None
    box = np.asarray(where, float).ravel()
    if box.size != 4 or not np.isfinite(box).all() or min(box[2:]) <= 0 or np.abs(box).max() > 1e4:
        return None
    x, y, width, height = box.tolist()
    return light, (x, y, width, height)


def stretched(cut: Cut, region: Region | None) -> NDArray[np.float32]:
    """Return a cut as shades of a screen, 0..1, in which the defect's contrast is at least a third of the range.

    The range is ``AROUND`` times the difference of the medians inside and outside of the region, and lies about both;
    it is never wider than from black to paper. A whole sheet is shown as it is.
    """
    light = shown(cut.signal)
    if region is None:
        return light
    within = inside(cut, region)
    if within.all() or not within.any():
        low, high = (float(one) for one in np.quantile(cv2.GaussianBlur(light, (0, 0), 1.0), (0.02, 0.98)))
        spread = high - low
    else:
        low, high = sorted((float(np.median(light[within])), float(np.median(light[~within]))))
        spread = AROUND * (high - low)
    spread = min(max(spread, LEAST_RANGE), 1.0)
    begin = min(max((low + high - spread) / 2, 0.0), 1.0 - spread)
    return np.asarray((light - begin) / spread, np.float32)


def inside(cut: Cut, region: Region, *, margin_mm: float = 0.0) -> NDArray[np.bool_]:
    """Return which pixels of a cut are in a region, or within a margin of it."""
    lines, pixels = cut.signal.shape
    x, y, width, height = cut.box_mm
    across = x + (np.arange(pixels) + 0.5) * width / pixels - region.x_mm
    down = y + (np.arange(lines) + 0.5) * height / lines - region.y_mm
    within, between = (
        (at >= -margin_mm) & (at <= extent + margin_mm)
        for at, extent in ((across, region.width_mm), (down, region.height_mm))
    )
    return np.asarray(between[:, None] & within)


def shown(signal: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ``srgb_encoded`` of 0..1 by a table: a tile has a quarter of a million pixels."""
    return np.asarray(_SHOWN[(np.clip(signal, 0, 1) * (_SHOWN.size - 1)).astype(np.intp)])
