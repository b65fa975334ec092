"""Units that print spot inks: which spectrum counts, and the light that it predicts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from tests.cli.calls import call
from tests.pages.conftest import one_page, stream
from tests.pages.test_cxf import cxf, spectrum

from prooflight.commissioning.build import build_press, spot_units
from prooflight.errors import InputError
from prooflight.pages.spots.spot_ink import SpotInk, SpotPrint
from prooflight.press.artefact import Press
from prooflight.press.job_spectra import JobSpectra
from prooflight.press.pages import open_job, predict
from prooflight.press.press_file import PressFile
from prooflight.press.spot_units import SpotUnit

NAME = "Orange 021"
CYAN = "/DeviceCMYK<</FunctionType 2/Domain[0 1]/N 1/C0[0 0 0 0]/C1[1 0 0 0]>>"
SEPARATION = f"/ColorSpace<</Spot[/Separation/Orange#20021{CYAN}]>>"
PAINTED = "/Spot cs 1 scn 0 0 100 100 re f"


@pytest.fixture(scope="module")
def file() -> PressFile:
    return PressFile.preset("rgb-line.toml")


@pytest.fixture(scope="module")
def rgb(file: PressFile) -> Press:
    """A press with a camera of three sensors, and without a unit."""
    return build_press(file, seed=1, pixels=400)


def with_unit(press: Press, file: PressFile, unit: SpotUnit) -> Press:
    return replace(press, spot_units=spot_units(file.camera(), file.inks(), [unit]))


def ink(solid: NDArray[np.float64], **more: Any) -> SpotInk:
    return SpotInk(name=NAME, tint=np.array([1.0]), measured=solid[None], **more)


def printed(press: Press, job: JobSpectra | None = None) -> SpotPrint:
    assert press.spot_units is not None
    (one,) = press.spot_units.prints(press.sensors, job or JobSpectra())
    return one


def job_of(folder: Path, *, text: str | None = None, content: str = PAINTED, spots: str = SEPARATION) -> Path:
    """A page in a spot ink whose alternate is cyan; text: CxF in the output intent."""
    intent = "/OutputIntents[<</Type/OutputIntent/S/GTS_PDFX/OutputConditionIdentifier(X)"
    spectra = "/SpectralData<</Orange#20021 5 0 R>>" if text is not None else ""
    hints = "/MixingHints<</Solidities<</White 0.9/Varnish 2/None /x>>>>"
    path = folder / "job.pdf"
    path.write_bytes(
        one_page(
            content,
            resources=spots,
            catalogue=f"{intent}{spectra}{hints}>>]",
            more=() if text is None else (stream(text.encode()),),
        )
    )
    return path


def middle_of(path: Path, press: Press) -> list[int]:
    with open_job(path, press) as job:
        cmyk = job.page(1).cmyk
    return [int(value) for value in cmyk[cmyk.shape[0] // 2, cmyk.shape[1] // 2]]


def test_the_light_of_a_spectrum_is_predicted(rgb: Press, file: PressFile, tmp_path: Path) -> None:
    """A solid is seen as the camera's response to its spectrum, whatever the file's alternate is."""
    solid = file.inks().reflectance(np.array([0, 0.55, 0.9, 0.05]))
    press = with_unit(rgb, file, SpotUnit.of(ink(solid)))
    with open_job(job_of(tmp_path), press) as job:
        assert job.warnings == ()
        page = job.page(1)
    assert press.spot_units is not None
    exact = np.array(press.spot_units.response_dn) @ solid
    middle = predict(page, press).expected_dn[:, 40, 180:200]
    for sensor, line, light in zip(press.sensors, middle, exact, strict=True):
        seen = (line - sensor.column_offset_dn[180:200]) / sensor.column_gain[180:200]
        # A byte of ink is at most 0.4 % of white, half of it rounding.
        np.testing.assert_allclose(seen / sensor.white_dn, light / sensor.white_dn, atol=3e-3)
    # Where inks are mixed without black, the least mixture with the light of a recipe is that recipe.
    plain = file.inks().reflectance(np.array([0, 0.55, 0.9, 0]))
    mixed = printed(with_unit(rgb, file, SpotUnit.of(ink(plain))))
    np.testing.assert_allclose(mixed.mixture[-1], [0, 0.55, 0.9, 0], atol=0.01)
    np.testing.assert_allclose(mixed.mixture[0], np.zeros(4), atol=0.005)
    assert mixed.light_off < 1e-3


def test_the_press_has_the_ink_in_every_space(rgb: Press, file: PressFile, tmp_path: Path) -> None:
    """In a DeviceN space with black the ink stays on its plate, and the unit's ink is added to black."""
    press = with_unit(rgb, file, SpotUnit.of(ink(file.inks().reflectance(np.array([0, 0.5, 0.8, 0])))))
    function = b"{pop pop 1 0 0 0}"
    path = tmp_path / "two.pdf"
    path.write_bytes(
        one_page(
            "/Spot cs 1 0.2 scn 0 0 100 100 re f",
            resources="/ColorSpace<</Spot[/DeviceN[/Orange#20021/Black]/DeviceCMYK 5 0 R]>>",
            more=(stream(function, b"/FunctionType 4/Domain[0 1 0 1]/Range[0 1 0 1 0 1 0 1]"),),
        )
    )
    assert middle_of(path, press) == pytest.approx([0, 128, 204, 51], abs=4)
    assert middle_of(path, rgb) == [255, 0, 0, 0]  # a press without the ink paints the alternate


