"""Readers of text: press files and the curves they name, charts, recipes, spectra; and of ICC profiles."""

from __future__ import annotations

import functools
import json
import struct
from importlib import resources
from pathlib import Path

import numpy as np
from tests.fuzz.harness import Target
from tests.fuzz.spoiling import spoil_bytes, spoil_text
from tests.stand_ins import cmyk_profile

PRESETS = ("prototype.toml", "two-sensors.toml", "rgb-line.toml", "scanner.toml")
MOVING = "[transport]\nspeed_mm_s = 292.0\nbinning_along = 1\nlead_in_mm = 2.0\nbacking_reflectance = 0.05\n"
VARYING = """[inspection]
fringes = true
[decision]
good_pages_per_false_alarm = 1000
[variation]
all_times = 0.5
[variation.page]
shift_mm = 0.3
[variation.paper]
specks_ink_percent = [2.0, 12.0]
[variation.camera]
sigma_error = [0.67, 1.5]
"""
CURVE = "wave_nm,value\n" + "".join(f"{nm},{0.1 + nm / 2000:.4f}\n" for nm in range(380, 731, 10))


def _preset(name: str) -> str:
    return resources.files("prooflight.press").joinpath("presets", name).read_text(encoding="utf-8")


# Press files.


def press_samples() -> list[bytes]:
    plain = [_preset(name) for name in PRESETS]
    return [text.encode() for text in (*plain, plain[0] + MOVING + VARYING)]


def read_press(path: Path) -> None:
    """As the commands do that need no tables: what is accepted gives finite numbers wherever it is used."""
    from prooflight.camera import camera as sensing
    from prooflight.camera.lens_correction import SHORT_REACH_PIXELS, lens_correction
    from prooflight.camera.sensor import draw_fixed_pattern
    from prooflight.camera.sharpness import nyquist_per_mm, sharpness
    from prooflight.commissioning.build import refuse_light
    from prooflight.commissioning.characterise import calibrate_columns
    from prooflight.press.press_file import PressFile
    from prooflight.simulation.worlds import Amounts

    press_file = PressFile.read(path)
    camera = press_file.camera()
    geometry = press_file.geometry(camera)
    press_file.costs()
    Amounts.stated(press_file.variation())
    white = np.full(36, 0.85)
    rng = np.random.default_rng(1)
    numbers: list[object] = [geometry.field_mm, geometry.raster_dpi(2), geometry.lines(297.0)]
    for answer in sensing.respond(camera, white):
        numbers += [answer.dn_mean, answer.dn_sigma_total, answer.volts, answer.illuminance_lux]
    for sensor in camera.sensors:
        footprint = camera.footprint(sensor, reach_pixels=SHORT_REACH_PIXELS)
        correction = lens_correction(camera, sensor, footprint)
        sharp = sharpness(camera, sensor, nyquist_per_mm(sensor))
        numbers += [footprint.across, footprint.along, correction.near, sharp.across, sharp.along]
    refuse_light(press_file, camera)
    patterns = [draw_fixed_pattern(sensor, rng) for sensor in camera.sensors]
    for columns in calibrate_columns(camera, patterns=patterns, white_reflectance=white, lines=8, rng=rng):
        numbers += [columns.offset_dn, columns.gain]
    assert all(np.isfinite(value).all() for value in numbers)


def press_command(path: Path) -> list[str]:
    return ["camera", "mtf", str(path), "--json"]


# Curves that a press file names: light and quantum efficiency.


def curve_samples() -> list[bytes]:
    return [
        CURVE.encode(),
        CURVE.replace(",", "\t").encode(),
        b"\xef\xbb\xbf" + CURVE.replace(",", " ").encode(),
    ]


def _press_with(path: Path, old: str, new: str) -> Path:
    """A press file beside the curve that names it."""
    text = _preset(PRESETS[0])
    assert old in text
    beside = path.with_name(f"{path.name}.toml")
    beside.write_text(text.replace(old, new.format(path.name)))
    return beside


