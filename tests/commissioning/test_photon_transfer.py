"""Photon transfer gives back the numbers of the sensor that was simulated."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.camera.camera import expose_flat, with_pixels
from prooflight.camera.sensor import FixedPattern, Noise, draw_fixed_pattern, read_out
from prooflight.commissioning.camera.exposures import Exposure, separated_by_level, statistics
from prooflight.commissioning.camera.photon_transfer import photon_transfer
from prooflight.commissioning.camera.sensor_block import Given, characterise_sensor
from prooflight.errors import RequestError, ScanError
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import LineSensor
    from prooflight.commissioning.camera.sensor_block import SensorBlock

REFLECTANCES = (0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.9, 1.1, 1.5)
"""Of the flat exposures of the whole rig; 1.22 fills the prototype's converter."""
LEVELS_E = (150.0, 500.0, 1500.0, 5e3, 2e4, 5e4, 8e4, 1.1e5, 1.4e5)
"""Of flat exposures without a lens; 200,000 e- fill the converter."""


class Bench:
    """One specimen of a sensor, evenly lit without a lens, and its exposures."""

    def __init__(self, sensor: LineSensor, *, seed: int, lines: int = 100) -> None:
        self.sensor, self.lines = sensor, lines
        self.rng = np.random.default_rng(seed)
        self.pattern = draw_fixed_pattern(sensor, self.rng)

    def dn(self, electrons: float | np.ndarray, noise: Noise = Noise.ALL) -> np.ndarray:
        """(lines, pixels) of a mean that may differ from line to line and column to column."""
        light = np.broadcast_to(np.asarray(electrons, float), (self.lines, self.sensor.pixels))
        return read_out(self.sensor, light, pattern=self.pattern, rng=self.rng, noise=noise)

    def exposure(self, electrons: float | np.ndarray, name: str = "flat", **facts: Any) -> Exposure:
        return statistics(self.dn(electrons), name=name, **facts)

    def dark(self) -> list[Exposure]:
        return [self.exposure(0.0, "dark 1"), self.exposure(0.0, "dark 2")]

    def flats(self, levels: Sequence[float] = LEVELS_E, profile: float | np.ndarray = 1.0) -> list[Exposure]:
        return [self.exposure(level * profile, f"flat {level}") for level in levels]

    def block(self, dark: Sequence[Exposure], flat: Sequence[Exposure]) -> SensorBlock:
        given = Given(like=self.sensor, like_name="bench.toml")
        return characterise_sensor(dark, flat, given=given, number=1)


@pytest.fixture(scope="session")
def sensor(prototype: PressFile) -> LineSensor:
    """The prototype's, 512 columns wide, with a black level that keeps the dark off code 0."""
    return replace(prototype.camera().sensors[0], pixels=512, black_level_dn=40.0)


# --- the prototype itself ---


@pytest.fixture(scope="module", params=[0.0, 40.0], ids=["dark clipped at 0", "black level 40"])
def prototype_block(request: pytest.FixtureRequest) -> tuple[Camera, FixedPattern, SensorBlock]:
    """Of 2 dark and 26 flat exposures of 500 lines through the prototype's lens."""
    camera = PressFile.prototype().camera()
    camera = replace(camera, sensors=(replace(camera.sensors[0], black_level_dn=request.param),))
    rng = np.random.default_rng(1)
    (sensor,) = camera.sensors
    pattern = draw_fixed_pattern(sensor, rng)

    def exposure(reflectance: float) -> Exposure:
        colour = np.full(36, reflectance)
        scan = expose_flat(camera, colour, lines=500, patterns=[pattern], rng=rng)
        return statistics(scan[0], name=f"R {reflectance}")

    dark = [exposure(0.0) for _ in range(2)]
    flat = [exposure(reflectance) for reflectance in REFLECTANCES for _ in range(2)]
    given = Given(like=sensor, like_name="prototype.toml")
    return camera, pattern, characterise_sensor(dark, flat, given=given, number=1)


