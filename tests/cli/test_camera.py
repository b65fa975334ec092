"""``prooflight camera`` as a user calls it: JSON contracts, tables, pictures, and one line for what cannot be used."""

from __future__ import annotations

import io
import json
import shutil
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.camera.camera import expose_flat, with_pixels
from prooflight.camera.sensor import draw_fixed_pattern
from prooflight.cli import run
from prooflight.press.press_file import PressFile
from prooflight.scans.recorded import write_scan

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parents[2]
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    def call(*arguments: object) -> tuple[int, str, str]:
        code = run(["camera", *(str(argument) for argument in arguments)])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def answer(call: Callable[..., tuple[int, str, str]]) -> Callable[..., Any]:
    """The JSON of a command that must succeed in silence."""

    def answer(*arguments: object) -> Any:
        code, out, err = call(*arguments, "--json")
        assert (code, err) == (0, "")
        return json.loads(out)

    return answer


@pytest.fixture
def refused(call: Callable[..., tuple[int, str, str]]) -> Callable[..., str]:
    """The one line in which a command must end."""

    def refused(*arguments: object) -> str:
        code, out, err = call(*arguments, "--json")
        assert code == 2
        assert out == ""
        assert err.startswith("prooflight: ")
        assert err.count("\n") == 1
        return err

    return refused


@pytest.fixture(scope="session")
def press(tmp_path_factory: pytest.TempPathFactory, prototype: PressFile) -> Path:
    path = tmp_path_factory.mktemp("camera") / "press.toml"
    path.write_text(prototype.text)
    return path


@pytest.fixture(scope="session")
def two_sensors(tmp_path_factory: pytest.TempPathFactory, two_sensor_file: PressFile) -> Path:
    path = tmp_path_factory.mktemp("camera") / "two.toml"
    path.write_text(two_sensor_file.text)
    return path


def reflectances(folder: Path, *patches: float | list[float], wave_nm: list[float] | None = None) -> Path:
    wave = wave_nm or [380.0, 730.0]
    spectra = [patch if isinstance(patch, list) else [patch] * len(wave) for patch in patches]
    path = folder / "R.json"
    path.write_text(json.dumps({"wave_nm": wave, "reflectance": spectra}))
    return path


# --- respond ---


def test_respond_keeps_its_contract(
    answer: Callable[..., Any], two_sensors: Path, two_sensor_file: PressFile, tmp_path: Path
) -> None:
    given = answer("respond", two_sensors, "--reflectance", reflectances(tmp_path, 0.9, 0.45, 0.0))
    assert set(given) == {"sensors"}
    assert [sensor["name"] for sensor in given["sensors"]] == ["mono", "blue"]
    lists = ("illuminance_lux", "electrons", "volts", "dn_mean", "dn_sigma_temporal", "dn_sigma_total")
    for sensor, block in zip(given["sensors"], two_sensor_file.camera().sensors, strict=True):
        assert set(sensor) == {"name", "irradiance_photons", *lists}
        assert all(len(sensor[name]) == 3 for name in lists)
        assert [len(spectrum) for spectrum in sensor["irradiance_photons"]] == [36] * 3
        for name in ("illuminance_lux", "electrons", "volts"):  # light is linear
            full, half, none = sensor[name]
            assert half == pytest.approx(full / 2, rel=1e-12)
            assert none == 0
        volts_per_e = block.conversion_gain_uv_per_e * 1e-6
        assert sensor["volts"][0] == pytest.approx(sensor["electrons"][0] * volts_per_e)
        assert sensor["dn_sigma_temporal"][0] < sensor["dn_sigma_total"][0]
    blue = given["sensors"][1]
    dark = two_sensor_file.camera().sensors[1].dark_e * two_sensor_file.camera().sensors[1].dn_per_e
    assert blue["dn_mean"][2] == pytest.approx(16 + dark, abs=1e-6)


