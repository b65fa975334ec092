from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight import spectra
from prooflight.errors import PressFileError
from prooflight.pages.pdf.engine import RipEngine
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera

# The example of the design's contract with every optional block that is not a file.
CONTRACT = """
[light]
illuminant = "D65"
luminance_cd_m2 = 100.0
[lens]
focal_length_mm = 60.0
f_number = 2.8
transmittance = 1.0
object_distance_mm = 546.6
[[sensor]]
name = "mono"
pixels = 2048
pixel_pitch_um = 13.0
fill_factor = 0.90
tdi_stages = 96
line_rate_hz = 2770.0
conversion_gain_uv_per_e = 10.0
voltage_swing_v = 2.0
read_noise_e = 30.0
dark_current_e_per_s = 500.0
dsnu_e = 40.0
prnu_percent = 1.0
bits = 12
black_level_dn = 0
quantum_efficiency = { wave_nm = [380, 390, 550, 730], qe = [0.03, 0.05, 0.37, 0.32] }
[transport]
speed_mm_s = 292.0
binning_along = 1
[costs]
misprint_rate = 0.02
false_alarm_cents = 0.5
missed_misprint_cents = 3.0
[decision]
good_pages_per_false_alarm = 1000
"""


def camera_of(text: str, path: Path = Path("press.toml")) -> Camera:
    return PressFile(path, text).camera()


def changed(old: str, new: str) -> str:
    assert CONTRACT.count(old) == 1, old
    return CONTRACT.replace(old, new)


def refused(text: str, path: Path = Path("press.toml")) -> str:
    """The one line in which reading ends; it names the file."""
    with pytest.raises(PressFileError) as refusal:
        camera_of(text, path)
    line = str(refusal.value)
    assert line.startswith(f"{path}: ")
    assert "\n" not in line
    assert len(line) < 500
    return line


# --- what is right ---


def test_the_prototype_is_the_papers_rig(prototype: PressFile) -> None:
    camera = prototype.camera()
    (sensor,) = camera.sensors
    assert camera.light.name == "D65"
    assert camera.light.luminance_cd_m2 == 100
    assert (camera.lens.focal_length_mm, camera.lens.f_number) == (60, 2.8)
    assert (sensor.pixels, sensor.tdi_stages, sensor.line_rate_hz) == (2048, 96, 2770)
    assert camera.speed_mm_s is None
    assert prototype.costs().alpha == pytest.approx(0.101, abs=5e-4)
    assert prototype.name == "prototype"


def test_the_contracts_example_reads(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(CONTRACT, encoding="utf-8")
    press_file = PressFile.read(path)
    camera = press_file.camera()
    assert press_file.name == "mine"
    assert camera.speed_mm_s == 292
    assert camera.line_pitch_mm == pytest.approx(292 / 2770)
    costs = press_file.costs()
    assert (costs.misprint_rate, costs.false_alarm_cents, costs.missed_misprint_cents) == (0.02, 0.5, 3.0)
    assert press_file.good_pages_per_false_alarm == 1000
    assert press_file.states_rate
    geometry = press_file.geometry(camera)
    assert geometry.pixels == 2048
    assert geometry.pixel_pitch_mm == camera.pixel_pitch_mm
    assert geometry.line_pitch_mm == camera.line_pitch_mm
    np.testing.assert_allclose(camera.sensors[0].quantum_efficiency[[0, 1, 17, 35]], [0.03, 0.05, 0.37, 0.32])
    assert camera.sensors[0].quantum_efficiency[2] == pytest.approx(0.05 + 0.32 / 16)  # straight in between


def test_the_rips_resolution_is_of_the_press(tmp_path: Path) -> None:
    assert PressFile(Path("press.toml"), CONTRACT).rip_dpi is None
    press_file = PressFile(Path("press.toml"), CONTRACT + "[rip]\ndpi = 1200\n")
    assert press_file.rip_dpi == 1200


def test_the_rips_engine_is_of_the_press() -> None:
    assert PressFile(Path("press.toml"), CONTRACT).rip_engine == RipEngine()
    by_gs = PressFile(Path("press.toml"), CONTRACT + '[rip]\nengine = "ghostscript"\n')
    assert by_gs.rip_engine.name == "ghostscript"
    named = '["rip", "{pdf}", "{page}", "{dpi}", "{out}"]'
    by_command = PressFile(Path("press.toml"), f'{CONTRACT}[rip]\nengine = "command"\ncommand = {named}\n')
    assert by_command.rip_engine.command == ("rip", "{pdf}", "{page}", "{dpi}", "{out}")


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ('engine = "harlequin"', "rip.engine: "),
        ('engine = "command"', "rip: command goes with"),
        ('command = ["rip"]', "rip: command goes with"),
        ('engine = "command"\ncommand = ["rip", "{pdf}"]', "rip: command must contain {page}"),
        ('engine = "command"\ncommand = "rip {pdf}"', "rip.command: "),
    ],
)
def test_engines_that_cannot_be_meant_are_refused(fields: str, said: str) -> None:
    assert said in refused(f"{CONTRACT}[rip]\n{fields}\n")


