"""Picture of the difference between the paper's world and a press: one place of one good page, printed in both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from prooflight.detectors.base import BLOCK_PIXELS, Area, Inspection
from prooflight.reporting import wording
from prooflight.reporting.pictures import encoded, error_colours, signals
from prooflight.spectra import srgb_encoded

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Verdict
    from prooflight.press.artefact import Press

WINDOW: Final = (18 * BLOCK_PIXELS, 24 * BLOCK_PIXELS)
"""Lines and camera pixels that are shown: 15 x 20 mm at the prototype's pitch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One of the pictures, with its caption."""

    title: str
    caption: str
    verdict: str
    """Verdict, or empty if none was made."""
    picture: bytes
    """Image as WebP."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoWorlds:
    """The pictures side by side; all show the same place."""

    page: str
    width_mm: float
    panels: tuple[Panel, ...]


def two_worlds(
    *, ideal: Inspection, plain: Inspection, matched_filter: Inspection, press: Press
) -> TwoWorlds | None:
    """Compare a good page's print in the ideal world and one in the press world.

    ideal, plain: inspections of the two by chi-square; matched_filter: of the second by that detector. None if the
    page is smaller than the window.
    """
    _, measured = signals(plain, press)
    if min(np.subtract(measured.shape, WINDOW)) < 0:
        return None
    window = _busiest(measured)
    seen = Image.fromarray((255 * srgb_encoded(measured[window].clip(0, 1))).astype(np.uint8))
    paper, of_matched_filter = plain.verdict, matched_filter.verdict
    return TwoWorlds(
        page=plain.verdict.page,
        width_mm=WINDOW[1] * press.geometry.pixel_pitch_mm,
        panels=(
            Panel(
                title="Good print",
                caption="A section of it, as the camera sees it.",
                verdict="",
                picture=encoded(seen),
            ),
            Panel(
                title="Ideal world",
                caption="Each pixel, compared with the camera's noise: the difference is noise alone. "
                f"{_scores_text('Chi-square', ideal.verdict)}",
                verdict=ideal.verdict.verdict,
                picture=_coloured(_pixel_z(ideal)[window]),
            ),
            Panel(
                title="Press world",
                caption="The same: register, dot gain and light change every edge and tint by far more than noise. "
                + _scores_text("Chi-square", paper),
                verdict=paper.verdict,
                picture=_coloured(_pixel_z(plain)[window]),
            ),
            Panel(
                title="Matched filter",
                caption="The variation of good prints is removed; the rest, in standard deviations of good prints. "
                + _scores_text("Matched filter", of_matched_filter),
                verdict=of_matched_filter.verdict,
                picture=_coloured(_block_z(matched_filter, plain.area, window)),
            ),
        ),
    )


def _scores_text(who: str, verdict: Verdict) -> str:
    score, threshold = wording.score(verdict.score), wording.score(verdict.threshold)
    return f"{who}: score {score}, alarm above {threshold}."


def _busiest(signal: NDArray[np.float32]) -> Area:
    """Return the window of (lines, pixels) in which the signal changes most."""
    change = np.abs(np.diff(signal, axis=0)[:, :-1]) + np.abs(np.diff(signal, axis=1)[:-1])
    height, width = WINDOW
    sums = cv2.integral(change.astype(np.float64))
    inside = sums[height - 1 :, width - 1 :] - sums[: -height + 1, width - 1 :]
    inside = inside - (sums[height - 1 :, : -width + 1] - sums[: -height + 1, : -width + 1])
    top, left = np.unravel_index(int(inside.argmax()), inside.shape)
    return slice(int(top), int(top) + height), slice(int(left), int(left) + width)


def _pixel_z(inspection: Inspection) -> NDArray[np.float32]:
    """Return the first sensor's measured minus expected signal, in standard deviations of the camera's noise."""
    expected = inspection.expect()
    off = inspection.measured_dn[0] - expected.expected_dn[0]
    return np.asarray(off / np.sqrt(expected.variance_dn2[0]), np.float32)


def _block_z(inspection: Inspection, area: Area, window: Area) -> NDArray[np.float32]:
    """Return ``Inspection.block_z`` at the pixels of a window of another area of the same scan."""
    z = inspection.block_z[0]
    places = [
        np.clip((np.arange(part.start, part.stop) + of.start - own.start) // BLOCK_PIXELS, 0, blocks - 1)
        for part, of, own, blocks in zip(window, area, inspection.area, z.shape, strict=True)
    ]
    return np.asarray(z[np.ix_(*places)], np.float32)


def _coloured(z: NDArray[np.float32]) -> bytes:
    return encoded(Image.fromarray(np.rint(error_colours(z)).astype(np.uint8)), lossless=True)
