"""Why the two worlds differ, in one picture: on a small page, by chi-square alone."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from prooflight.inspection.inspector import Inspector
from prooflight.prediction.predict import predict
from prooflight.reporting.pictures import error_colours
from prooflight.reporting.two_worlds import WINDOW, two_worlds
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


def inspected(press: Press, page: Page, *, ink: float = 1.0) -> Inspection:
    """A print with so many times the ink, the noise of the camera, and nothing else."""
    printed = replace(page, cmyk=(ink * page.cmyk.astype(np.float32)).astype(np.uint8))
    seen = predict(printed, sensors=press.sensors, geometry=press.geometry)
    scan = ideal_scan(seen, press, np.random.default_rng(3))
    return Inspector.of(press, "chi-square").inspect(page, scan)


def pixels(picture: bytes) -> NDArray[np.float64]:
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), np.float64)


def test_noise_is_white_in_one_world_and_what_is_printed_stands_out_in_the_other(
    press: Press, page: Page
) -> None:
    """Beyond 5 standard deviations lies 6e-7 of noise: of 27,648 pixels none in 98 of 100 seeds."""
    ideal, pale = inspected(press, page), inspected(press, page, ink=0.8)
    found = two_worlds(ideal=ideal, plain=pale, matched_filter=ideal, press=press)
    assert found is not None
    seen, white, off, blocks = found.panels
    assert {pixels(panel.picture).shape for panel in found.panels} == {(*WINDOW, 3)}
    assert [panel.verdict for panel in found.panels] == ["", "good", "misprint", "good"]
    assert pixels(seen.picture).std() > 20  # the place with the most content, not blank paper
    least = error_colours(np.float32([-5.0, 5.0])).min()
    assert (pixels(white.picture).min(axis=2) >= least - 1).all()
    assert (pixels(off.picture).min(axis=2) < least - 1).mean() > 0.05
    assert f"score {pale.verdict.score:,.0f}" in off.caption
    squares = pixels(blocks.picture)
    assert len(np.unique(squares.reshape(-1, 3), axis=0)) <= np.prod([side // 8 + 1 for side in WINDOW])


def test_a_page_smaller_than_the_window_has_no_such_picture(
    press: Press, make_page: Callable[..., Page]
) -> None:
    small = inspected(press, make_page(7, width_mm=15.0, height_mm=30.0))
    assert two_worlds(ideal=small, plain=small, matched_filter=small, press=press) is None
