"""Misprints for judging: each changes what it says, by as much as it says, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.errors import RequestError
from prooflight.pages.raster import Page
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.corpus.designs.faces import OutlineFace
from prooflight.simulation.corpus.designs.sheet import Sheet
from prooflight_studies.stress.marks import (
    HAIR_EDGE_MM,
    MARKS,
    SCRATCH_DEG,
    Cast,
    Digit,
    Drawn,
    GlyphExchanged,
    Hair,
    Mark,
    Mottle,
    NotedDigits,
    Scratch,
    TextExchanged,
    draw_mark,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_studies.stress.marks import Compose

DPI = 200.0
SEEDS = range(6)


def even(*ink: int, width_mm: float = 120.0, height_mm: float = 150.0) -> Page:
    """A page of one colour."""
    rows, columns = (round(extent * DPI / 25.4) for extent in (height_mm, width_mm))
    cmyk = np.broadcast_to(np.array(ink, np.uint8), (rows, columns, 4)).copy()
    return Page(cmyk=cmyk, dpi=DPI, name="p0001", number=1)


def numbered() -> Page:
    """A page on which no two pixels are alike, and all are content: row and column are in their inks."""
    page = even(0, 0, 0, 0)
    row, column = np.indices(page.cmyk.shape[:2])
    cmyk = np.stack([row // 256 * 16 + column // 256, row % 256, column % 256, 0 * row + 128], axis=-1)
    return replace(page, cmyk=cmyk.astype(np.uint8))


def drawn(page: Page, mark: Mark, seed: int) -> Drawn:
    before = page.cmyk.copy()
    found = draw_mark(page, mark, rng=stream(seed, "stress-mark", 1, 1, 1))
    assert np.array_equal(page.cmyk, before)
    assert found is not None
    changed = (found.page.cmyk != before).any(axis=2)
    for x, y, width, height in found.regions_mm:
        left, top, right, bottom = (round(each / page.pixel_mm) for each in (x, y, x + width, y + height))
        changed[top:bottom, left:right] = False
    assert not changed.any()  # outside the places that it names
    return found


def undrawn(page: Page, mark: Mark) -> bool:
    return all(draw_mark(page, mark, rng=stream(seed, "stress-mark", 1, 1, 1)) is None for seed in SEEDS)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_hair_is_black_as_long_and_wide_as_it_says_and_off_the_edges(seed: int) -> None:
    """Area to 2 %: 64 points a pixel tell the cover of a mark of 90 x 1.2 pixels."""
    hair, page = Hair(what="", width_mm=0.16, length_mm=12.0, ink_percent=60.0), even(40, 0, 10, 0)
    found = drawn(page, hair, seed)
    assert np.array_equal(found.page.cmyk[..., :3], page.cmyk[..., :3])
    black = found.page.cmyk[..., 3] / 255
    assert black.sum() * page.pixel_mm**2 == pytest.approx(0.6 * 0.16 * 12.0, rel=0.02)
    assert black.max() <= 0.6 + 1 / 255
    ((x, y, width, height),) = found.regions_mm
    assert HAIR_EDGE_MM - 6.5 < x < page.width_mm - HAIR_EDGE_MM + 6.5 - width
    assert HAIR_EDGE_MM - 6.5 < y < page.height_mm - HAIR_EDGE_MM + 6.5 - height
    assert max(width, height) < 12.0 + 2 * page.pixel_mm + 0.2


def test_a_hair_leaves_what_is_darker_and_needs_room() -> None:
    hair = Hair(what="", width_mm=0.16, length_mm=12.0, ink_percent=60.0)
    assert undrawn(even(0, 0, 0, 160), hair)
    assert undrawn(even(0, 0, 0, 0, width_mm=2 * HAIR_EDGE_MM - 1), hair)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_scratch_takes_its_share_of_every_ink_on_a_slanting_line(seed: int) -> None:
    """Area to 3 %, tilt to half a degree: of a mark of 240 x 3 pixels, unless it runs off the page."""
    scratch, page = Scratch(what="", width_mm=0.4, length_mm=30.0, loss_percent=75.0), even(200, 0, 200, 100)
    page.cmyk[:300] = page.cmyk[-300:] = page.cmyk[:, :300] = page.cmyk[:, -300:] = 0
    found = drawn(page, scratch, seed)
    inked = (slice(300, -300), slice(300, -300))
    loss = 1 - found.page.cmyk[inked].astype(float)[..., [0, 2, 3]] / page.cmyk[inked][..., [0, 2, 3]]
    assert loss.max() == pytest.approx(0.75, abs=0.01)
    assert np.abs(loss - loss.mean(axis=2, keepdims=True)).max() < 0.012
    where = np.argwhere(loss[..., 0] > 0.5)
    _, axes = np.linalg.eigh(np.cov(where.T))
    down, across = axes[:, -1]
    assert np.degrees(np.arctan(abs(across / down))) == pytest.approx(SCRATCH_DEG, abs=0.5)
    ((x, y, width, height),) = found.regions_mm
    if min(x, y) > 300 * page.pixel_mm and x + width < 80 and y + height < 110:
        assert loss[..., 0].sum() * page.pixel_mm**2 == pytest.approx(0.75 * 0.4 * 30, rel=0.03)
    assert undrawn(even(0, 0, 0, 0), scratch)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_cast_is_of_one_ink_on_one_half(seed: int) -> None:
    """The mean is kept to 0.1 % by rounding at random."""
    cast, page = Cast(what="", amount_percent=9.0), even(100, 0, 60, 0)
    found = drawn(page, cast, seed)
    ratio = found.page.cmyk[..., [0, 2]] / page.cmyk[..., [0, 2]]
    middle = ratio.shape[1] // 2
    means = np.stack([ratio[:, :middle].mean(axis=(0, 1)), ratio[:, middle:].mean(axis=(0, 1))])
    assert np.count_nonzero(means != 1) == 1
    assert np.abs(means - 1).max() == pytest.approx(0.09, abs=1e-3)
    assert not found.page.cmyk[..., [1, 3]].any()


def test_a_cast_goes_both_ways_and_a_full_ink_can_only_lose() -> None:
    cast = Cast(what="", amount_percent=9.0)
    signs = {
        np.sign(float(drawn(even(100, 0, 0, 0), cast, seed).page.cmyk.mean()) - 25) for seed in range(12)
    }
    assert signs == {-1.0, 1.0}
    assert all(drawn(even(0, 0, 0, 255), cast, seed).page.cmyk.mean() < 63 for seed in SEEDS)
    assert undrawn(even(0, 0, 0, 0), cast)


@pytest.mark.parametrize("seed", SEEDS)
def test_two_windows_are_exchanged(seed: int) -> None:
    page = numbered()
    found = drawn(page, TextExchanged(what="", window_mm=(20.0, 3.0)), seed)
    one, other = (_cut(page, region) for region in found.regions_mm)
    assert np.array_equal(found.page.cmyk[one], page.cmyk[other])
    assert np.array_equal(found.page.cmyk[other], page.cmyk[one])
    assert found.regions_mm[0][2:] == pytest.approx((20.0, 3.0), abs=page.pixel_mm)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_glyph_takes_the_content_of_another_place(seed: int) -> None:
    page = numbered()
    found = drawn(page, GlyphExchanged(what="", window_mm=(2.0, 3.0)), seed)
    (region,) = found.regions_mm
    inks = found.page.cmyk[_cut(page, region)].astype(int)
    row, column = inks[..., 0] // 16 * 256 + inks[..., 1], inks[..., 0] % 16 * 256 + inks[..., 2]
    assert np.ptp(row - np.arange(row.shape[0])[:, None]) == 0
    assert np.ptp(column - np.arange(row.shape[1])) == 0
    assert region[2:] == pytest.approx((2.0, 3.0), abs=page.pixel_mm)
    assert (page.cmyk[_cut(page, region)] != found.page.cmyk[_cut(page, region)]).any()


def test_windows_that_show_the_same_are_not_exchanged() -> None:
    for mark in (
        TextExchanged(what="", window_mm=(20.0, 3.0)),
        GlyphExchanged(what="", window_mm=(2.0, 3.0)),
    ):
        assert undrawn(even(0, 0, 0, 200), mark)
        assert undrawn(even(0, 0, 0, 0), mark)


def test_mottle_scatters_all_inks_alike() -> None:
    """Seed 0, 3,000 grains: rms to 3 % of it (and 1/255 of rounding), half the correlation at half a grain."""
    page = even(120, 0, 60, 0)
    found = drawn(page, Mottle(what="", rms_percent=8.0, grain_mm=2.5), 0)
    change = found.page.cmyk.astype(float) / np.maximum(page.cmyk, 1) - 1
    cyan, yellow = change[..., 0], change[..., 2]
    assert cyan.std() == pytest.approx(0.08, rel=0.03)
    assert abs(cyan.mean()) < 0.005
    assert np.abs(cyan - yellow).max() <= 1 / 60 + 1 / 120
    half = round(1.25 / page.pixel_mm)
    assert np.mean(cyan[half:] * cyan[:-half]) / cyan.var() == pytest.approx(0.5, abs=0.05)
    assert not found.page.cmyk[..., [1, 3]].any()
    assert undrawn(even(0, 0, 0, 0), Mottle(what="", rms_percent=8.0, grain_mm=2.5))


def composed(size_pt: float, text: str, *, under_picture: bool = False) -> Compose:
    """A page with one line of type, composed on whatever sheet it is given."""

    def compose(sheet: Callable[..., Sheet]) -> Page:
        on = sheet(width_mm=60.0, height_mm=20.0, dpi=DPI)
        on.draw_text(5.0, 10.0, text, OutlineFace("DejaVuSans"), size_pt)
        if under_picture:
            on.rect(0.0, 0.0, 60.0, 20.0, (80, 0, 0, 0))
        return Page(cmyk=on.cmyk, dpi=DPI, name="elsewhere", number=1)

    return compose


@pytest.mark.parametrize("seed", SEEDS)
def test_a_digit_becomes_another_of_its_face_and_size(seed: int) -> None:
    """The page is one that sets the line with that digit outright, and differs nowhere else."""
    text, compose = "lot 407 of 12", composed(7.3, "lot 407 of 12")
    page = replace(compose(Sheet), name="p0001")
    rng = stream(seed, "stress-mark", 1, 1, 1)
    found = draw_mark(page, Digit(what="", sizes_pt=(7.0, 9.0)), rng=rng, compose=compose)
    assert found is not None
    assert (found.page.name, found.variant) == ("p0001", "7 pt")
    slips = [
        text[:at] + digit + text[at + 1 :]
        for at, letter in enumerate(text)
        if letter.isdigit()
        for digit in "0123456789"
        if digit != letter
    ]
    assert sum(np.array_equal(found.page.cmyk, composed(7.3, slip)(Sheet).cmyk) for slip in slips) == 1
    ((x, y, width, height),) = found.regions_mm
    assert width < 7.3 * 25.4 / 72
    assert height < 7.3 * 25.4 / 72
    changed = (found.page.cmyk != page.cmyk).any(axis=2)
    assert changed.any()
    changed[_cut(page, (x, y, width, height))] = False
    assert not changed.any()


def test_a_digit_needs_one_of_its_size_that_is_seen_on_a_composed_page() -> None:
    digit, rng = Digit(what="", sizes_pt=(7.0,)), stream(1, "stress-mark", 1, 1, 1)
    for compose in (
        composed(7.0, "no number"),
        composed(8.0, "at 8 points 8"),
        composed(7.0, "407", under_picture=True),
    ):
        assert draw_mark(compose(Sheet), digit, rng=rng, compose=compose) is None
    with pytest.raises(RequestError, match=r"misprint\.digit: a raster alone"):
        draw_mark(even(0, 0, 0, 255), digit, rng=rng)
    assert list(MARKS)[-1] == "digit"


@pytest.mark.parametrize("index", [0, 3, 5])
def test_a_design_is_the_same_on_a_sheet_that_notes_its_digits(index: int) -> None:
    designs = Corpus(seed=4, dpi=60.0)
    assert np.array_equal(designs.page(index, sheet=NotedDigits().sheet).cmyk, designs.page(index).cmyk)


def _cut(page: Page, region: tuple[float, float, float, float]) -> tuple[slice, slice]:
    x, y, width, height = (round(each / page.pixel_mm) for each in region)
    return slice(y, y + height), slice(x, x + width)
