"""Photons to digital numbers in closed form. Statistical tests: seed 5, five standard errors of what is estimated."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special

from prooflight.camera.sensor import (
    FixedPattern,
    LineSensor,
    Noise,
    clipped_gaussian,
    draw_fixed_pattern,
    read_out,
)

ERRORS = 5


def sensor(**changes: Any) -> LineSensor:
    fields: dict[str, Any] = {
        "name": "mono",
        "pixels": 300,
        "pixel_pitch_um": 13.0,
        "fill_factor": 0.9,
        "tdi_stages": 96,
        "line_rate_hz": 2770.0,
        "conversion_gain_uv_per_e": 10.0,
        "voltage_swing_v": 2.0,
        "read_noise_e": 30.0,
        "dark_current_e_per_s": 500.0,
        "dsnu_e": 40.0,
        "prnu_percent": 1.0,
        "bits": 12,
        "black_level_dn": 0,
        "quantum_efficiency": np.full(36, 0.4),
    }
    return LineSensor(**fields | changes)


def even(one: LineSensor) -> FixedPattern:
    return FixedPattern(gain=np.ones(one.pixels), offset_e=np.zeros(one.pixels))


def lines_of(one: LineSensor, electrons: float, lines: int = 2000) -> np.ndarray:
    return np.broadcast_to(np.float64(electrons), (lines, one.pixels))


def test_exposure_is_stages_over_line_rate() -> None:
    assert sensor().exposure_s == pytest.approx(96 / 2770)
    assert sensor().dark_e == pytest.approx(500 * 96 / 2770)
    assert sensor().full_well_e == pytest.approx(200_000)
    assert sensor().dn_per_e == pytest.approx(4096 / 200_000)
    assert sensor().top_code_dn == 4095


def test_electrons_in_closed_form() -> None:
    flux = 2e13  # photons s-1 m-2 nm-1, the same in each of 36 bands of 10 nm
    want = flux * 0.4 * 360 * (13e-6) ** 2 * 0.9 * 96 / 2770
    assert sensor().electrons(np.full(36, flux)) == pytest.approx(want, rel=1e-12)


@pytest.mark.parametrize(
    "changes", [{"tdi_stages": 192}, {"line_rate_hz": 1385.0}, {"quantum_efficiency": np.full(36, 0.8)}]
)
def test_twice_the_stages_time_or_efficiency_gives_twice_the_electrons(changes: dict[str, Any]) -> None:
    irradiance = np.linspace(1e12, 3e13, 36)
    ratio = sensor(**changes).electrons(irradiance) / sensor().electrons(irradiance)
    assert ratio == pytest.approx(2, rel=1e-12)


def test_electrons_go_with_the_pixels_area_and_fill_factor() -> None:
    irradiance = np.linspace(1e12, 3e13, 36)
    base = sensor().electrons(irradiance)
    assert sensor(pixel_pitch_um=26.0).electrons(irradiance) / base == pytest.approx(4, rel=1e-12)
    assert sensor(fill_factor=0.45).electrons(irradiance) / base == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize(
    ("volts", "dn"),
    [
        (0.0, 0),
        (0.499 / 128, 0),
        (0.5 / 128, 1),  # half a step rounds up
        (1.5 / 128, 2),
        (2.5 / 128, 3),  # and not to even
        (1.0, 128),
        (254.5 / 128, 255),
        (2.0, 255),  # 256 steps, but the top code is 255
        (7.0, 255),
        (-0.1, 0),
    ],
)
def test_quantise_rounds_half_up_and_clips_to_the_swing(volts: float, dn: int) -> None:
    one = sensor(bits=8)
    assert one.quantise(volts) == dn
    assert one.quantise(np.array([volts])).dtype == np.uint16


@pytest.mark.parametrize(("volts", "dn"), [(0.0, 10), (-5 / 128, 5), (-20 / 128, 0), (1.0, 138), (1.95, 255)])
def test_the_black_level_is_added_before_clipping(volts: float, dn: int) -> None:
    assert sensor(bits=8, black_level_dn=10).quantise(volts) == dn


@given(st.integers(1, 16), st.lists(st.floats(-1, 3), min_size=2, max_size=20))
def test_quantise_never_falls_and_errs_by_half_a_code_inside_the_range(bits: int, volts: list[float]) -> None:
    one = sensor(bits=bits)
    volts_v = np.sort(volts)
    dn = one.quantise(volts_v).astype(float)
    assert (np.diff(dn) >= 0).all()
    step_v = 2.0 / 2**bits
    inside = (volts_v >= 0) & (volts_v < 2.0 - step_v / 2)
    assert (np.abs(dn - volts_v / step_v)[inside] <= 0.5 + 1e-9).all()


def test_without_noise_lines_are_signal_plus_dark() -> None:
    one = sensor(prnu_percent=50.0, dsnu_e=5000.0)
    pattern = draw_fixed_pattern(one, np.random.default_rng(5))
    dn = read_out(
        one, lines_of(one, 50_000.0, 3), pattern=pattern, rng=np.random.default_rng(5), noise=Noise.NONE
    )
    assert (dn == round((50_000 + one.dark_e) * one.dn_per_e)).all()


@pytest.mark.parametrize(
    ("noise", "variance_e2"),
    [
        (Noise.SHOT, 50_000 + 500 * 96 / 2770),
        (Noise.READ, 900.0),
        (Noise.TEMPORAL, 50_000 + 500 * 96 / 2770 + 900),
    ],
)
def test_each_temporal_source_alone(noise: Noise, variance_e2: float) -> None:
    one = sensor()
    dn = read_out(
        one, lines_of(one, 50_000.0), pattern=even(one), rng=np.random.default_rng(5), noise=noise
    ).astype(float)
    want = variance_e2 * one.dn_per_e**2 + 1 / 12
    n = dn.size
    mean_error = np.sqrt(want / n)
    assert dn.mean() == pytest.approx((50_000 + one.dark_e) * one.dn_per_e, abs=ERRORS * mean_error)
    assert dn.var() == pytest.approx(want, rel=ERRORS * np.sqrt(2 / n) + 2e-3)  # 2e-3: Sheppard at sigma 0.6
    # temporal noise: lines and columns are all alike
    assert np.corrcoef(dn[0], dn[1])[0, 1] == pytest.approx(0, abs=ERRORS / np.sqrt(one.pixels))


@pytest.mark.parametrize("noise", [Noise.PRNU, Noise.DSNU])
def test_a_fixed_pattern_alone_is_the_same_on_every_line(noise: Noise) -> None:
    one = sensor()
    pattern = draw_fixed_pattern(one, np.random.default_rng(5))
    dn = read_out(
        one, lines_of(one, 50_000.0, 20), pattern=pattern, rng=np.random.default_rng(6), noise=noise
    )
    assert (dn == dn[0]).all()
    even_e = 50_000 + one.dark_e
    charge = even_e * pattern.gain if noise is Noise.PRNU else even_e + pattern.offset_e
    np.testing.assert_allclose(dn[0], charge * one.dn_per_e, atol=0.5 + 1e-6)
    assert np.ptp(dn[0]) > 2


def test_a_drawn_fixed_pattern_has_the_stated_spread() -> None:
    one = sensor(pixels=20_000)
    pattern = draw_fixed_pattern(one, np.random.default_rng(5))
    error = ERRORS / np.sqrt(2 * one.pixels)
    assert pattern.gain.mean() == pytest.approx(1, abs=ERRORS * 0.01 / np.sqrt(one.pixels))
    assert pattern.gain.std() == pytest.approx(0.01, rel=error)
    assert pattern.offset_e.mean() == pytest.approx(0, abs=ERRORS * 40 / np.sqrt(one.pixels))
    assert pattern.offset_e.std() == pytest.approx(40, rel=error)
    assert np.corrcoef(pattern.gain, pattern.offset_e)[0, 1] == pytest.approx(
        0, abs=ERRORS / np.sqrt(one.pixels)
    )


def test_all_sources_together_have_the_ensemble_variance_and_each_column_the_temporal_one() -> None:
    one = sensor(pixels=4000)
    electrons = np.array(100_000.0)
    pattern = draw_fixed_pattern(one, np.random.default_rng(5))
    dn = read_out(one, lines_of(one, 100_000.0, 100), pattern=pattern, rng=np.random.default_rng(6)).astype(
        float
    )
    rounding = 1 / 12
    total = one.variance_total_e2(electrons) * one.dn_per_e**2 + rounding
    temporal = one.variance_temporal_e2(electrons) * one.dn_per_e**2 + rounding
    # the fixed pattern rests on 4000 columns only
    assert dn.var() == pytest.approx(total, rel=ERRORS * np.sqrt(2 / one.pixels))
    # PRNU scales temporal noise as well: by 1 + p^2 on average, 1e-4 here
    within = dn.var(axis=0, ddof=1).mean()
    assert within == pytest.approx(temporal, rel=ERRORS * np.sqrt(2 / dn.size) + 2e-4)


def test_same_seed_same_lines() -> None:
    one = sensor()
    first, again, other = (
        read_out(one, lines_of(one, 9e4, 5), pattern=even(one), rng=np.random.default_rng(seed))
        for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_read_out_leaves_its_input_alone_and_clips_at_both_ends() -> None:
    one = sensor()
    electrons = np.full((4, one.pixels), 500_000.0)
    kept = electrons.copy()
    dn = read_out(one, electrons, pattern=even(one), rng=np.random.default_rng(5))
    np.testing.assert_array_equal(electrons, kept)
    assert (dn == one.top_code_dn).all()
    dark = read_out(one, np.zeros((400, one.pixels)), pattern=even(one), rng=np.random.default_rng(5))
    # read noise 30 e- about 17 e- of dark: below 0.5 DN (24.4 e-) for Phi(0.22) of the pixels
    below = special.ndtr((0.5 / one.dn_per_e - one.dark_e) / np.sqrt(900 + one.dark_e))
    assert (dark == 0).mean() == pytest.approx(below, abs=ERRORS * 0.5 / np.sqrt(dark.size) + 2e-3)


@given(
    mean=st.floats(-40, 140),
    sigma=st.floats(0.05, 60),
)
def test_clipped_gaussian_against_integration(mean: float, sigma: float) -> None:
    low, high = 0.0, 100.0
    x = np.linspace(low, high, 40_001)
    above = special.ndtr((mean - x) / sigma)  # E[Y] = low + integral of P(X > x) over the range
    weights = np.full(x.size, 2.0)
    weights[1::2] = 4.0
    weights[[0, -1]] = 1.0
    weights *= (x[1] - x[0]) / 3  # Simpson
    first = low + float(weights @ above)
    second = low**2 + float(weights @ (2 * x * above))
    got_mean, got_variance = clipped_gaussian(np.array(mean), np.array(sigma), low=low, high=high)
    assert got_mean == pytest.approx(first, abs=1e-6)
    assert got_variance == pytest.approx(second - first**2, abs=1e-4)


def test_clipped_gaussian_far_inside_far_outside_and_at_the_edge() -> None:
    mean, variance = clipped_gaussian(
        np.array([50.0, -1e4, 1e4, 0.0]), np.array([2.0, 2.0, 2.0, 3.0]), low=0.0, high=100.0
    )
    # a half-normal: sigma / sqrt(2 pi), sigma^2 (1/2 - 1/(2 pi))
    np.testing.assert_allclose(mean, [50, 0, 100, 3 / np.sqrt(2 * np.pi)], atol=1e-9)
    np.testing.assert_allclose(variance, [4, 0, 0, 9 * (0.5 - 0.5 / np.pi)], atol=1e-6)


def test_variances_in_closed_form() -> None:
    one = sensor(dark_current_e_per_s=2770.0 * 100)  # 9600 e- of dark in 96 stages
    electrons = np.array([0.0, 50_000.0])
    temporal = electrons + 9600 + 900
    np.testing.assert_allclose(one.variance_temporal_e2(electrons), temporal, rtol=1e-12)
    total = temporal * (1 + 1e-4) + (electrons + 9600) ** 2 * 1e-4 + 1600
    np.testing.assert_allclose(one.variance_total_e2(electrons), total, rtol=1e-12)


def test_moments_in_digital_numbers() -> None:
    one = sensor(black_level_dn=64)
    electrons = np.array([100_000.0, 1e7])
    mean, sigma = one.dn_moments(electrons, one.variance_temporal_e2(electrons))
    assert mean[0] == pytest.approx((100_000 + one.dark_e) * one.dn_per_e + 64, rel=1e-12)
    assert sigma[0] ** 2 == pytest.approx(
        one.variance_temporal_e2(electrons)[0] * one.dn_per_e**2 + 1 / 12, rel=1e-9
    )
    assert mean[1] == pytest.approx(4095)  # saturated: always the top code, and nothing but rounding left
    assert sigma[1] == pytest.approx(np.sqrt(1 / 12))


POSITIVE = [
    "pixels",
    "pixel_pitch_um",
    "fill_factor",
    "tdi_stages",
    "line_rate_hz",
    "conversion_gain_uv_per_e",
    "voltage_swing_v",
    "bits",
]
NOT_NEGATIVE = ["read_noise_e", "dark_current_e_per_s", "dsnu_e", "prnu_percent", "black_level_dn"]


@pytest.mark.parametrize("field", POSITIVE)
@pytest.mark.parametrize("value", [0, -1])
def test_what_must_be_above_0_is_named(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{field} must be above 0"):
        sensor(**{field: value})


@pytest.mark.parametrize("field", NOT_NEGATIVE)
def test_what_must_not_be_negative_is_named(field: str) -> None:
    assert getattr(sensor(**{field: 0}), field) == 0
    with pytest.raises(ValueError, match=f"{field} must not be negative"):
        sensor(**{field: -1})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("fill_factor", 1.1),
        ("bits", 17),
        ("quantum_efficiency", np.full(36, 1.1)),
        ("quantum_efficiency", np.full(36, -0.1)),
    ],
)
def test_what_is_too_much_is_named(field: str, value: object) -> None:
    with pytest.raises(ValueError, match=field):
        sensor(**{field: value})
