"""Parameters of a RIP: closed forms of growth, of edges' variance and of the grid, and values that are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from prooflight.errors import PressFileError
from prooflight.pages.pdf.rip_model import UNSTATED, RipModel, grown
from prooflight.press.press_file import PressFile


@pytest.mark.parametrize("growth", [-2.25, -0.5, 0.3, 1.0, 2.75])
def test_an_edge_moves_by_the_growth_whatever_its_place_in_a_pixel(growth: float) -> None:
    plates = np.zeros((40, 40, 4), np.uint8)
    plates[10:30, 12:28, 3] = 255
    plates[10:30, 28, 3] = 102  # the right edge lies 0.4 of a pixel further
    row = grown(plates, (0.0, 0.0, 0.0, growth))[20, :, 3].astype(float) / 255
    assert row.sum() == pytest.approx(16.4 + 2 * growth, abs=2 / 255)
    column = grown(plates, (0.0, 0.0, 0.0, growth))[:, 20, 3].astype(float) / 255
    assert column.sum() == pytest.approx(20 + 2 * growth, abs=2 / 255)


def test_growth_takes_its_share_of_light_not_of_ink() -> None:
    light = ((0.0, 0.7, 1.0),) * 4  # half an ink takes 0.7 of the light
    plates = np.zeros((9, 9, 4), np.uint8)
    plates[:, :4, 0] = 255
    beyond = grown(plates, (0.5, 0.0, 0.0, 0.0), light)[4, 4, 0] / 255
    assert np.interp(beyond, [0, 0.5, 1], [0.0, 0.7, 1.0]) == pytest.approx(0.5, abs=0.01)


def test_nothing_grows_where_nothing_is_stated() -> None:
    plates = np.zeros((4, 4, 4), np.uint8)
    assert grown(plates, UNSTATED.growth_pixels(1200)) is plates


def test_edges_lie_anywhere_in_a_pixel_unless_their_place_is_known() -> None:
    pixel_mm = 25.4 / 1200
    assert UNSTATED.edge_sd_mm(1200) == pytest.approx(pixel_mm / 12**0.5)
    assert UNSTATED.edge_sd_mm(None) == pytest.approx(25.4 / 600 / 12**0.5)
    assert RipModel(fill="area").edge_sd_mm(1200) == 0
    assert RipModel(fill="centre").edge_sd_mm(1200) == pytest.approx(pixel_mm / 12**0.5)
    assert RipModel(fill="centre", offset_um=(0, 0), offset_sd_um=2).edge_sd_mm(1200) == pytest.approx(0.002)
    grows = RipModel(edge_sd_um=3, growth_um=(0, 0, 0, 9), growth_sd_um=(0, 1, 0, 4))
    assert grows.edge_sd_mm(1200) == pytest.approx(0.005)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('fill = "any-part"', "dpi must be stated"),
        ('dpi = 1200\nengine = "ghostscript"\nfill = "centre"', "draws by its own rule"),
        ("dpi = 1200\ngrowth_um = [1, 2]", "of C, M, Y and K"),
        ("dpi = 1200\ngrowth_um = [0, 0, 0, 1000]", "from -200 to 200"),
        ("dpi = 1200\ngrowth_sd_um = [0, 0, 0, 1]", "goes with growth_um"),
        ('dpi = 1200\nfill = "odd"', "'centre', 'any-part' or 'area'"),
        ("dpi = 1200\nleast_line_um = nan", "rip.least_line_um"),
        ('dpi = 1200\n[screen]\nkind = "am"\ndpi = 1200', "lpi must be above 0"),
    ],
)
def test_a_value_that_can_be_none_is_refused_in_one_line(lines: str, message: str) -> None:
    with pytest.raises(PressFileError, match=message) as error:
        PressFile(Path("x.toml"), f"{PressFile.prototype().text}\n[rip]\n{lines}\n")
    assert "\n" not in str(error.value)