@pytest.mark.parametrize("dpi", ["0", "-600", "99", "1e9", "nan", "true", '"600 dpi"', "[600, 600]"])
def test_resolutions_that_no_press_has_are_refused(dpi: str) -> None:
    assert "rip.dpi: " in refused(f"{CONTRACT}[rip]\ndpi = {dpi}\n")


def test_every_block_after_the_sensor_is_optional() -> None:
    press_file = PressFile(Path("press.toml"), CONTRACT[: CONTRACT.index("[transport]")])
    camera = press_file.camera()
    assert camera.line_pitch_mm == camera.pixel_pitch_mm  # in step: pixels on the page are square
    assert press_file.costs().misprint_rate == 0.01
    assert (
        press_file.good_pages_per_false_alarm == 100_000
    )  # of the ideal world, which is the paper's detector's
    assert not press_file.states_rate  # ours then promises what counts support
    assert 0 < press_file.backing_reflectance < 0.5
    assert press_file.inks().name == "built-in"


def test_several_sensors_in_their_order(two_sensor_file: PressFile) -> None:
    mono, blue = two_sensor_file.camera().sensors
    assert (mono.name, blue.name) == ("mono", "blue")
    assert (mono.bits, blue.bits) == (12, 10)
    assert blue.black_level_dn == 16


@pytest.mark.parametrize(
    ("name", "table"),
    [("A", "A"), ("D50", "D50"), ("D65", "D65"), ("F2", "FL2"), ("F7", "FL7"), ("F11", "FL11")],
)
def test_illuminants_by_name(name: str, table: str) -> None:
    power = camera_of(changed('"D65"', f'"{name}"')).light.relative_power
    np.testing.assert_array_equal(power, spectra.illuminant(table))


@pytest.mark.parametrize(
    "text",
    [
        "wavelength nm,relative power\n380,1\n500,4\n730,2\n",
        "380\t1\n500\t4\n730\t2\n",
        "# measured\n\n380 1\n500 4\n730 2",
        "\ufeff380, 1, 0.1\r\n500, 4, 0.1\r\n730, 2, 0.1\r\n",
    ],
)
def test_an_illuminant_and_a_qe_from_a_file_beside_the_press_file(tmp_path: Path, text: str) -> None:
    (tmp_path / "lamp.csv").write_text(text, encoding="utf-8", newline="")
    (tmp_path / "qe.csv").write_text("380,0.1\n730,0.45\n", encoding="utf-8")
    toml = changed('illuminant = "D65"', 'file = "lamp.csv"')
    start = toml.index("quantum_efficiency")
    toml = toml.replace(toml[start : toml.index("\n", start)], 'quantum_efficiency = { file = "qe.csv" }')
    camera = camera_of(toml, tmp_path / "press.toml")
    assert camera.light.name == "lamp"
    np.testing.assert_allclose(camera.light.relative_power[[0, 6, 12, 35]], [1, 2.5, 4, 2])
    np.testing.assert_allclose(camera.sensors[0].quantum_efficiency, 0.1 + np.arange(36) * 0.01)


# --- what is wrong ---