def test_respond_reads_standard_input(
    answer: Callable[..., Any], press: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = reflectances(tmp_path, 0.5)
    from_file = answer("respond", press, "--reflectance", path)
    monkeypatch.setattr("sys.stdin", io.StringIO(path.read_text()))
    assert answer("respond", press, "--reflectance", "-") == from_file


def test_respond_shows_people_a_table(
    call: Callable[..., tuple[int, str, str]], press: Path, tmp_path: Path
) -> None:
    code, out, _ = call("respond", press, "--reflectance", reflectances(tmp_path, 0.85, 0.05))
    assert code == 0
    assert "Sensor mono" in out
    assert "[DN]" in out


def test_respond_refuses_in_one_line(
    refused: Callable[..., str], press: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "380..730 nm is needed" in refused(
        "respond", press, "--reflectance", reflectances(tmp_path, 0.5, wave_nm=[400, 700])
    )
    assert "85 is not a reflectance factor" in refused(
        "respond", press, "--reflectance", reflectances(tmp_path, 85)
    )
    (tmp_path / "bad.json").write_bytes(b"\xff\xfe\x00")
    assert "is not text" in refused("respond", press, "--reflectance", tmp_path / "bad.json")
    assert "none.json" in refused("respond", press, "--reflectance", tmp_path / "none.json")
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"\xff"), encoding="utf-8"))
    assert "standard input: is not text" in refused("respond", press, "--reflectance", "-")
    monkeypatch.setattr("sys.stdin", io.StringIO("{"))
    assert "standard input: is not JSON" in refused("respond", press, "--reflectance", "-")
    good = reflectances(tmp_path, 0.5)
    assert "none.toml" in refused("respond", tmp_path / "none.toml", "--reflectance", good)
    (tmp_path / "bad.toml").write_text(press.read_text().replace("f_number", "f_numbre"))
    assert "lens.f_numb" in refused("respond", tmp_path / "bad.toml", "--reflectance", good)


# --- mtf ---


def test_mtf_keeps_its_contract(answer: Callable[..., Any], press: Path) -> None:
    given = answer("mtf", press, "--wave", 550, "--freq", "0,10,20.5,1000")
    assert set(given) == {"freq", "lens", "system", "system_along"}
    assert given["freq"] == [0, 10, 20.5, 1000]
    x = np.array(given["freq"][:3]) * 550e-6 * 2.8 * (1 + 60 / 486.6)
    lens = 2 / np.pi * (np.arccos(x) - x * np.sqrt(1 - x**2))
    np.testing.assert_allclose(given["lens"], [*lens, 0], atol=1e-12)
    pixel = np.sinc(0.013 * np.array(given["freq"]))
    np.testing.assert_allclose(given["system"], given["lens"] * np.abs(pixel), atol=1e-12)
    np.testing.assert_allclose(given["system_along"], given["lens"] * pixel**2, atol=1e-12)


def test_mtf_shows_people_a_table_and_draws(
    call: Callable[..., tuple[int, str, str]], press: Path, tmp_path: Path
) -> None:
    code, out, _ = call("mtf", press, "--picture", tmp_path / "mtf.png")
    assert code == 0
    assert "system along" in out
    assert "[cycles/mm]" in out
    assert (tmp_path / "mtf.png").read_bytes().startswith(PNG)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--freq", "0,ten"), "'ten' is not a number"),
        (("--freq", "-1"), "-1 is not a frequency"),
        (("--freq", "nan"), "nan is not a frequency"),
        (("--freq", ""), "'' is not a number"),
        (("--wave", "0"), "0 is not a wavelength"),
        (("--wave", "inf"), "inf is not a wavelength"),
        (("--sensor", "2"), "there is no sensor 2; choose 1 to 1"),
    ],
)
def test_mtf_refuses_in_one_line(
    refused: Callable[..., str], press: Path, options: tuple[str, str], says: str
) -> None:
    assert says in refused("mtf", press, *options)


# --- explore ---


def test_explore_keeps_its_contract(answer: Callable[..., Any], two_sensors: Path) -> None:
    given = answer(
        "explore", two_sensors, "--vary", "light.luminance_cd_m2=50,100", "--vary", "lens.f_number=2.8,4"
    )
    assert [row["vary"] for row in given] == [
        {"light.luminance_cd_m2": light, "lens.f_number": number}
        for light in (50, 100)
        for number in (2.8, 4)
    ]
    shared = {"field_mm", "pixel_pitch_mm", "line_pitch_mm", "a4_pages_per_s"}
    for row in given:
        assert set(row) == {"vary", "sensors", *shared}
        assert [sensor["name"] for sensor in row["sensors"]] == ["mono", "blue"]
        assert all(isinstance(sensor["saturates"], bool) for sensor in row["sensors"])
    assert given[2]["sensors"][0]["white_snr"] > given[0]["sensors"][0]["white_snr"]