def test_which_spectrum_counts(rgb: Press, file: PressFile, tmp_path: Path) -> None:
    """The press file's, else that of a file beside the job, else the PDF's; without one, the file's alternate."""
    recipes = {"press": [0, 0, 0.8, 0], "beside": [0, 0.8, 0, 0], "pdf": [0.5, 0, 0.5, 0]}
    solids = {name: file.inks().reflectance(np.array(recipe)) for name, recipe in recipes.items()}
    texts = {name: cxf(solid=spectrum(solid), sets=SOLID_ALONE) for name, solid in solids.items()}
    path = job_of(tmp_path, text=texts["pdf"])
    from_jobs = with_unit(rgb, file, SpotUnit(name=NAME))
    assert middle_of(path, from_jobs) == pytest.approx([128, 0, 128, 0], abs=4)
    (tmp_path / "job.cxf").write_text(texts["beside"])
    assert middle_of(path, from_jobs) == pytest.approx([0, 204, 0, 0], abs=4)
    (tmp_path / "orange.cxf").write_text(texts["press"])
    stated = PressFile(tmp_path / "x.toml", with_spots(f'name = "{NAME}"\ncxf = "orange.cxf"'))
    own = with_unit(rgb, file, *stated.spot_units())
    assert middle_of(path, own) == pytest.approx([0, 0, 204, 0], abs=4)
    other = job_of(tmp_path)
    (tmp_path / "job.cxf").unlink()
    assert middle_of(other, from_jobs) == [255, 0, 0, 0]
    with open_job(other, from_jobs) as job:
        (warning,) = job.warnings
        found = job.document_facts()
    assert (warning.page, warning.kind, warning.object_name) == (-1, "spot-print", NAME)
    assert "neither the press file nor the job states its spectrum" in warning.message
    assert found is not None
    assert found.solidities == {"White": 0.9}


SOLID_ALONE = """<sic:MeasurementSet Background="Substrate"><sic:Measurement TintLevel="100" ObjectRef="o2"/>
</sic:MeasurementSet>"""


def with_spots(*units: str, more: str = "") -> str:
    text = PressFile.preset("rgb-line.toml").text
    return text + more + "".join(f"\n[[inks.spot]]\n{unit}\n" for unit in units)