MISSING = [
    ("light", "luminance_cd_m2 = 100.0\n", "light.luminance_cd_m2"),
    ("lens", "focal_length_mm = 60.0\n", "lens.focal_length_mm"),
    ("lens", "f_number = 2.8\n", "lens.f_number"),
    ("lens", "object_distance_mm = 546.6\n", "lens.object_distance_mm"),
    ("sensor", "pixels = 2048\n", "sensor.1.pixels"),
    ("sensor", "line_rate_hz = 2770.0\n", "sensor.1.line_rate_hz"),
    ("sensor", "read_noise_e = 30.0\n", "sensor.1.read_noise_e"),
    ("sensor", "bits = 12\n", "sensor.1.bits"),
]


@pytest.mark.parametrize(("block", "line", "field"), MISSING)
def test_a_missing_field_is_named(block: str, line: str, field: str) -> None:
    assert f"{field} is missing" in refused(changed(line, ""))


@pytest.mark.parametrize("block", ["light", "lens", "sensor"])
def test_a_missing_block_is_named(block: str) -> None:
    names = ["[light]", "[lens]", "[[sensor]]", "[transport]"]
    place = next(index for index, name in enumerate(names) if block in name)
    start, end = (CONTRACT.index(name) for name in names[place : place + 2])
    assert f"{block} is missing" in refused(CONTRACT[:start] + CONTRACT[end:])


NUMBERS = [
    ("luminance_cd_m2 = 100.0", "light.luminance_cd_m2"),
    ("focal_length_mm = 60.0", "lens.focal_length_mm"),
    ("f_number = 2.8", "lens.f_number"),
    ("transmittance = 1.0", "lens.transmittance"),
    ("object_distance_mm = 546.6", "lens.object_distance_mm"),
    ("pixels = 2048", "sensor.1.pixels"),
    ("pixel_pitch_um = 13.0", "sensor.1.pixel_pitch_um"),
    ("fill_factor = 0.90", "sensor.1.fill_factor"),
    ("tdi_stages = 96", "sensor.1.tdi_stages"),
    ("line_rate_hz = 2770.0", "sensor.1.line_rate_hz"),
    ("conversion_gain_uv_per_e = 10.0", "sensor.1.conversion_gain_uv_per_e"),
    ("voltage_swing_v = 2.0", "sensor.1.voltage_swing_v"),
    ("read_noise_e = 30.0", "sensor.1.read_noise_e"),
    ("dark_current_e_per_s = 500.0", "sensor.1.dark_current_e_per_s"),
    ("dsnu_e = 40.0", "sensor.1.dsnu_e"),
    ("prnu_percent = 1.0", "sensor.1.prnu_percent"),
    ("bits = 12", "sensor.1.bits"),
    ("black_level_dn = 0", "sensor.1.black_level_dn"),
    ("speed_mm_s = 292.0", "transport.speed_mm_s"),
    ("binning_along = 1", "transport.binning_along"),
    ("misprint_rate = 0.02", "costs.misprint_rate"),
    ("false_alarm_cents = 0.5", "costs.false_alarm_cents"),
    ("missed_misprint_cents = 3.0", "costs.missed_misprint_cents"),
    ("good_pages_per_false_alarm = 1000", "decision.good_pages_per_false_alarm"),
]


@pytest.mark.parametrize(("line", "field"), NUMBERS)
@pytest.mark.parametrize("value", ["-1", "nan", "inf", '"many"', "[1]"])
def test_a_number_that_cannot_be_is_named_with_its_field(line: str, field: str, value: str) -> None:
    name = line.partition(" =")[0]
    text = refused(changed(line, f"{name} = {value}"))
    assert f"{field}: " in text