def test_explore_shows_people_tables_and_draws(
    call: Callable[..., tuple[int, str, str]], two_sensors: Path, tmp_path: Path
) -> None:
    for field in ("light.illuminant=D50,A", "sensor.read_noise_e=60,10,30"):
        picture = tmp_path / f"{field[:5]}.png"
        code, out, _ = call("explore", two_sensors, "--vary", field, "--picture", picture)
        assert code == 0
        assert "Sensor blue" in out
        assert "[mm]" in out
        assert picture.read_bytes().startswith(PNG)
    code, out, _ = call("explore", two_sensors, "--vary", "light.luminance_cd_m2=1000")
    assert "saturates" in out


def test_explore_refuses_as_the_press_file_does(refused: Callable[..., str], press: Path) -> None:
    assert f"{press}: light.luminance is not a known field; did you mean luminance_cd_m2?" in refused(
        "explore", press, "--vary", "light.luminance=3"
    )
    assert f"{press}: lens.f_number: " in refused("explore", press, "--vary", "lens.f_number=2.8,-4")
    assert "give FIELD=a,b,c" in refused("explore", press, "--vary", "lens.f_number")


# --- characterise ---

LEVELS = (0.003, 0.01, 0.05, 0.2, 0.4, 0.6, 0.9, 1.4)


def record(
    press_file: PressFile, folder: Path, *, pixels: int = 256, seed: int = 1
) -> tuple[list[Path], list[Path]]:
    """Two dark and eight flat exposures of 100 lines."""
    camera = with_pixels(press_file.camera(), pixels)
    rng = np.random.default_rng(seed)
    patterns = [draw_fixed_pattern(sensor, rng) for sensor in camera.sensors]

    def exposure(name: str, reflectance: float) -> Path:
        scan = expose_flat(camera, np.full(36, reflectance), lines=100, patterns=patterns, rng=rng)
        write_scan(folder / name, scan, facts={"reflectance": reflectance})
        return folder / name

    dark = [exposure(f"dark-{take}.tif", 0.0) for take in (1, 2)]
    return dark, [exposure(f"flat-{level}.tif", level) for level in LEVELS]


@pytest.fixture(scope="session")
def exposures(
    tmp_path_factory: pytest.TempPathFactory, prototype: PressFile
) -> tuple[list[Path], list[Path]]:
    return record(prototype, tmp_path_factory.mktemp("exposures"))


def test_characterise_writes_a_block_that_a_press_file_takes(
    answer: Callable[..., Any], exposures: tuple[list[Path], list[Path]], press: Path, tmp_path: Path
) -> None:
    out = tmp_path / "sensor.toml"
    block = answer("characterise", exposures[0][0].parent, "--like", press, "--out", out)
    (written,) = tomllib.loads(out.read_text())["sensor"]
    original = tomllib.loads(press.read_text())["sensor"][0]
    assert list(written) == [name for name in block if name in original]
    assert set(written) == set(original)
    assert {name: block[name] for name in written} == written
    # 10 exposures of 100 lines x 256 columns: errors of a few per cent, as they say of themselves
    for name, error in block["standard_errors"].items():
        assert block[name] == pytest.approx(original[name], abs=4 * error)
    assert block["dn_per_e"] == pytest.approx(0.02048, rel=0.03)
    assert len(block["columns"]["offset_dn"]) == len(block["columns"]["gain"]) == 256
    assert len(block["photon_transfer"]["mean_dn"]) == 10
    assert block["missing"] == []
    text = press.read_text()
    start, end = text.index("[[sensor]]"), text.index("[costs]")
    PressFile(press, text[:start] + out.read_text() + text[end:]).camera()


def test_named_told_apart_and_foldered_exposures_give_the_same(
    answer: Callable[..., Any], exposures: tuple[list[Path], list[Path]], press: Path
) -> None:
    dark, flat = exposures
    named = [option for path in dark for option in ("--dark", path)]
    named += [option for path in flat for option in ("--flat", path)]
    first = answer("characterise", *named, "--like", press)
    assert answer("characterise", dark[0].parent, "--like", press) == first
    assert answer("characterise", *flat, *dark, "--like", press)["read_noise_e"] == pytest.approx(
        first["read_noise_e"], rel=1e-5
    )


