"""# Write a detector

A detector is two things: what it prepares of a page before the page is printed, and what that says of a scan. Here is
a plain one: squares of 8 x 8 pixels that are lighter or darker than predicted by more than a limit. It follows no
page that moves, so it is of use where pages lie still.

A package of yours registers it by an entry point, and `prooflight inspect --detector squares`, `watch`, the journal
and the studies use it like their own:

    [project.entry-points."prooflight.detectors"]
    squares = "my_package:detector"
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import prooflight as pf
from prooflight.detectors.verdict import Region
from prooflight.simulation.corpus.corpus import Corpus

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import StoredArrays


@dataclass(frozen=True, slots=True, kw_only=True)
class Squares(pf.ContextDetector):
    """Alarms where the mean of a square is off by more than `limit` of paper white."""

    limit: float = 0.05
    name: str = "squares"
    guarantee: str = "none: the limit was chosen by eye"

    def prepare(self, planned: pf.PlannedPage) -> PreparedSquares:
        """The prediction is all that this detector needs."""
        return PreparedSquares(page=planned.page, expected=planned.expected, detector=self)

    def decision(self, worst: float) -> pf.Decision:
        """What the worst square, as a share of paper white, comes to."""
        return pf.Decision(
            misprint=worst > self.limit, score=worst, threshold=self.limit, p_value=None, probability=None
        )

    def decided_again(self, kept: StoredArrays) -> pf.Decision:
        """The journal keeps the worst square."""
        return self.decision(float(kept.array("worst", "f", (), finite=True)))


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedSquares(pf.PreparedOnly):
    """One page, predicted."""

    page: pf.Page
    expected: pf.Prediction
    detector: Squares

    def inspect(self, scan: pf.Scan, *, seed: int = 0) -> pf.Inspection:
        """The worst square decides."""
        press_context = self.detector.press_context
        area = press_context.geometry.on_page(self.page.width_mm, self.page.height_mm)
        part = (slice(None), *area)
        measured, expected = scan.dn[part], self.expected.expected_dn[part]
        noise = np.sqrt(self.expected.variance_dn2[part])
        white = np.array([sensor.white_dn for sensor in press_context.sensors])[:, None, None]
        off = squares(measured - expected)
        share = np.abs(off / white).max(axis=0)
        worst = float(share.max())
        decision = self.detector.decision(worst)
        row, column = np.unravel_index(share.argmax(), share.shape)
        wide_mm, high_mm = (
            8 * one for one in (press_context.geometry.pixel_pitch_mm, press_context.geometry.line_pitch_mm)
        )
        corner = {"x_mm": column * wide_mm, "y_mm": row * high_mm}
        place = Region(**corner, width_mm=wide_mm, height_mm=high_mm, score=worst, kind="spots-voids")
        return pf.Inspection(
            verdict=pf.Verdict.from_decision(
                self.page.name,
                decision,
                kind=place.kind if decision.misprint else None,
                regions=(place,) if decision.misprint else (),
                detector=self.detector.name,
            ),
            placement=pf.IN_PLACE,
            area=area,
            measured_dn=measured,
            block_z=(8 * off / squares(noise)).astype(np.float32),
            expect=lambda: pf.Prediction(expected_dn=expected, variance_dn2=noise**2),
            stored_arrays={"wrong_page": np.array(False), "worst": np.array(worst)},
        )


def squares(image: NDArray[Any]) -> NDArray[np.float64]:
    """Means over squares of 8 x 8 pixels of (sensors, lines, pixels)."""
    sensors, lines, pixels = image.shape[0], image.shape[1] // 8, image.shape[2] // 8
    whole = image[:, : lines * 8, : pixels * 8].reshape(sensors, lines, 8, pixels, 8)
    return np.asarray(whole.mean(axis=(2, 4), dtype=np.float64))


def detector(press: pf.Press) -> pf.Detector:
    """What the entry point names."""
    return Squares(press_context=press.press_context())


def main(out: Path) -> None:
    """A good print, and one with voids."""
    press = pf.build_press(pf.PressFile.prototype(), seed=1, pixels=400)
    page = replace(Corpus(seed=5, dpi=95.0).page(5), dpi=press.dpi)
    inspector = pf.Inspector(press, detector(press))
    for name, misprint in (("good", None), ("spots", "spots-voids:0.9")):
        found = inspector.inspect(page, pf.simulate(page, press, misprint=misprint))
        found.show()
        found.picture().save(out / f"{name}.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]))  # the folder for what is drawn; without one, this folder