@pytest.mark.parametrize(
    ("line", "field"),
    [
        ('f_number = "2.8"', "lens.f_number"),
        ('pixels = "2048"', "sensor.1.pixels"),
        ("tdi_stages = true", "sensor.1.tdi_stages"),
    ],
)
def test_text_and_booleans_are_no_numbers(line: str, field: str) -> None:
    name = line.partition(" =")[0]
    (old,) = (one for one in CONTRACT.splitlines() if one.startswith(f"{name} ="))
    assert f"{field}: " in refused(changed(old, line))


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("transmittance = 1.0", "transmittance = 1.2", "lens.transmittance"),
        ("fill_factor = 0.90", "fill_factor = 90", "sensor.1.fill_factor"),
        ("bits = 12", "bits = 17", "sensor.1.bits"),
        ("pixels = 2048", "pixels = 8", "sensor.1.pixels"),
        ("pixels = 2048", "pixels = 2048.5", "sensor.1.pixels"),
        ("pixels = 2048", "pixels = 99999999999999999999", "sensor.1.pixels"),
        ("misprint_rate = 0.02", "misprint_rate = 1.0", "costs.misprint_rate"),
        ("good_pages_per_false_alarm = 1000", "good_pages_per_false_alarm = 1", "good_pages_per_false_alarm"),
        ("0.37, 0.32]", "37, 0.32]", "sensor.1.quantum_efficiency.qe.3"),
        ("0.37, 0.32]", "nan, 0.32]", "sensor.1.quantum_efficiency.qe.3"),
        ("object_distance_mm = 546.6", "object_distance_mm = 60.0", "object_distance_mm"),
    ],
)
def test_a_number_out_of_range_is_named_with_its_field(old: str, new: str, field: str) -> None:
    assert field in refused(changed(old, new))


@pytest.mark.parametrize(
    ("old", "new", "field", "meant"),
    [
        ("transmittance =", "transmitance =", "lens.transmitance", "transmittance"),
        ("black_level_dn =", "black_lvl_dn =", "sensor.1.black_lvl_dn", "black_level_dn"),
        ("speed_mm_s =", "speed_mms =", "transport.speed_mms", "speed_mm_s"),
        ("misprint_rate =", "misprints_rate =", "costs.misprints_rate", "misprint_rate"),
        ("[transport]", "[transports]", "transports", "transport"),
        (
            "good_pages_per_false_alarm =",
            "good_pages_per_alarm =",
            "decision.good_pages_per_alarm",
            "good_pages_per_false_alarm",
        ),
    ],
)
def test_a_misspelt_field_is_named_with_what_was_meant(old: str, new: str, field: str, meant: str) -> None:
    text = refused(changed(old, new))
    assert f"{field} is not a known field" in text
    assert f"did you mean {meant}?" in text


@pytest.mark.parametrize(
    ("old", "new", "meant"),
    [
        ("pixels =", "pixles =", "pixels"),
        ("f_number =", "fnumber =", "f_number"),
        ("luminance_cd_m2 =", "luminance_cdm2 =", "luminance_cd_m2"),
        ("[lens]", "[lense]", "lens"),
    ],
)
def test_a_misspelt_required_field_is_named_with_what_was_meant(old: str, new: str, meant: str) -> None:
    assert f"did you mean {meant}?" in refused(changed(old, new))


def test_an_unknown_field_like_no_other_shows_the_known_ones() -> None:
    text = refused(changed("transmittance = 1.0", "zoom = 2"))
    assert "lens.zoom is not a known field" in text
    assert "f_number" in text


def test_one_fault_is_not_counted_as_two() -> None:
    assert "more)" not in refused(changed("bits = 12", "bits = 17"))


def test_of_several_faults_the_number_is_told() -> None:
    text = changed("f_number = 2.8", "f_number = -1").replace("transmittance = 1.0", "transmittance = 2")
    assert "lens.f_number" in refused(text)
    assert "(and 1 more)" in refused(text)


def test_an_unknown_illuminant_is_answered_with_the_known_ones() -> None:
    text = refused(changed('"D65"', '"D66"'))
    assert "light.illuminant" in text
    assert "'D66'" in text
    assert "F11" in text