def _with_light(path: Path) -> Path:
    return _press_with(path, 'illuminant = "D65" ', 'file = "{}" ')


def _with_efficiency(path: Path) -> Path:
    text = _preset(PRESETS[0])
    start = text.index("[sensor.quantum_efficiency]")
    return _press_with(
        path, text[start : text.index("[costs]")], '[sensor.quantum_efficiency]\nfile = "{}"\n'
    )


def read_light(path: Path) -> None:
    read_press(_with_light(path))


def read_efficiency(path: Path) -> None:
    read_press(_with_efficiency(path))


def light_command(path: Path) -> list[str]:
    return press_command(_with_light(path))


# Charts and recipes.


@functools.cache
def _small_chart() -> bytes:
    """48 recipes of the built-in inks, as CGATS text."""
    from prooflight.inks.built_in import built_in_inks
    from prooflight.inks.recipes import choose_recipes, printable_recipes
    from prooflight.spectra import WAVE_NM

    candidates = printable_recipes()
    cmyk = candidates[choose_recipes(candidates, 48)]
    rows = [
        "\t".join(
            [f'"P {at}"', *(f"{100 * ink:.2f}" for ink in recipe), *(f"{value:.4f}" for value in spectrum)]
        )
        for at, (recipe, spectrum) in enumerate(zip(cmyk, built_in_inks().reflectance(cmyk), strict=True))
    ]
    fields = ["SAMPLE_NAME", *(f"CMYK_{ink}" for ink in "CMYK"), *(f"SPECTRAL_NM{nm:.0f}" for nm in WAVE_NM)]
    head = ["CGATS.17", 'ORIGINATOR "Prooflight"', f"NUMBER_OF_FIELDS {len(fields)}", "BEGIN_DATA_FORMAT"]
    middle = ["END_DATA_FORMAT", f"NUMBER_OF_SETS {len(rows)}", "BEGIN_DATA"]
    return "\n".join([*head, "\t".join(fields), *middle, *rows, "END_DATA", ""]).encode()


def chart_samples() -> list[bytes]:
    return [_small_chart(), _small_chart().replace(b"\t", b" ").replace(b"\n", b"\r\n")]


def read_chart_file(path: Path) -> None:
    from prooflight.inks.chart import read_chart

    chart = read_chart(path)
    recipes = chart.recipes()
    chart.scatter()
    assert np.isfinite(recipes.cmyk).all()
    assert np.isfinite(recipes.reflectance).all()
    assert chart.digest


def chart_command(path: Path) -> list[str]:
    wanted = path.with_name("wanted.csv")
    wanted.write_text("C,M,Y,K\n10,20,30,40\n")
    return ["chart", "predict", str(path), "--cmyk", str(wanted), "--model", "log-linear", "--json"]


def recipes_samples() -> list[bytes]:
    rows = "".join(f"{at % 101},{at * 7 % 101},{at * 3 % 101}.5,0\n" for at in range(40)).replace(
        "100.5", "100"
    )
    names = "name\tK\tY\tM\tC\n" + "".join(f'"patch {at}"\t0\t0,5\t{at}\t{2 * at}\n' for at in range(30))
    return [
        f"C,M,Y,K\n{rows}".encode(),
        f"\ufeffc;m;y;k\r\n{rows.replace(',', ';')}".encode(),
        names.encode(),
    ]


def read_recipes_file(path: Path) -> None:
    from prooflight.inks.recipes import read_recipes

    recipes = read_recipes(path)
    assert np.isfinite(recipes).all()
    assert recipes.min() >= 0
    assert recipes.max() <= 1


def recipes_command(path: Path) -> list[str]:
    chart = path.with_name("chart.txt")
    chart.write_bytes(_small_chart())
    return ["chart", "predict", str(chart), "--cmyk", str(path), "--model", "log-linear", "--json"]