@pytest.mark.parametrize("field", ["conversion_gain_uv_per_e", "read_noise_e", "dsnu_e", "prnu_percent"])
def test_the_prototype_is_recovered_within_3_percent(
    prototype_block: tuple[Camera, FixedPattern, SensorBlock], field: str
) -> None:
    # Each exposure has 2/3 x 500 x 2048 degrees of freedom, so its variance a standard error of 0.17 %; 20 of them
    # give the gain to 0.05 % and the read noise to 0.12 %. DSNU and PRNU of 2048 columns scatter by
    # 1 / sqrt(2 x 2048) = 1.6 % about the press file's number: 3 % is two standard deviations, met with this seed.
    camera, _, block = prototype_block
    assert block.fields[field] == pytest.approx(getattr(camera.sensors[0], field), rel=0.03)
    assert block.standard_errors[field] / block.fields[field] < 0.02


def test_gain_and_read_noise_are_as_exact_as_they_say(
    prototype_block: tuple[Camera, FixedPattern, SensorBlock],
) -> None:
    camera, _, block = prototype_block
    for field in ("conversion_gain_uv_per_e", "read_noise_e", "dark_current_e_per_s"):
        error = block.standard_errors[field]
        assert block.fields[field] == pytest.approx(getattr(camera.sensors[0], field), abs=4 * error)
    assert block.standard_errors["conversion_gain_uv_per_e"] / 10 < 0.001
    assert block.standard_errors["read_noise_e"] / 30 < 0.002


def test_the_specimens_own_pattern_is_found(
    prototype_block: tuple[Camera, FixedPattern, SensorBlock],
) -> None:
    camera, pattern, block = prototype_block
    (sensor,) = camera.sensors
    # The DSNU of these very columns; temporal noise leaves 0.02 DN in each column of 0.8 DN: 0.1 % and less.
    assert block.fields["dsnu_e"] == pytest.approx(pattern.offset_e.std(ddof=1), rel=0.005)
    # The high-pass keeps 91 % of the columns' freedom: sqrt((1 / 0.91 - 1) / (2 x 2048)) = 0.5 %, four times that.
    assert block.fields["prnu_percent"] == pytest.approx(100 * pattern.gain.std(ddof=1), rel=0.02)
    offset_e = (block.transfer.offset_dn - sensor.black_level_dn) / sensor.dn_per_e
    want_e = sensor.dark_e * pattern.gain + pattern.offset_e
    # 1000 lines of 0.7 DN, or the columns' lines of 20 exposures: 1.1 e- a column; the worst of 2048 is 4 times that.
    assert np.abs(offset_e - want_e).max() < 4.5 * 1.3
    want_gain = pattern.gain * camera.column_light()
    np.testing.assert_allclose(block.transfer.column_gain, want_gain / want_gain.mean(), atol=5e-4)


def test_saturation_and_full_well(prototype_block: tuple[Camera, FixedPattern, SensorBlock]) -> None:
    camera, _, block = prototype_block
    assert block.full_well_e == pytest.approx(camera.sensors[0].full_well_e, rel=0.002)
    # EMVA 1288 takes the level of greatest variance; exposures at 1.1 reach 90 % of the range, at 1.5 all of it.
    assert block.saturation_e is not None
    assert 0.7 < block.saturation_e / camera.sensors[0].full_well_e < 1
    levels, used = block.transfer.level_dn, block.transfer.used
    assert levels[used].max() < 0.7 * 4096
    assert not used[levels > 0.75 * 4096].any()


def test_a_clipped_dark_is_said_and_left_out_of_the_line(
    prototype_block: tuple[Camera, FixedPattern, SensorBlock],
) -> None:
    camera, _, block = prototype_block
    clipped = camera.sensors[0].black_level_dn == 0
    assert block.transfer.dark_clipped == clipped
    assert any("are code 0" in note for note in block.notes) == clipped
    darks = block.transfer.level_dn < camera.sensors[0].black_level_dn + 1.5
    assert darks.sum() == 2
    assert block.transfer.used[darks].all() != clipped


# --- standard errors ---