@pytest.mark.parametrize(
    ("new", "said"),
    [
        ("", "needs either illuminant or file"),
        ('illuminant = "D65"\nfile = "lamp.csv"', "needs either illuminant or file"),
        ('file = "none.csv"', "cannot be read"),
    ],
)
def test_light_has_one_source(tmp_path: Path, new: str, said: str) -> None:
    text = refused(changed('illuminant = "D65"', new), tmp_path / "press.toml")
    assert "light" in text
    assert said in text


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "no two columns"),
        ("wave,power\n", "no two columns"),
        ("400,1\n730,2\n", "covers 400..730"),
        ("380,1\n700,2\n", "covers 380..700"),
        ("730,1\n380,2\n", "must increase"),
        ("380,nan\n730,2\n", "finite"),
    ],
)
def test_a_lamp_file_that_cannot_be_used_is_named(tmp_path: Path, content: str, said: str) -> None:
    (tmp_path / "lamp.csv").write_text(content, encoding="utf-8")
    text = refused(changed('illuminant = "D65"', 'file = "lamp.csv"'), tmp_path / "press.toml")
    assert "light.file" in text
    assert "lamp.csv" in text
    assert said in text


def test_a_lamp_file_that_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "lamp.csv").write_bytes(b"\xff\xfe\x00\x81")
    text = refused(changed('illuminant = "D65"', 'file = "lamp.csv"'), tmp_path / "press.toml")
    assert "lamp.csv cannot be read" in text


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[380, 390, 550, 730]", "[390, 400, 550, 730]", "covers 390..730 nm"),
        ("[380, 390, 550, 730]", "[380, 390, 550, 700]", "covers 380..700 nm"),
        ("[380, 390, 550, 730]", "[380, 550, 390, 730]", "must increase"),
        ("[380, 390, 550, 730]", "[380, 550, 730]", "one value for each"),
        (", qe = [0.03, 0.05, 0.37, 0.32]", "", "needs either wave_nm and qe, or file"),
        ("{ wave_nm", '{ file = "qe.csv", wave_nm', "needs either wave_nm and qe, or file"),
        (
            "{ wave_nm = [380, 390, 550, 730], qe = [0.03, 0.05, 0.37, 0.32] }",
            '{ file = "no.csv" }',
            "no.csv",
        ),
        ("{ wave_nm = [380, 390, 550, 730], qe = [0.03, 0.05, 0.37, 0.32] }", "0.4", "quantum_efficiency"),
    ],
)
def test_a_quantum_efficiency_that_cannot_be_used(old: str, new: str, said: str) -> None:
    text = refused(changed(old, new))
    assert "sensor.1.quantum_efficiency" in text
    assert said in text


@pytest.mark.parametrize("field", ["pixels = 1024", "pixel_pitch_um = 7.0", "line_rate_hz = 5000.0"])
def test_sensors_that_cannot_stand_side_by_side(field: str) -> None:
    name = field.partition(" =")[0]
    sensor = CONTRACT[CONTRACT.index("[[sensor]]") : CONTRACT.index("[transport]")]
    (old,) = (line for line in sensor.splitlines() if line.startswith(f"{name} ="))
    second = sensor.replace(old, field).replace("mono", "blue")
    text = refused(changed("[transport]", second + "[transport]"))
    assert f"sensors must share {name}: mono and blue differ" in text


def test_a_fault_in_the_second_sensor_is_counted_from_1() -> None:
    sensor = CONTRACT[CONTRACT.index("[[sensor]]") : CONTRACT.index("[transport]")]
    second = sensor.replace("bits = 12", "bits = 99").replace("mono", "blue")
    assert "sensor.2.bits" in refused(changed("[transport]", second + "[transport]"))


@pytest.mark.parametrize("text", ["[light\n", "a = \n", "x = 1\nx = 2\n", "\0"])
def test_what_is_no_toml_is_told_with_its_line(text: str) -> None:
    assert "is not TOML" in refused(text)


def test_a_single_bracket_sensor_is_refused() -> None:
    assert "sensor" in refused(changed("[[sensor]]", "[sensor]"))


def test_an_empty_file_lacks_everything() -> None:
    assert "light is missing (and 2 more)" in refused("")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    binary = tmp_path / "press.toml"
    binary.write_bytes(b"\x89PNG\r\n\x1a\n\xff")
    for path, said in (
        (binary, "is not text"),
        (tmp_path / "none.toml", "cannot be read"),
        (tmp_path, "cannot be read"),
    ):
        with pytest.raises(PressFileError) as refusal:
            PressFile.read(path)
        assert str(refusal.value).startswith(f"{path}: {said}")
        assert "\n" not in str(refusal.value)


