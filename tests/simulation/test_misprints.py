"""Each misprint changes the page where it says it does, as much as it says, and nowhere else."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prooflight.cmyk import INK_NAMES
from prooflight.pages.raster import Page
from prooflight.scans.placement import IN_PLACE
from prooflight.simulation.misprints.kinds import KINDS, Drawn, draw_misprint
from prooflight.simulation.worlds import worlds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SEEDS = st.integers(0, 2**32)
SEVERITIES = st.floats(0, 1)
DPI = 50.8  # half a millimetre a pixel
FEW = settings(max_examples=40)
CORNERS = (np.array([0.0, 0.0, 40.0, 40.0]), np.array([0.0, 50.0, 0.0, 50.0]))
SIZE = {"page_width_mm": 40.0, "page_height_mm": 50.0}


def random_page(seed: int, *, rows: int = 110, columns: int = 84, number: int = 1) -> Page:
    cmyk = np.random.default_rng(seed).integers(0, 256, (rows, columns, 4)).astype(np.uint8)
    return Page(cmyk=cmyk, dpi=DPI, name=f"p{number:04}", number=number)


def tint(*levels: int, rows: int = 240, columns: int = 200, dpi: float = DPI) -> Page:
    cmyk = np.tile(np.array(levels, np.uint8), (rows, columns, 1))
    return Page(cmyk=cmyk, dpi=dpi, name="p0001", number=1)


def fetch(number: int) -> Page:
    return random_page(1000 + number, rows=90 + 7 * number, columns=60 + 9 * number, number=number)


def drawn(page: Page, kind: str, severity: float, seed: int, others: tuple[int, ...] = (2, 3)) -> Drawn:
    return draw_misprint(page, kind, severity, others=others, fetch=fetch, rng=np.random.default_rng(seed))


def draws(page: Page, kind: str, severity: float, says: str, *, seeds: int = 60) -> Iterator[Drawn]:
    """Those of many draws whose detail says something; at least one."""
    found = [
        one for seed in range(seeds) if says in (one := drawn(page, kind, severity, seed)).misprint.detail
    ]
    assert found
    yield from found


def box(page: Page, region_mm: tuple[float, float, float, float]) -> tuple[slice, slice]:
    """A region in raster pixels: rows, columns."""
    x, y, width, height = (round(v / page.pixel_mm) for v in region_mm)
    return slice(y, y + height), slice(x, x + width)


def changed_inks(page: Page, one: Drawn) -> list[int]:
    return [ink for ink in range(4) if (one.page.cmyk[..., ink] != page.cmyk[..., ink]).any()]


# --- what holds for every kind ---


def test_the_kinds_are_those_of_the_file_in_its_order() -> None:
    assert list(KINDS) == [entry["kind"] for entry in worlds()["misprint"]]


@pytest.mark.parametrize("kind", KINDS)
@FEW
@given(seed=SEEDS, severity=SEVERITIES)
def test_a_misprint_changes_its_region_only(kind: str, seed: int, severity: float) -> None:
    page = random_page(seed)
    kept = page.cmyk.copy()
    one = drawn(page, kind, severity, seed)
    printed, misprint = one.page, one.misprint
    np.testing.assert_array_equal(page.cmyk, kept)  # the page given stays good
    assert (misprint.kind, misprint.severity) == (kind, severity)
    assert misprint.scope == {entry["kind"]: entry["scope"] for entry in worlds()["misprint"]}[kind]
    assert misprint.detail
    assert (printed.dpi, printed.name, printed.number) == (page.dpi, page.name, page.number)
    assert printed.cmyk.shape == page.cmyk.shape
    assert printed.cmyk.flags.c_contiguous
    outside = np.ones(page.cmyk.shape[:2], bool)
    for region in misprint.regions_mm or (misprint.region_mm,):
        outside[box(page, region)] = False
    np.testing.assert_array_equal(printed.cmyk[outside], page.cmyk[outside])
    x, y, width, height = misprint.region_mm
    assert x >= 0
    assert y >= 0
    assert x + width <= page.width_mm + 0.0011  # three decimals each
    assert y + height <= page.height_mm + 0.0011
    for spot in misprint.regions_mm:
        rows, columns = box(page, spot)
        around_rows, around_columns = box(page, misprint.region_mm)
        assert around_rows.start <= rows.start < rows.stop <= around_rows.stop
        assert around_columns.start <= columns.start < columns.stop <= around_columns.stop


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("severity", [0.0, 1.0])
@FEW
@given(seed=SEEDS, rows=st.integers(1, 12), columns=st.integers(1, 12))
def test_a_page_of_any_size_can_be_misprinted(
    kind: str, severity: float, seed: int, rows: int, columns: int
) -> None:
    page = random_page(seed, rows=rows, columns=columns)
    assert drawn(page, kind, severity, seed).page.cmyk.shape == (rows, columns, 4)


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_misprint(kind: str) -> None:
    page = random_page(1)
    first, again, *others = (drawn(page, kind, 0.6, seed) for seed in (5, 5, 6, 7, 8))
    np.testing.assert_array_equal(first.page.cmyk, again.page.cmyk)
    assert first.misprint == again.misprint
    np.testing.assert_array_equal(
        first.placement.seen_mm(*CORNERS, **SIZE), again.placement.seen_mm(*CORNERS, **SIZE)
    )
    assert any(
        one.misprint.detail != first.misprint.detail or (one.page.cmyk != first.page.cmyk).any()
        for one in others
    )


def off_place_mm(one: Drawn) -> float:
    """How far the page's corners are off at most. [mm]"""
    x, y = one.placement.seen_mm(*CORNERS, **SIZE)
    return float(np.hypot(x - CORNERS[0], y - CORNERS[1]).max())