@pytest.mark.parametrize("black_level_dn", [0.0, 40.0])
def test_standard_errors_are_neither_timid_nor_bold(sensor: LineSensor, black_level_dn: float) -> None:
    pulls: dict[str, list[float]] = {}
    bench_sensor = replace(sensor, black_level_dn=black_level_dn, pixels=256)
    for seed in range(40):
        bench = Bench(bench_sensor, seed=seed, lines=60)
        block = bench.block(bench.dark(), bench.flats())
        for field in (
            "conversion_gain_uv_per_e",
            "read_noise_e",
            "dark_current_e_per_s",
            "dsnu_e",
            "prnu_percent",
        ):
            error = (block.fields[field] - getattr(bench_sensor, field)) / block.standard_errors[field]
            pulls.setdefault(field, []).append(error)
    for field, values in pulls.items():
        # 40 pulls: their mean scatters by 0.16, their rms by 11 %; four times that.
        assert abs(np.mean(values)) < 0.63, field
        assert 0.55 < np.sqrt(np.mean(np.square(values))) < 1.45, field


def test_the_read_noises_error_is_what_the_lines_errors_make_of_it(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=2, lines=30)
    transfer = photon_transfer(bench.dark(), bench.flats((5e3, 2e4, 5e4, 1e5)), top_code_dn=4095)
    center = (transfer.constant_dn2, transfer.gain.value)
    lines = np.random.default_rng(3).multivariate_normal(center, transfer.covariance, 4000)
    noise = [
        replace(transfer, constant_dn2=constant, gain=replace(transfer.gain, value=gain))
        .read_noise_e(40.0)
        .value
        for constant, gain in lines
    ]
    # 4000 draws know a standard deviation to 1.1 %
    assert transfer.read_noise_e(40.0).standard_error == pytest.approx(np.std(noise), rel=0.045)


def test_noise_left_in_column_means_is_taken_out(sensor: LineSensor) -> None:
    quiet = replace(sensor, dsnu_e=5.0, prnu_percent=0.1, pixels=4096)
    bench = Bench(quiet, seed=4, lines=32)
    block = bench.block(bench.dark(), bench.flats())
    # 64 dark lines leave 30.3 / 8 = 3.8 e- in each column's mean: 6.3 e- if left in, which is ten standard errors.
    assert block.fields["dsnu_e"] == pytest.approx(
        bench.pattern.offset_e.std(), abs=4 * block.standard_errors["dsnu_e"]
    )
    assert block.standard_errors["dsnu_e"] < 0.12
    # Nine levels of 32 lines leave 0.03 %; with it 0.1 % would be 0.105 %, two and a half standard errors.
    want = 100 * bench.pattern.gain.std()
    assert block.fields["prnu_percent"] == pytest.approx(want, abs=2 * block.standard_errors["prnu_percent"])


def test_a_dark_cut_in_half_by_code_0_does_not_mislead(sensor: LineSensor) -> None:
    loud = replace(
        sensor, read_noise_e=100.0, black_level_dn=0.0
    )  # 2 DN: enough for the converter, cut off at 0
    bench = Bench(loud, seed=5, lines=200)
    block = bench.block(bench.dark(), bench.flats())
    assert block.transfer.dark_clipped
    assert not block.transfer.dark_hidden
    assert not block.transfer.used[:2].any()
    for field, want in (("read_noise_e", 100.0), ("dark_current_e_per_s", 500.0), ("dsnu_e", 40.0)):
        assert block.fields[field] == pytest.approx(want, abs=4 * block.standard_errors[field])


# --- what must not matter ---


def test_lamp_profile_and_cos4_are_not_prnu(sensor: LineSensor) -> None:
    profile = 1 - 0.5 * np.linspace(-1, 1, sensor.pixels) ** 2 + 0.03 * np.sin(np.arange(sensor.pixels) / 25)
    bench = Bench(replace(sensor, prnu_percent=0.3), seed=3, lines=400)
    block = bench.block(bench.dark(), bench.flats(profile=profile))
    # 512 columns: 1 / sqrt(2 x 512 x 0.9) = 3.3 %, three times that
    assert block.fields["prnu_percent"] == pytest.approx(100 * bench.pattern.gain.std(), rel=0.1)
    assert block.transfer.column_gain.max() / block.transfer.column_gain.min() > 1.7