# --- how the matched filter looks ---


def test_fringes_are_followed_unless_the_file_says_otherwise(prototype: PressFile) -> None:
    assert prototype.fringes
    assert not PressFile(Path("press.toml"), CONTRACT + "[inspection]\nfringes = false\n").fringes


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('fringes = "yes"', "inspection.fringes"),
        ("fringes = 1", "inspection.fringes"),
        ("fringe = true", "did you mean fringes?"),
    ],
)
def test_a_wrong_inspection_is_refused_by_name(text: str, said: str) -> None:
    assert said in refused(f"{CONTRACT}[inspection]\n{text}\n")


# --- what no press has ---


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a = " + "9" * 5000, "thousands of digits"),
        ("a = 0x" + "f" * 5000, "a is a number of more than 18 digits"),
        (
            changed("bits = 12", "bits = 99999999999999999999"),
            "sensor.1.bits is a number of more than 18 digits",
        ),
        ("a = " + "[" * 100_000 + "]" * 100_000, "lists nested too deeply"),
        (changed("wave_nm = [380", "wave_nm = [[[[[[[[380]]]]]]]"), "sensor.1 holds tables in tables"),
        ("a." * 50_000 + "b = 1", "line 1 has a name of more than 32 parts"),
        (CONTRACT + '"' + "k" * 100_000 + '" = 1', "is not a known field"),
        (changed('"D65"', '"' + "[" * 100_000 + '"'), "there is no illuminant"),
    ],
)
def test_what_cannot_even_be_checked(text: str, said: str) -> None:
    assert said in refused(text)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("object_distance_mm = 546.6", "object_distance_mm = 60.0000001", "a pixel would see"),
        ("object_distance_mm = 546.6", "object_distance_mm = 1e9", "a pixel would see"),
        ("object_distance_mm = 546.6", "object_distance_mm = 60.0", "object_distance_mm must exceed"),
        ("pixel_pitch_um = 13.0", "pixel_pitch_um = 1e-300", "sensor.1.pixel_pitch_um"),
        ("pixels = 2048", "pixels = 1000000000", "sensor.1.pixels"),
        ("bits = 12", "bits = 60", "sensor.1.bits"),
        ("tdi_stages = 96", "tdi_stages = 1000000000", "sensor.1.tdi_stages"),
        ("line_rate_hz = 2770.0", "line_rate_hz = inf", "sensor.1.line_rate_hz"),
        ("line_rate_hz = 2770.0", "line_rate_hz = 1", "give a sensor.line_rate_hz of about 2770"),
        ("line_rate_hz = 2770.0", "line_rate_hz = 600", "would be smeared over"),
        ("line_rate_hz = 2770.0", "line_rate_hz = 1e9", "lines would be"),
        ("binning_along = 1", "binning_along = 300", "lines would be"),
        (
            "black_level_dn = 0",
            "black_level_dn = 5000",
            "black_level_dn must be below the greatest code, 4095",
        ),
        ("luminance_cd_m2 = 100.0", "luminance_cd_m2 = 1e-9", "is not sensitive to this light"),
        ("qe = [0.03, 0.05, 0.37, 0.32]", "qe = [0, 0, 0, 0]", "is not sensitive to this light"),
        ("[transport]", "[transport]\nlead_in_mm = 1e30", "transport.lead_in_mm"),
        ("_false_alarm = 1000", "_false_alarm = nan", "decision.good_pages_per_false_alarm"),
        ("_false_alarm = 1000", "_false_alarm = 1e300", "decision.good_pages_per_false_alarm"),
    ],
)
def test_numbers_that_no_camera_can_have(old: str, new: str, said: str) -> None:
    assert said in refused(changed(old, new))