@functools.cache
def placed_samples() -> list[bytes]:
    """The recipe file of ``chart make``."""
    import tempfile

    from prooflight.inks.chart_layout import Layout, place_recipes, write_recipes
    from prooflight.inks.recipes import printable_recipes

    placed = place_recipes(printable_recipes()[:60], Layout(), np.random.default_rng(1))
    with tempfile.TemporaryDirectory() as folder:
        write_recipes(Path(folder) / "chart.txt", placed)
        return [(Path(folder) / "chart.txt").read_bytes()]


def read_placed(path: Path) -> None:
    from prooflight.inks.chart_layout import read_recipe_file
    from prooflight.inks.chart_print import painted

    placed = read_recipe_file(path)
    assert np.isfinite(placed.cmyk).all()
    assert placed.pages < 256
    for page in range(1, placed.pages + 1):
        for (x, y, width, height), _ in painted(placed, page):
            assert 0 <= x <= x + width <= placed.layout.width_mm
            assert 0 <= y <= y + height <= placed.layout.height_mm


# Reflectances.


def reflectance_samples() -> list[bytes]:
    grid = list(range(380, 731, 10))
    curves = [[0.05 + 0.01 * patch + nm / 1000 for nm in grid] for patch in range(4)]
    return [
        json.dumps({"wave_nm": grid, "reflectance": curves}).encode(),
        json.dumps({"wave_nm": [360, 555.5, 900], "reflectance": [[0.0, 1.0, 0.0]]}, indent=1).encode(),
    ]


def read_reflectance(path: Path) -> None:
    from prooflight.camera.reflectances import REFLECTANCE_FILES, parse_reflectances

    colours = parse_reflectances(REFLECTANCE_FILES.read_text(path), where=path)
    assert np.isfinite(colours).all()
    assert colours.min() >= 0
    assert colours.shape[1] == 36


def reflectance_command(path: Path) -> list[str]:
    press = resources.files("prooflight.press").joinpath("presets", PRESETS[0])
    return ["camera", "respond", str(press), "--reflectance", str(path), "--json"]


# What studies read.


def manifest_samples() -> list[bytes]:
    usual = {"strata": ["dense text"], "chars": 900, "img_frac": 0.0, "w_pt": 595.2, "source": "a b"}
    return [json.dumps([{"id": f"d{at:03}", **usual} for at in range(5)], indent=1).encode()]


def read_manifest_file(path: Path) -> None:
    from prooflight_studies.edges.study import read_manifest

    entries = read_manifest(path)
    assert all("/" not in entry.id and np.isfinite([entry.img_frac, entry.w_pt]).all() for entry in entries)


def marks_samples() -> list[bytes]:
    return [b"2 3 30 31 1\n5 6 7 8 4\n\n9 9 39 39 6\n"]


def read_marks(path: Path) -> None:
    from PIL import Image

    from prooflight_studies.golden.pairs import read_pairs

    for which in ("temp", "test"):
        Image.new("L", (40, 40), 200).save(path.with_name(f"{path.stem}_{which}.jpg"))
    (pair,) = read_pairs(path.parent)
    assert all(0 <= left < right <= 40 for left, _, right, _ in pair.marked)


# ICC profiles.


def profile_samples() -> list[bytes]:
    """The least that an output profile of CMYK needs: tables both ways, two nodes an ink and three a colour."""
    return [cmyk_profile(ink_nodes=2, colour_nodes=3)]


def spoil_profile(data: bytes, rng: np.random.Generator) -> bytes:
    """Its length is put right again in most cases, so that more than the header is read."""
    spoilt = bytearray(spoil_bytes(data, rng))
    if rng.random() < 0.7 and len(spoilt) > 4:
        spoilt[:4] = struct.pack(">I", len(spoilt))
    return bytes(spoilt)


def read_icc(path: Path) -> None:
    """As ``--profile`` of a job."""
    from reportlab.pdfgen.canvas import Canvas

    from prooflight.pages.pdf.rip import PdfJob

    job = path.with_name("one-page.pdf")
    if not job.exists():
        canvas = Canvas(str(job), pagesize=(72, 72))
        canvas.setFillColorCMYK(0, 0.5, 0, 0)
        canvas.rect(9, 9, 54, 54, stroke=0, fill=1)
        canvas.save()
    with PdfJob(job, profile=path) as opened:
        assert len(opened) == 1