def test_a_lamp_that_drifts_and_flickers_changes_neither_gain_nor_read_noise(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=4, lines=300)
    line = np.arange(300)[:, None]
    lamp = 1 + 0.05 * line / 300 + 0.01 * np.where(line % 2, 1, -1)
    flats = [bench.exposure(level * lamp) for level in LEVELS_E[:-1]]
    block = bench.block(bench.dark(), flats)
    # Flicker of 1 % would add (0.01 x 110,000 e-)^2 = ten times the shot noise's variance.
    for field in ("conversion_gain_uv_per_e", "read_noise_e"):
        error = block.standard_errors[field]
        assert block.fields[field] == pytest.approx(
            getattr(sensor, field), abs=4 * error + 0.005 * block.fields[field]
        )


def test_lines_that_jump_as_a_whole_are_said_to(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=5, lines=300)
    jumps = np.random.default_rng(6).normal(0, 2.0, (300, 1))
    jumping = [
        statistics(np.rint(bench.dn(0.0) + jumps).clip(0).astype(np.uint16), name="dark") for _ in range(2)
    ]
    assert jumping[0].line_variance_dn2 == pytest.approx(4.0, rel=0.25)  # sqrt(3 / 300) = 10 % standard error
    block = bench.block(jumping, bench.flats())
    assert any("whole lines jump by 2" in note for note in block.notes)
    steady = bench.block(bench.dark(), bench.flats())
    assert not any("whole lines jump" in note for note in steady.notes)


def test_order_does_not_matter(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=6)
    dark, flat = bench.dark(), bench.flats()
    assert bench.block(dark, flat).fields == bench.block(dark[::-1], flat[::-1]).fields


# --- what can and cannot be known ---


def test_rounding_adds_its_twelfth_and_is_taken_out(sensor: LineSensor) -> None:
    coarse = replace(sensor, bits=10, read_noise_e=100.0)  # 0.5 DN of read noise
    bench = Bench(coarse, seed=7, lines=400)
    block = bench.block(bench.dark(), bench.flats())
    # Left in, 1/12 DN^2 would make it 100 sqrt(1 + 1 / (12 x 0.262)) = 115 e-.
    assert block.fields["read_noise_e"] == pytest.approx(100, rel=0.01)


def test_a_dark_that_rounding_hides_is_left_out_and_the_rest_still_found(sensor: LineSensor) -> None:
    bench = Bench(replace(sensor, bits=10), seed=8, lines=400)  # 30 e- are 0.15 DN
    block = bench.block(bench.dark(), bench.flats())
    assert any("rounding hides the dark" in note for note in block.notes)
    assert not block.transfer.used[:2].any()
    for field, want in (
        ("conversion_gain_uv_per_e", 10),
        ("read_noise_e", 30),
        ("dark_current_e_per_s", 500),
    ):
        assert block.fields[field] == pytest.approx(want, abs=4 * block.standard_errors[field])
    # columns are 0.2 DN apart, where a dark exposure shows whole codes only
    assert block.fields["dsnu_e"] == pytest.approx(bench.pattern.offset_e.std(), rel=0.1)


def test_noise_that_rounding_hides_everywhere_is_refused(sensor: LineSensor) -> None:
    bench = Bench(replace(sensor, bits=8), seed=8)
    with pytest.raises(ScanError, match=r"rounding hides the noise.*record with more bits"):
        bench.block(bench.dark(), bench.flats())


def test_a_second_line_rate_parts_dark_current_and_black_level(sensor: LineSensor) -> None:
    hot = replace(sensor, dark_current_e_per_s=5000.0, dsnu_e=20.0)
    bench = Bench(hot, seed=9, lines=200)
    slow = Bench(replace(hot, line_rate_hz=277.0), seed=9, lines=200)
    slow.pattern = bench.pattern
    ignorant = replace(hot, black_level_dn=0.0)  # the press file is wrong about the black level
    dark = [*bench.dark(), slow.exposure(0.0, "slow dark", line_rate_hz=277.0)]
    flat = bench.flats()
    block = characterise_sensor(dark, flat, given=Given(like=ignorant, like_name="x.toml"), number=1)
    for field, want in (("dark_current_e_per_s", 5000.0), ("black_level_dn", 40.0), ("read_noise_e", 30.0)):
        assert block.fields[field] == pytest.approx(want, abs=4 * block.standard_errors[field])
    assert block.standard_errors["dark_current_e_per_s"] < 0.01 * 5000
    assert "2 line rates" in block.sources["dark_current_e_per_s"]


