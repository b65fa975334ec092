"""# Write a detector

A detector is two things: what it prepares of a page before the page is printed, and what that says of a scan. Here is a
plain one: squares of 8 x 8 pixels that are lighter or darker than predicted by more than a limit. It follows no page
that moves, so it is of use where pages lie still.

A package of yours registers it by an entry point, and `prooflight inspect --detector squares`, `watch`, the journal and
the studies use it like their own:

    [project.entry-points."prooflight.detectors"]
    squares = "my_package:squares"
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import prooflight as pf


@dataclass(frozen=True, slots=True, kw_only=True)
class Squares(pf.StationDetector):
    """Alarms where the mean of a square is off by more than `limit` of paper white."""

    limit: float = 0.05
    name: str = "squares"
    promise: str = "none: the limit was chosen by eye"

    def prepare(self, planned: pf.PlannedPage) -> PreparedSquares:
        """The prediction is all that this detector needs."""
        return PreparedSquares(page=planned.page, expected=planned.expected, detector=self)


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedSquares(pf.PreparedOnly):
    """One page, predicted."""

    page: pf.Page
    expected: pf.Prediction
    detector: Squares

    def inspect(self, scan: pf.Scan, *, seed: int = 0) -> pf.Inspection:
        """The worst square decides."""
        station = self.detector.station
        area = station.geometry.on_page(self.page.width_mm, self.page.height_mm)
        measured = scan.dn[(slice(None), *area)]
        expected = self.expected.expected_dn[(slice(None), *area)]
        white = np.array([sensor.white_dn for sensor in station.sensors])[:, None, None]
        off = squares(measured - expected) / white
        worst = float(np.abs(off).max())
        decision = pf.Decision(
            misprint=worst > self.detector.limit,
            score=worst,
            threshold=self.detector.limit,
            p_value=None,
            probability=None,
        )
        return pf.Inspection(
            verdict=pf.Verdict.from_decision(self.page.name, decision, detector=self.detector.name),
            placement=pf.IN_PLACE,
            area=area,
            measured_dn=measured,
            block_z=off.astype(np.float32),
            expect=lambda: pf.Prediction(expected_dn=expected, variance_dn2=np.ones_like(expected)),
        )


def squares(image: np.ndarray) -> np.ndarray:
    """Means over squares of 8 x 8 pixels of (sensors, lines, pixels)."""
    sensors, lines, pixels = image.shape[0], image.shape[1] // 8, image.shape[2] // 8
    whole = image[:, : lines * 8, : pixels * 8].reshape(sensors, lines, 8, pixels, 8)
    return np.asarray(whole.mean(axis=(2, 4)))


def detector(press: pf.Press) -> pf.Detector:
    """What the entry point names."""
    return Squares(station=press.station())
