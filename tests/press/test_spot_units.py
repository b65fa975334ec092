"""Units that print spot inks: what spectrum predicts which light, and which of several spectra counts."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from tests.pages.conftest import one_page, stream
from tests.pages.test_cxf import cxf, spectrum

from prooflight.commissioning.build import build_press, spot_units
from prooflight.errors import ChartError, PressError, PressFileError
from prooflight.pages.spots.job_spectra import JobSpectra
from prooflight.pages.spots.spot_ink import SpotInk
from prooflight.prediction.predict import expected_light
from prooflight.press.artefact import Press
from prooflight.press.pages import open_job, predict
from prooflight.press.press_file import PressFile
from prooflight.press.spot_units import SpotUnit

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

NAME = "Orange 021"
SOLID = "/Spot cs 1 scn 0 0 100 100 re f"
SEPARATION = "/ColorSpace<</Spot[/Separation/Orange#20021/DeviceCMYK<</FunctionType 2/Domain[0 1]/N 1/C0[0 0 0 0]/C1[1 0 0 0]>>]>>"
TWO = "/ColorSpace<</Spot[/DeviceN[/Orange#20021/Black]/DeviceCMYK 5 0 R]>>"


@pytest.fixture(scope="module")
def rgb() -> Press:
    """A press with a camera of three sensors, and no unit."""
    return build_press(PressFile.preset("rgb-line.toml"), seed=1, pixels=400)


def with_unit(press: Press, unit: SpotUnit) -> Press:
    file = PressFile.preset("rgb-line.toml")
    return replace(press, spot_units=spot_units(file.camera(), file.inks(), [unit]))


def of_recipe(*recipe: float) -> NDArray[np.float64]:
    return PressFile.preset("rgb-line.toml").inks().reflectance(np.array(recipe))


def ink(solid: NDArray[np.float64], **more: object) -> SpotInk:
    return SpotInk(name=NAME, tint=np.array([1.0]), measured=solid[None], **more)  # type: ignore[arg-type]


def printed(press: Press, name: str = NAME, *, job: JobSpectra | None = None) -> object:
    assert press.spot_units is not None
    (one,) = press.spot_units.prints(press.sensors, job or JobSpectra())
    assert one.name == name
    return one


def test_the_light_of_a_spectrum_is_predicted(rgb: Press, tmp_path: Path) -> None:
    """The solid of a job is seen as response times spectrum, though the file's alternate is cyan."""
    solid = of_recipe(0, 0.55, 0.9, 0.05)
    press = with_unit(rgb, SpotUnit.of(ink(solid)))
    path = tmp_path / "job.pdf"
    path.write_bytes(one_page(SOLID, resources=SEPARATION))
    with open_job(path, press) as job:
        assert job.warnings == ()
        page = job.page(1)
    middle = predict(page, press).expected_dn[:, 40, 180:200].mean(axis=1)
    assert press.spot_units is not None
    exact = np.array(press.spot_units.response_dn) @ solid
    bare = np.array([expected_light(np.zeros((1, 4), np.uint8), one)[0][0] for one in press.sensors])
    gain = np.array([one.column_gain[180:200].mean() for one in press.sensors])
    offset = np.array([one.column_offset_dn[180:200].mean() for one in press.sensors])
    # A byte of ink is at most 0.4 % of white, half of it rounding.
    np.testing.assert_allclose((middle - offset) / gain / bare, exact / bare, atol=3e-3)
