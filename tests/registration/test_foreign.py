"""What a scan shows that its design does not foretell. Seeds fixed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.registration.coarse import shrunk
from prooflight.registration.foreign import coarse_inside, foreign_print
from prooflight.registration.register import FOREIGN_PAGE, FOREIGN_PRINT, FOREIGN_WIDTH, prepare, register
from prooflight.scans.placement import Placement
from prooflight.simulation.misprints.kinds import KINDS, draw_misprint
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight.registration.register import Registration

    MakePage = Callable[..., Page]

OFF = Placement(shift_mm=(0.4, -0.3))
SEEDS = (7, 23, 24, 25)


def scan_of(page: Page, press: Press, placement: Placement = OFF) -> NDArray[np.uint16]:
    seen = predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement, threads=1)
    return ideal_scan(seen, press, np.random.default_rng(1))


def sought(page: Page, scan: NDArray[np.uint16], press: Press) -> Registration:
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    return register(prepare(page, expected, sensors=press.sensors, geometry=press.geometry), scan)


def turned(page: Page) -> Page:
    return replace(page, cmyk=np.ascontiguousarray(page.cmyk[::-1, ::-1]))


def text(seed: int) -> Page:
    """Lines of type on one grid: words and spaces differ, nothing else does."""
    rng = np.random.default_rng(seed)
    cmyk = np.zeros((835, 683, 4), np.uint8)
    for top in range(60, 770, 80):
        for column in range(50, 620, 8):
            if rng.random() < 0.5 and (column // 8) % rng.integers(4, 9):
                cmyk[top : top + 36, column : column + 6, 3] = 255
    return Page(cmyk=cmyk, dpi=481.8, name="p0001", number=1)


@pytest.mark.parametrize("seed", SEEDS)
def test_another_page_is_foreign_and_not_turned(press: Press, make_page: MakePage, seed: int) -> None:
    other = turned(make_page(seed + 40))  # or its tints lay where this one's do
    found = sought(make_page(seed), scan_of(other, press), press)
    assert found.foreign
    assert not found.turned


@pytest.mark.parametrize("seed", SEEDS)
def test_a_page_turned_by_180_degrees_is_known(press: Press, make_page: MakePage, seed: int) -> None:
    page = make_page(seed)
    whole = np.ascontiguousarray(
        scan_of(page, press)[:, ::-1, ::-1]
    )  # the scan, or the sheet under the camera
    for scan in (scan_of(turned(page), press), whole):
        found = sought(page, scan, press)
        assert found.foreign
        assert found.turned


@pytest.mark.parametrize("seed", SEEDS)
def test_other_lines_on_the_same_grid_are_foreign(press: Press, seed: int) -> None:
    assert sought(text(seed), scan_of(text(seed + 40), press), press).foreign
    assert not sought(text(seed), scan_of(text(seed), press), press).foreign


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"wrong-page"}))
def test_no_other_misprint_is_foreign_however_severe(press: Press, make_page: MakePage, kind: str) -> None:
    for seed in SEEDS:
        page, rng = make_page(seed), np.random.default_rng(seed)
        drawn = draw_misprint(page, kind, 1.0, others=(), fetch=make_page, rng=rng)
        assert not sought(page, scan_of(drawn.page, press), press).foreign


def test_a_page_of_one_ink_that_lacks_it_shows_nothing_foreign(press: Press, make_page: MakePage) -> None:
    black = make_page(7)
    black.cmyk[..., :3] = 0
    blank = replace(black, cmyk=np.zeros_like(black.cmyk))
    assert not sought(black, scan_of(blank, press), press).foreign
    # a page where a blank one was expected is another page; a streak on it is not
    assert sought(blank, scan_of(text(1), press), press).foreign
    streak = replace(blank, cmyk=blank.cmyk.copy())
    streak.cmyk[:, 300:340, 3] = 150
    assert not sought(blank, scan_of(streak, press), press).foreign


def test_a_form_that_differs_in_one_field_is_the_same_page(press: Press) -> None:
    form = text(3)
    filled = replace(form, cmyk=form.cmyk.copy())
    filled.cmyk[220:256, 50:400] = text(90).cmyk[220:256, 50:400]
    found = sought(form, scan_of(filled, press), press)
    assert found.located
    assert not found.foreign


def test_strength_and_a_little_displacement_are_foretold(press: Press, make_page: MakePage) -> None:
    page = make_page(7)
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    design = shrunk(expected.expected_dn, press.sensors)
    inside = coarse_inside(press.geometry, page.width_mm, page.height_mm)
    moved = np.roll(design, (2, -1), axis=(0, 1))
    faded = moved + np.float32(0.6) * (moved.mean() - moved)
    assert foreign_print(faded, design, inside).of_print < 0.2
    longer, shorter = np.pad(design, ((0, 9), (0, 0))), design[:-4]
    for other in (longer, shorter):
        assert foreign_print(other, design, inside).of_print < 0.2
    noise = np.random.default_rng(2).random(design.shape, np.float32)
    assert (
        np.array(foreign_print(noise, design, inside)) > (FOREIGN_PRINT, FOREIGN_PAGE, FOREIGN_WIDTH)
    ).all()
    assert foreign_print(noise[:9], design[:9], inside) == (0, 0, 0)  # too small for a square
    tiny = coarse_inside(press.geometry, 2.0, 2.0)  # a page smaller than its edges
    assert foreign_print(noise, design, tiny) == (0, 0, 0)