def test_what_prediction_cannot_meet_is_a_warning(rgb: Press, file: PressFile) -> None:
    vivid = np.where((np.arange(36) > 12) & (np.arange(36) < 20), 0.95, 0.01)  # green that no CMYK prints
    beyond = printed(with_unit(rgb, file, SpotUnit.of(ink(vivid))))
    assert beyond.light_off > 0.02
    assert "no mixture of process inks gives this camera its signal" in beyond.warnings[0]
    white = file.inks().reflectance(np.array([0.1, 0.1, 0.1, 0]))
    (said,) = printed(with_unit(rgb, file, SpotUnit.of(ink(white, on_black=0.8 * white)))).warnings
    assert said.startswith("it is opaque (0.80)")


def test_an_ink_looks_on_another_paper_as_its_opacity_says() -> None:
    own, other, solid = np.full(36, 0.8), np.full(36, 0.6), np.full(36, 0.4)
    measured = {"name": NAME, "tint": np.array([0.0, 1.0]), "measured": np.stack([own, solid])}
    clear = SpotInk(**measured)  # type: ignore[arg-type]
    np.testing.assert_allclose(clear.on_paper(own).measured, clear.measured)
    np.testing.assert_allclose(clear.on_paper(other).measured, [other, solid * 0.75])
    hiding = replace(clear, on_black=solid)
    np.testing.assert_allclose(hiding.on_paper(other).measured, [other, solid])
    assert (clear.opacity, hiding.opacity) == (None, 1.0)
    bare = ink(solid).on_paper(other)
    np.testing.assert_allclose(bare.reflectance(0.5), ((0.6**0.5 + 0.4**0.5) / 2) ** 2)


def test_units_are_stored_with_the_press(rgb: Press, file: PressFile, tmp_path: Path) -> None:
    black = np.full(36, 0.02)
    press = with_unit(rgb, file, SpotUnit.of(ink(np.linspace(0.1, 0.9, 36), on_black=black, condition="M1")))
    digest = press.save(tmp_path / "x.press")
    loaded = Press.load(tmp_path / "x.press")
    assert (loaded.digest, loaded.spot_units) == (digest, press.spot_units)
    assert rgb.digest != digest
    assert press.spot_units is not None
    fewer = replace(press.spot_units, response_dn=press.spot_units.response_dn[:2])
    with pytest.raises(InputError, match=r"spot_units\.response_dn is of 2 sensors of 3"):
        replace(press, spot_units=fewer).save(tmp_path / "y.press")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (with_spots(f'name = "{NAME}"\ncxf = "none.cxf"'), "none.cxf: cannot be read"),
        (with_spots('name = "Green"\ncxf = "orange.cxf"'), "holds no spectrum of the full ink"),
        (with_spots('name = "Black"'), "names must differ from each other and from Cyan"),
        (with_spots('name = "a"', 'name = "a"'), "names must differ from each other"),
        (
            with_spots('name = "a"', more='\n[rip]\nengine = "ghostscript"\n'),
            'goes with rip.engine = "mupdf"',
        ),
        (with_spots('nme = "a"'), "inks.spot"),
    ],
)
def test_units_that_cannot_be_meant_are_refused_in_one_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "orange.cxf").write_text(cxf())
    with pytest.raises(InputError) as refused:
        PressFile(tmp_path / "x.toml", text).spot_units()
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_job_check_says_where_spectra_are_from(
    rgb: Press, file: PressFile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, press = job_of(tmp_path, text=cxf()), tmp_path / "x.press"
    wanted = {
        "from": "the job",
        "condition": "M1, 45:0",
        "tints": 3,
        "opacity": pytest.approx(0.04, abs=0.03),
    }
    for unit in (None, SpotUnit(name=NAME)):
        (rgb if unit is None else with_unit(rgb, file, unit)).save(press)
        _, out, _ = call(capsys, "job", "check", path, "--press", press, "--json")
        (spot,) = json.loads(out.splitlines()[0])["spots"]
        assert spot["spectrum"] == wanted
        assert spot["own_unit"] is (unit is not None)
        assert (spot["delta_e00"] is None) is (unit is not None)
        assert (spot["light_off_percent"] is None) is (unit is None)
    _, out, _ = call(capsys, "job", "check", path, "--press", press)
    assert f"Spectrum of {NAME}: the job, M1, 45:0, 3 tints, opacity" in out
    assert "printed by its own unit, " in out