@pytest.mark.parametrize("kind", KINDS)
def test_more_severe_is_more_change(kind: str, make_page: Callable[..., Page]) -> None:
    """The same draws at four severities, on pages like those of real jobs."""
    rms, off = np.zeros(4), np.zeros(4)
    for seed in range(6):
        page = make_page(seed, dpi=127.0)
        for place, severity in enumerate((0.0, 0.3, 0.6, 1.0)):
            one = drawn(page, kind, severity, seed, others=(2, 3))
            change = one.page.cmyk.astype(float) - page.cmyk
            rms[place] += (change**2).mean()
            off[place] += off_place_mm(one)
    if kind == "wrong-page":
        assert (np.diff(off) > 0).all()
        assert (np.diff(rms) >= 0).all()
    else:
        assert (np.diff(rms) > 0).all()
        assert not off.any()


@pytest.mark.parametrize("kind", KINDS)
def test_severity_changes_amounts_alone(kind: str, make_page: Callable[..., Page]) -> None:
    """The rest of what follows from one seed, inks, way and number, does not depend on it."""
    page = make_page(3, dpi=127.0)
    for seed in range(4):
        told = {
            re.sub(
                r"[0-9]+\.?[0-9]*( ?%| mm| x| degrees)", "", drawn(page, kind, severity, seed).misprint.detail
            )
            for severity in (0.0, 0.5, 1.0)
        }
        assert len(told) == 1


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"wrong-page", "scum", "streak", "spots-voids"}))
def test_a_blank_page_has_nothing_to_lose(kind: str) -> None:
    page = tint(0, 0, 0, 0)
    for seed in range(5):
        one = drawn(page, kind, 1.0, seed)
        np.testing.assert_array_equal(one.page.cmyk, page.cmyk)


@pytest.mark.parametrize("kind", KINDS)
def test_inks_that_the_page_lacks_are_left_alone(kind: str) -> None:
    page = tint(0, 0, 0, 100)
    page.cmyk[::7] = 0
    if kind in ("swapped-planes", "wrong-page"):
        return  # another ink, or another page, comes where it should not
    for seed in range(8):
        assert set(changed_inks(page, drawn(page, kind, 0.9, seed))) <= {3}


@pytest.mark.parametrize("kind", KINDS)
def test_the_truth_can_be_written_down(kind: str) -> None:
    misprint = drawn(random_page(1), kind, 0.5, 3).misprint
    assert json.loads(json.dumps(asdict(misprint)))["kind"] == kind


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"wrong-page"}))
def test_only_a_wrong_page_lies_elsewhere(kind: str) -> None:
    assert all(drawn(random_page(1), kind, 0.5, seed).placement is IN_PLACE for seed in range(5))


# --- planes ---


@FEW
@given(seed=SEEDS, severity=SEVERITIES)
def test_a_missing_plane_is_one_ink_scaled(seed: int, severity: float) -> None:
    page = random_page(seed)
    one = drawn(page, "missing-plane", severity, seed)
    (ink,) = changed_inks(page, one)
    left = 0.75 * (1 - severity)  # linear from 75 % to nothing
    rows, columns = box(page, one.misprint.region_mm)
    assert columns == slice(0, page.cmyk.shape[1])
    band = "band" in one.misprint.detail
    fade = 10 if band else 0  # 5 mm
    inside = slice(rows.start + fade, rows.stop - fade)
    want = page.cmyk[inside, :, ink] * left
    np.testing.assert_allclose(one.page.cmyk[inside, :, ink], want, atol=1)
    assert INK_NAMES[ink] in one.misprint.detail
    if band:
        assert page.height_mm / 4 - page.pixel_mm <= one.misprint.region_mm[3]
    else:
        assert rows == slice(0, len(page.cmyk))


def test_a_faint_tint_keeps_its_mean() -> None:
    """Rounded at random: 7 % of a tint of 4 in 255 is a quarter of a byte's step."""
    page = tint(4, 4, 4, 4, rows=300, columns=300)
    one = next(draws(page, "density", 0.0, "much"))
    inks = changed_inks(page, one)
    values = one.page.cmyk[..., inks].astype(float)
    n = values[..., 0].size
    # a share 0.28 of pixels one step up: its standard error, five times
    assert values.mean(axis=(0, 1)) == pytest.approx(4.28, abs=5 * np.sqrt(0.28 * 0.72 / n) + 1e-3)
    error = values[..., 0] - values[..., 0].mean()
    for other in (error[:, 1:] * error[:, :-1], error[1:] * error[:-1], error[9:] * error[:-9]):
        assert other.mean() / error.var() == pytest.approx(0, abs=5 / np.sqrt(n))