def test_characterise_without_a_press_file(
    answer: Callable[..., Any], exposures: tuple[list[Path], list[Path]]
) -> None:
    folder = exposures[0][0].parent
    block = answer("characterise", folder)
    assert "quantum_efficiency" in block["missing"]
    assert "conversion_gain_uv_per_e" in block["missing"]
    block = answer("characterise", folder, "--voltage-swing-v", 2.0, "--bits", 12)
    assert block["conversion_gain_uv_per_e"] == pytest.approx(10, rel=0.03)


def test_characterise_shows_people_a_table_and_draws(
    call: Callable[..., tuple[int, str, str]],
    exposures: tuple[list[Path], list[Path]],
    press: Path,
    tmp_path: Path,
) -> None:
    picture = tmp_path / "transfer.png"
    code, out, _ = call("characterise", exposures[0][0].parent, "--like", press, "--picture", picture)
    assert code == 0
    assert "full well, e-" in out
    assert "[[sensor]]" in out
    assert picture.read_bytes().startswith(PNG)


def test_one_block_a_sensor(
    call: Callable[..., tuple[int, str, str]], two_sensors: Path, two_sensor_file: PressFile, tmp_path: Path
) -> None:
    record(two_sensor_file, tmp_path / "e", seed=3)
    out = tmp_path / "sensors.toml"
    code, lines, _ = call("characterise", tmp_path / "e", "--like", two_sensors, "--out", out, "--json")
    assert code == 0
    blocks = [json.loads(line) for line in lines.splitlines()]
    assert [block["name"] for block in blocks] == ["mono", "blue"]
    assert [sensor["bits"] for sensor in tomllib.loads(out.read_text())["sensor"]] == [12, 10]
    for block, sensor in zip(blocks, two_sensor_file.camera().sensors, strict=True):
        assert block["dn_per_e"] == pytest.approx(sensor.dn_per_e, rel=0.05)
    code, lines, _ = call("characterise", tmp_path / "e", "--json")
    assert [json.loads(line)["name"] for line in lines.splitlines()] == ["sensor1", "sensor2"]


def test_a_dark_at_another_line_rate(
    answer: Callable[..., Any],
    exposures: tuple[list[Path], list[Path]],
    press: Path,
    prototype: PressFile,
    tmp_path: Path,
) -> None:
    slow = tmp_path / "slow.tif"
    shutil.copy(exposures[0][0], slow)
    block = answer("characterise", exposures[0][0].parent, "--dark", f"{slow}@1000", "--like", press)
    assert "2 line rates" in block["sources"]["dark_current_e_per_s"]
    # the same exposure at a longer time: no dark current
    assert block["dark_current_e_per_s"] <= 4 * block["standard_errors"]["dark_current_e_per_s"]


def test_characterise_refuses_in_one_line(
    refused: Callable[..., str],
    exposures: tuple[list[Path], list[Path]],
    press: Path,
    two_sensors: Path,
    prototype: PressFile,
    tmp_path: Path,
) -> None:
    dark, flat = exposures
    assert "no exposures are named" in refused("characterise")
    assert "record flat exposures too" in refused("characterise", *dark)
    assert "record dark exposures too" in refused("characterise", "--flat", flat[0])
    assert "only 2 levels of light" in refused("characterise", *dark, *flat[3:5], "--like", press)
    assert "none.tif: there is no such file" in refused("characterise", tmp_path / "none.tif")
    assert "2 sensors" in refused("characterise", dark[0], "--like", two_sensors)
    assert "is not a line rate" in refused("characterise", "--dark", f"{dark[0]}@0", *flat, "--like", press)
    assert "give --like" in refused("characterise", *dark, "--dark", f"{dark[0]}@99", *flat)
    assert "is not a swing" in refused("characterise", *dark, "--voltage-swing-v", "-1")
    damaged = tmp_path / "damaged.tif"
    damaged.write_bytes(flat[0].read_bytes()[:3000])
    assert "damaged.tif: the TIFF is truncated" in refused("characterise", *dark, damaged, "--like", press)
    narrow, _ = record(prototype, tmp_path / "narrow", pixels=128)
    line = refused("characterise", *dark, *flat, narrow[0], "--like", press)
    assert "is 128 pixels wide where" in line
    assert str(narrow[0]) in line


def test_nothing_is_half_written(
    refused: Callable[..., str], exposures: tuple[list[Path], list[Path]], press: Path, tmp_path: Path
) -> None:
    refused("characterise", *exposures[0], "--like", press, "--out", tmp_path / "out" / "s.toml")
    assert list(tmp_path.iterdir()) == []
