"""The offset of two sensors is found from what both saw of a page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.errors import ScanError
from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.scans.placement import Placement
from prooflight_studies.cameras.camera_offset import camera_offset

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

    MakePage = Callable[..., Page]


@pytest.mark.parametrize(("lines", "pixels"), [(3.4, -0.3), (-17.75, 5.5), (0.0, 0.0), (140.2, -11.6)])
@pytest.mark.parametrize("sensor", [0, 1])
def test_an_offset_is_found_from_what_two_sensors_saw(
    two_sensor_press: Press, make_page: MakePage, lines: float, pixels: float, sensor: int
) -> None:
    """The second sees other colours. Errors on made pages of these seeds: up to 0.03 of a line."""
    press, page, rng = two_sensor_press, make_page(5), stream(3, "lost-lines")
    shift = pixels * press.geometry.pixel_pitch_mm, lines * press.geometry.line_pitch_mm
    seen = []
    for place, at in ((Placement(), 0), (Placement(shift_mm=shift), sensor)):
        one = predict(page, sensors=press.sensors, geometry=press.geometry, placement=place)
        noise = rng.standard_normal(one.expected_dn[at].shape) * np.sqrt(one.variance_dn2[at])
        seen.append(np.rint(np.clip(one.expected_dn[at] + noise, 0, 65535)).astype(np.uint16))
    found = camera_offset(*seen)
    assert found.lines == pytest.approx(lines, abs=0.05)
    assert found.pixels == pytest.approx(pixels, abs=0.05)
    assert found.lines == pytest.approx(lines, abs=5 * found.lines_sd)
    assert 0 < found.lines_sd < 0.03
    assert found.offset.lines == found.lines


def test_blank_paper_tells_no_offset() -> None:
    rng = stream(4, "lost-lines")
    first, second = rng.integers(90, 110, (2, 400, 300)).astype(np.uint16)
    with pytest.raises(
        ScanError, match=r"^A and B: shows the same edges to both sensors in .* let a page of text"
    ):
        camera_offset(first, second, where="A and B")