def test_a_second_line_rate_works_on_clipped_darks_too(sensor: LineSensor) -> None:
    hot = replace(sensor, dark_current_e_per_s=1000.0, black_level_dn=0.0)
    bench = Bench(hot, seed=10, lines=400)
    slow = Bench(replace(hot, line_rate_hz=900.0), seed=10, lines=400)
    slow.pattern = bench.pattern
    dark = [*bench.dark(), slow.exposure(0.0, "slow dark", line_rate_hz=900.0)]
    assert all(exposure.lowest_share > 0.01 for exposure in dark)
    block = bench.block(dark, bench.flats())
    assert block.fields["dark_current_e_per_s"] == pytest.approx(
        1000, abs=4 * block.standard_errors["dark_current_e_per_s"]
    )
    assert block.standard_errors["dark_current_e_per_s"] < 50


def test_without_a_press_file_the_block_says_what_is_missing(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=11)
    dark, flat = bench.dark(), bench.flats()
    block = characterise_sensor(dark, flat, given=Given(), number=2)
    assert block.fields["name"] == "sensor2"
    assert set(block.missing) == {
        "pixel_pitch_um",
        "fill_factor",
        "tdi_stages",
        "line_rate_hz",
        "conversion_gain_uv_per_e",
        "voltage_swing_v",
        "bits",
        "quantum_efficiency",
    }
    assert block.gain.value == pytest.approx(sensor.dn_per_e, rel=0.02)
    # dark signal and its shot noise stay where they are: in black level and read noise
    assert block.fields["black_level_dn"] == pytest.approx(40 + sensor.dark_e * sensor.dn_per_e, abs=0.2)
    with_swing = characterise_sensor(dark, flat, given=Given(voltage_swing_v=2.0, bits=12), number=2)
    assert with_swing.fields["conversion_gain_uv_per_e"] == pytest.approx(10, rel=0.02)


def test_the_block_is_a_press_files_sensor(sensor: LineSensor, prototype: PressFile) -> None:
    bench = Bench(sensor, seed=12)
    block = bench.block(bench.dark(), bench.flats())
    start, end = prototype.text.index("[[sensor]]"), prototype.text.index("[costs]")
    text = prototype.text[:start] + block.toml() + "\n" + prototype.text[end:]
    got = PressFile(prototype.path, text).camera().sensors[0]
    for field, value in block.fields.items():
        if field != "quantum_efficiency":
            assert getattr(got, field) == value
    np.testing.assert_allclose(got.quantum_efficiency, sensor.quantum_efficiency, atol=1e-6)


# --- what is refused ---


def test_too_few_levels_say_what_to_record(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=13)
    for levels in [(2e4,), (2e4, 2.01e4, 2.02e4), (2e4, 4e4), (2e4, 3e5, 4e5)]:
        with pytest.raises(ScanError, match="record uniform light at 8 or more levels"):
            photon_transfer(bench.dark(), bench.flats(levels), top_code_dn=4095)


def test_saturated_and_black_flats_do_not_count_as_levels(sensor: LineSensor) -> None:
    bench = Bench(replace(sensor, black_level_dn=0.0), seed=14)
    with pytest.raises(ScanError, match="only 2 levels of light"):
        photon_transfer(bench.dark(), bench.flats((1.0, 2.0, 3e4, 6e4, 1.9e5, 3e5)), top_code_dn=4095)


def test_one_kind_of_exposure_is_not_enough(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=15)
    with pytest.raises(ScanError, match="record dark exposures too"):
        photon_transfer([], bench.flats())
    with pytest.raises(ScanError, match="record flat exposures too"):
        photon_transfer(bench.dark(), [])


def test_codes_above_the_converters_range_are_refused(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=16)
    with pytest.raises(ScanError, match="more than 255; give the number of bits"):
        photon_transfer(bench.dark(), bench.flats(), top_code_dn=255)