# Zones.


def zone_samples() -> list[bytes]:
    zone = {"name": "face", "kind": "careful", "pages": "1,2", "rectangle_mm": [10, 10.5, 20, 30]}
    other = {"name": "stamp", "kind": "ignore", "polygon_mm": [[50, 50], [80, 50], [50, 90]]}
    price = {
        "press": "ab", "zones": "cd", "prints": 3, "seed": 1, "page_scores": [0.5, 1.5], "careful_scores": [1, 2],
        "careful_mean": [0.1], "careful_sd": [1.0], "told": [{"name": "face"}],
    }  # fmt: skip
    whole = {"schema": 1, "careful_share": 0.2, "zones": [zone, other], "price": price}
    return [json.dumps(one).encode() for one in ({"zones": [zone]}, whole)]


def read_zones(path: Path) -> None:
    """What is accepted has places on the page and a digest."""
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zones_file import JobZones

    zones = JobZones.read(path, [(148.0, 210.0)] * 3)
    assert len(zones.digest) == 64
    places = np.arange(0.5, 148, 7.0)
    for number in zones.of_pages:
        page = Page(cmyk=np.zeros((210, 148, 4), np.uint8), dpi=25.4, name="p", number=number)
        of_page = zones.page(page)
        assert of_page is not None
        held = sum(
            of_page.holds(kind, places, places).astype(int) for kind in ("ignore", "normal", "careful")
        )
        assert held.max() <= 1


# Spectra of spot inks.


def cxf_samples() -> list[bytes]:
    from tests.pages.test_cxf import cxf

    return [cxf().encode()]


def read_cxf_file(path: Path) -> None:
    """What is accepted has finite spectra, on any paper."""
    from prooflight.pages.spots.cxf import read_cxf, read_spot_ink

    ink = read_spot_ink(read_cxf(path), "Orange 021", file=str(path))
    assert np.isfinite(ink.on_paper(np.full(36, 0.8)).measured).all()


TARGETS = (
    Target(
        name="press-toml",
        suffix=".toml",
        samples=press_samples,
        mutate=spoil_text,
        read=read_press,
        command=press_command,
    ),
    Target(name="cxf", suffix=".cxf", samples=cxf_samples, mutate=spoil_text, read=read_cxf_file),
    Target(name="zones", suffix=".json", samples=zone_samples, mutate=spoil_text, read=read_zones),
    Target(
        name="light-curve",
        suffix=".csv",
        samples=curve_samples,
        mutate=spoil_text,
        read=read_light,
        command=light_command,
    ),
    Target(name="qe-curve", suffix=".csv", samples=curve_samples, mutate=spoil_text, read=read_efficiency),
    Target(
        name="chart",
        suffix=".txt",
        samples=chart_samples,
        mutate=spoil_text,
        read=read_chart_file,
        command=chart_command,
    ),
    Target(
        name="recipes-csv",
        suffix=".csv",
        samples=recipes_samples,
        mutate=spoil_text,
        read=read_recipes_file,
        command=recipes_command,
    ),
    Target(name="recipes-placed", suffix=".txt", samples=placed_samples, mutate=spoil_text, read=read_placed),
    Target(
        name="reflectance-json",
        suffix=".json",
        samples=reflectance_samples,
        mutate=spoil_text,
        read=read_reflectance,
        command=reflectance_command,
    ),
    Target(
        name="manifest",
        suffix=".json",
        samples=manifest_samples,
        mutate=spoil_text,
        read=read_manifest_file,
    ),
    Target(name="golden-marks", suffix=".txt", samples=marks_samples, mutate=spoil_text, read=read_marks),
    Target(name="icc", suffix=".icc", samples=profile_samples, mutate=spoil_profile, read=read_icc),
)