@pytest.mark.parametrize("severity", [0.0, 0.5, 1.0])
def test_density_is_a_gain_either_way(severity: float) -> None:
    page = tint(40, 90, 120, 60)
    gain = 0.07 * (0.40 / 0.07) ** severity
    for says, change in (("much", 1 + gain), ("little", 1 - gain)):
        for one in draws(page, "density", severity, says, seeds=12):
            inks = changed_inks(page, one)
            assert len(inks) == (4 if "all inks" in one.misprint.detail else 1)
            means = one.page.cmyk.mean(axis=(0, 1))
            assert means[inks] == pytest.approx(page.cmyk[0, 0][inks] * change, abs=0.02)


def test_a_full_solid_cannot_take_more() -> None:
    page = tint(0, 0, 0, 255)
    assert all("little" in drawn(page, "density", 0.5, seed).misprint.detail for seed in range(20))


@FEW
@given(seed=SEEDS, severity=SEVERITIES)
def test_two_planes_are_exchanged_in_part(seed: int, severity: float) -> None:
    page = random_page(seed)
    one = drawn(page, "swapped-planes", severity, seed)
    a, b = changed_inks(page, one)
    mixed = 0.15 * (1 / 0.15) ** severity
    before = page.cmyk.astype(float)
    for ink, other in ((a, b), (b, a)):
        want = before[..., ink] * (1 - mixed) + before[..., other] * mixed
        np.testing.assert_allclose(one.page.cmyk[..., ink], want, atol=1.001)
    assert INK_NAMES[a] in one.misprint.detail
    assert INK_NAMES[b] in one.misprint.detail


def test_black_text_can_come_out_in_another_ink() -> None:
    page = tint(0, 0, 0, 200)
    one = drawn(page, "swapped-planes", 1.0, 3)
    (ink,) = set(changed_inks(page, one)) - {3}
    assert (one.page.cmyk[..., ink] == 200).all()
    assert not one.page.cmyk[..., 3].any()


@FEW
@given(seed=SEEDS, severity=SEVERITIES)
def test_one_plane_is_displaced_and_its_bleed_follows(seed: int, severity: float) -> None:
    page = random_page(seed, rows=60, columns=60)
    page = Page(cmyk=page.cmyk, dpi=254.0, name="p0001", number=1)  # 0.1 mm a pixel
    one = drawn(page, "plane-register", severity, seed)
    (ink,) = changed_inks(page, one)
    before, after = page.cmyk[..., ink], one.page.cmyk[..., ink]
    shift = 2.0 * 7.5**severity  # 0.20 to 1.5 mm, in pixels
    reach = range(-16, 17)
    moved = [
        (down, right)
        for down in reach
        for right in reach
        if (after[16:44, 16:44] == before[16 - down : 44 - down, 16 - right : 44 - right]).all()
    ]
    assert len(moved) == 1
    assert np.hypot(*moved[0]) == pytest.approx(shift, abs=0.71)
    down, right = moved[0]
    rows = np.clip(np.arange(60) - down, 0, 59)
    columns = np.clip(np.arange(60) - right, 0, 59)
    np.testing.assert_array_equal(after, before[np.ix_(rows, columns)])


def test_one_ink_alone_cannot_be_out_of_register() -> None:
    page = tint(0, 0, 0, 0)
    page.cmyk[20:50, 20:50, 3] = 255
    assert not changed_inks(page, drawn(page, "plane-register", 1.0, 1))


@pytest.mark.parametrize("severity", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("says", ["waves", "dark lines", "light lines"])
def test_bands_repeat_along_the_travel_with_the_gain_asked_for(severity: float, says: str) -> None:
    page = tint(120, 120, 120, 120, rows=2400, columns=120, dpi=254.0)  # 240 mm: six of the longest periods
    gain = 0.02 * 12.5**severity
    one = next(draws(page, "banding", severity, says))
    ink = changed_inks(page, one)[0]
    relative = one.page.cmyk[..., ink].mean(axis=1) / 120 - 1
    # of 120 pixels: sd of rounding 0.5 / sqrt(120), five times, beside half a pixel's lag
    noise = 5 * 0.5 / 120 / np.sqrt(120)
    assert relative.max() == pytest.approx(0 if says == "light lines" else gain, abs=noise + 0.01 * gain)
    assert relative.min() == pytest.approx(0 if says == "dark lines" else -gain, abs=noise + 0.01 * gain)
    period_mm = float(one.misprint.detail.rsplit("every ")[1].split()[0])
    assert 2 <= period_mm <= 40
    spectrum = np.abs(np.fft.rfft(relative - relative.mean(), 2**16))
    found_mm = 0.1 * 2**16 / spectrum.argmax()
    assert found_mm == pytest.approx(period_mm, rel=0.05)