def test_black_throughout_is_refused(sensor: LineSensor) -> None:
    bench = Bench(replace(sensor, black_level_dn=0.0), seed=17)
    black = statistics(np.zeros((100, 512), np.uint16), name="dark")
    with pytest.raises(ScanError, match="code 0 throughout; raise the camera's black level"):
        photon_transfer([black], bench.flats(), top_code_dn=4095)


def test_variance_that_does_not_rise_is_refused(sensor: LineSensor) -> None:
    rng = np.random.default_rng(18)

    def processed(mean: float) -> Exposure:
        return statistics(rng.normal(mean, 3.0, (100, 512)).clip(0).astype(np.uint16), name="x")

    flats = [processed(level) for level in (2500, 2000, 1000, 500)]
    smoothed = [replace(flat, variance_dn2=10.0 - flat.mean_dn / 500) for flat in flats]
    with pytest.raises(ScanError, match="variance does not rise"):
        photon_transfer([processed(50)], [*smoothed, processed(3500)])


@pytest.mark.parametrize("shape", [(15, 512), (100, 99), (1, 1)])
def test_exposures_that_say_nothing_are_refused(shape: tuple[int, int]) -> None:
    with pytest.raises(ScanError, match="record at least 16 lines of 100 pixels"):
        statistics(np.ones(shape, np.uint16), name="d.tif")


def test_a_line_rate_without_a_press_file_is_refused(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=19)
    dark = [*bench.dark(), bench.exposure(0.0, line_rate_hz=277.0)]
    with pytest.raises(RequestError, match="give --like"):
        characterise_sensor(dark, bench.flats(), given=Given(), number=1)
    with pytest.raises(ScanError, match="none is at the line rate of the flat exposures, 2770 Hz"):
        bench.block(dark[2:], bench.flats())


# --- statistics of one exposure ---


def test_statistics_are_those_of_a_plain_calculation() -> None:
    dn = (
        np.random.default_rng(20).poisson(20.0, (700, 120)).astype(np.uint16)
    )  # more lines than one block of them
    got = statistics(dn, name="a")
    np.testing.assert_allclose(got.column_mean_dn, dn.mean(axis=0), rtol=1e-12)
    # both estimate 20; they share the samples, and differ by less than each one's sqrt(3 / 84,000) = 0.6 %
    assert got.variance_dn2 == pytest.approx(dn.var(axis=0, ddof=1).mean(), rel=0.018)
    assert got.highest_dn == dn.max()
    assert got.highest_share == pytest.approx((dn == dn.max()).mean())
    assert got.lowest_share == (dn == 0).mean()
    assert got.degrees_of_freedom == pytest.approx(2 / 3 * 700 * 120, rel=0.01)


def test_a_fixed_pattern_and_a_drift_are_not_noise() -> None:
    pattern = np.arange(150) % 7
    drift = np.arange(300)[:, None] // 100
    got = statistics((100 + pattern + drift).astype(np.uint16), name="a")
    assert got.variance_dn2 == pytest.approx(0, abs=1e-12)
    assert got.line_variance_dn2 == pytest.approx(2 / (2 * 299))


def test_dark_is_what_lies_lowest_or_has_a_line_rate(sensor: LineSensor) -> None:
    bench = Bench(sensor, seed=21)
    dark, flat = bench.dark(), bench.flats()
    slow = bench.exposure(9e3, "slow", line_rate_hz=100.0)
    mixed = [(e,) for e in [*flat[:3], dark[0], slow, *flat[3:], dark[1]]]
    found_dark, found_flat = separated_by_level(mixed)
    assert [e for (e,) in found_dark] == [dark[0], slow, dark[1]]
    assert [e for (e,) in found_flat] == flat
    assert separated_by_level([]) == ([], [])


def test_narrow_cameras_are_measured_too(prototype: PressFile) -> None:
    camera = with_pixels(prototype.camera(), 128)
    bench = Bench(replace(camera.sensors[0], black_level_dn=20.0), seed=22, lines=400)
    block = bench.block(bench.dark(), bench.flats())
    assert block.fields["conversion_gain_uv_per_e"] == pytest.approx(
        10, abs=4 * block.standard_errors["conversion_gain_uv_per_e"]
    )