def test_a_scan_that_no_memory_holds() -> None:
    fine = changed("pixels = 2048", "pixels = 65536").replace("speed_mm_s = 292.0", "speed_mm_s = 3.0")
    assert "a scan of an A4 page would take" in refused(fine.replace("tdi_stages = 96", "tdi_stages = 1"))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("nm,power\n380,1\n400,x\n730,2\n", "line 3: '400,x' is not a wavelength"),
        ("380,1\n400\n730,2\n", "line 2: '400' is not a wavelength"),
        ("38O,1\n390,1\n730,2\n", "line 1: '38O,1' is not a wavelength"),
        ("380,1\n730,2\nend\n", "line 3: 'end' is not a wavelength"),
        ("380,1\n380,1\n730,2\n", "line 2: 380 nm does not follow 380 nm"),
        ("380,1\n400,-1\n730,2\n", "line 2: -1 is not in 0.."),
        ("380,0\n730,0\n", "holds no light"),
        ("380,1e999\n730,0\n", "line 1"),
        ("\n" * 1_000_000, "is larger than 0.25 MB"),
    ],
)
def test_no_line_of_a_curve_is_left_out_in_silence(tmp_path: Path, content: str, said: str) -> None:
    (tmp_path / "lamp.csv").write_text(content, encoding="utf-8")
    text = refused(changed('illuminant = "D65"', 'file = "lamp.csv"'), tmp_path / "press.toml")
    assert "lamp.csv" in text
    assert said in text


@pytest.mark.parametrize("content", ["# a lamp\nnm;power\n380;0,5\n\n730;1\n", "380\t0.5\r\n730\t1\r\n"])
def test_curves_as_spreadsheets_write_them(tmp_path: Path, content: str) -> None:
    (tmp_path / "lamp.csv").write_bytes(content.encode())
    camera = camera_of(changed('illuminant = "D65"', 'file = "lamp.csv"'), tmp_path / "press.toml")
    np.testing.assert_allclose(camera.light.relative_power[[0, -1]], [0.5, 1.0])


@pytest.mark.parametrize("name", [".", "none.csv", "a\\u0000b"])
def test_a_curve_that_is_no_file(tmp_path: Path, name: str) -> None:
    text = refused(changed('illuminant = "D65"', f'file = "{name}"'), tmp_path / "press.toml")
    assert "cannot be read" in text


def test_a_quantum_efficiency_above_one_names_its_file(tmp_path: Path) -> None:
    (tmp_path / "qe.csv").write_text("380,30\n730,50\n", encoding="utf-8")
    start = CONTRACT.index("quantum_efficiency")
    inline = CONTRACT[start : CONTRACT.index("\n", start)]
    text = refused(changed(inline, 'quantum_efficiency.file = "qe.csv"'), tmp_path / "press.toml")
    assert "qe.csv goes up to 50" in text


def test_an_unknown_ink_model_names_the_field() -> None:
    press_file = PressFile(Path("press.toml"), CONTRACT + '[inks]\nchart = "none.txt"\nmodel = "best"')
    with pytest.raises(PressFileError, match=r"press\.toml: inks\.model: there is no ink model 'best'"):
        press_file.inks()


PARTS = """
[[press.rollers]]
name = "fuser"
circumference_mm = 94.2
[[press.heads]]
name = "black bar"
ink = "K"
first_nozzle_mm = -1.0
nozzle_pitch_um = 42.0
nozzles = 5000
"""


def test_rollers_and_heads() -> None:
    parts = PressFile(Path("x.toml"), CONTRACT + PARTS).parts
    assert parts.rollers[0].tolerance_mm == pytest.approx(0.2826)
    assert parts.heads[0].nozzle_at(-1.0 + 0.042 * 99) == pytest.approx(100)
    assert PressFile(Path("x.toml"), CONTRACT).parts.rollers == ()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("94.2", "5.0", "press.rollers.1.circumference_mm"),
        ('"K"', '"orange"', "press.heads.1.ink"),
        ("nozzles = 5000", "nozzles = 0", "press.heads.1.nozzles"),
        (
            "[[press.heads]]",
            "[[press.rollers]]\nname = 'fuser'\ncircumference_mm = 50.0\n[[press.heads]]",
            "two of the name",
        ),
    ],
)
def test_parts_that_no_press_has(old: str, new: str, said: str) -> None:
    with pytest.raises(PressFileError, match=said):
        PressFile(Path("x.toml"), CONTRACT + PARTS.replace(old, new))
