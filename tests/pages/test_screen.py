"""Screens print the mean that is asked, at their ruling and angle, and nothing on paper and in solids."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from prooflight.pages.screen import Screen, blue_noise, screened

AM = Screen(kind="am", dpi=1200.0, lpi=175.0)
FM = Screen(kind="fm", dpi=1200.0)
DIFFUSION = Screen(kind="error-diffusion", dpi=1200.0)
SIDE = 512
TONE = (tuple((np.linspace(0, 1, 33) ** 0.7).tolist()),) * 4
"""A curve of light as printed dots have it: they gain."""


def tint(amount: int, side: int = SIDE) -> np.ndarray:
    return np.full((side, side, 4), amount, np.uint8)


# AM: over 75 cells the dots' edges fall on the grid of pixels as if at random, to 0.0001; where the lattice is not
# turned (Y), at 48 phases alone, which leaves up to 0.0035. FM: 16 whole tiles of 2^14 thresholds.
# Error diffusion: what is left over at the last row and column, and where it begins.
@pytest.mark.parametrize(
    ("screen", "tolerance"),
    [
        (AM, 0.004),
        (FM, 0.0005),
        (DIFFUSION, 0.001),
        (Screen(kind="am", dpi=1200.0, lpi=133.0, dot="euclidean"), 0.004),
    ],
)
@pytest.mark.parametrize("amount", [5, 26, 128, 230])
def test_a_tint_covers_its_share(screen: Screen, tolerance: float, amount: int) -> None:
    printed = screened(tint(amount), screen)
    assert set(np.unique(printed)) <= {0, 255}
    np.testing.assert_allclose(printed.mean(axis=(0, 1)) / 255, amount / 255, atol=tolerance)


def test_a_tint_covers_the_light_that_it_takes() -> None:
    printed = screened(tint(128), FM, tone=TONE)
    assert printed.mean() / 255 == pytest.approx(
        np.interp(128 / 255, np.linspace(0, 1, 33), TONE[0]), abs=5e-4
    )


@pytest.mark.parametrize("bits", [2, 4])
@pytest.mark.parametrize("kind", ["fm", "error-diffusion"])
def test_levels_are_those_next_to_the_tint_and_their_mean_is_its_light(bits: int, kind: Any) -> None:
    printed = screened(tint(100), Screen(kind=kind, dpi=600.0, bits=bits), tone=TONE)
    levels = np.rint(np.linspace(0, 255, 2**bits))
    below = levels[levels <= 100].max()
    assert set(np.unique(printed)) == {below, levels[levels > below].min()}
    light = np.interp(np.arange(256) / 255, np.linspace(0, 1, 33), TONE[0])
    assert light[printed].mean() == pytest.approx(light[100], abs=1e-3)


@pytest.mark.parametrize("screen", [AM, FM, DIFFUSION])
def test_paper_and_solids_have_no_specks(screen: Screen) -> None:
    plates = tint(77)
    plates[:, 100:200] = 0
    plates[:, 300:400] = 255
    printed = screened(plates, screen)
    assert not printed[:, 100:200].any()
    assert (printed[:, 300:400] == 255).all()


@pytest.mark.parametrize(("ink", "angle"), list(enumerate(AM.angles_deg)))
def test_am_has_its_ruling_at_its_angle(ink: int, angle: float) -> None:
    size = 2048
    printed = screened(tint(100, size), AM)[..., ink].astype(np.float64)
    window = np.outer(np.hanning(size), np.hanning(size))
    spectrum = np.abs(np.fft.fft2((printed - printed.mean()) * window))
    row, column = np.unravel_index(spectrum[:, : size // 2].argmax(), (size, size // 2))
    down = (row + size // 2) % size - size // 2
    step = AM.dpi / size  # of the spectrum, 0.6 lines an inch
    assert np.hypot(down, column) * step == pytest.approx(AM.lpi, abs=step)
    found = np.degrees(np.arctan2(-down, column))  # rows run downwards
    assert abs((found - angle + 45) % 90 - 45) < 0.3  # a step at that distance; the lattice is square


def test_blue_noise_has_little_at_low_frequencies() -> None:
    dots = (blue_noise() < 65535 // 5).astype(np.float64)
    power = np.abs(np.fft.fft2(dots - dots.mean())) ** 2
    along = np.fft.fftfreq(len(dots))
    radius = np.hypot(along, along[:, None])
    # White noise of a fifth has this power everywhere; Ulichney 1993: below the principal frequency, its root, little.
    white = 0.2 * 0.8 * dots.size
    assert power[(radius > 0) & (radius < 0.15)].mean() < 0.05 * white
    assert len(np.unique(blue_noise())) == blue_noise().size


@pytest.mark.parametrize("screen", [AM, FM])
def test_bands_are_parts_of_the_whole(screen: Screen) -> None:
    plates = np.random.default_rng(1).integers(0, 256, (96, 80, 4), dtype=np.uint8)
    whole = screened(plates, screen)
    band = screened(np.ascontiguousarray(plates[37:, 11:]), screen, origin=(37, 11))
    # A lattice's place is rounded to 2^-32 of a cell, which moves hardly any pixel over its threshold.
    assert (band != whole[37:, 11:]).mean() < 1e-3


def test_a_screen_may_write_over_its_plates_but_not_past_them() -> None:
    plates = tint(90)
    expected = screened(plates, AM)
    assert screened(plates, AM, out=plates) is plates
    np.testing.assert_array_equal(plates, expected)
    with pytest.raises(ValueError, match="C-contiguous"):
        screened(plates[:, ::2], AM)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": "stochastic", "dpi": 1200.0}, "kind must be"),
        ({"kind": "am", "dpi": 1200.0}, "lpi must be above 0"),
        ({"kind": "am", "dpi": 300.0, "lpi": 175.0}, "at most half of the device's 300 dpi"),
        ({"kind": "fm", "dpi": 1200.0, "lpi": 175.0}, "lpi goes with kind am"),
        ({"kind": "fm", "dpi": 0.0}, "dpi must be above 0"),
        ({"kind": "fm", "dpi": 1200.0, "bits": 8}, "bits must be 1, 2, 4"),
        ({"kind": "am", "dpi": 1200.0, "lpi": 175.0, "dot": "star"}, "dot must be"),
        ({"kind": "am", "dpi": 1200.0, "lpi": 175.0, "angles_deg": (15.0, 75.0)}, "four numbers"),
    ],
)
def test_what_is_no_screen_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Screen(**fields)
