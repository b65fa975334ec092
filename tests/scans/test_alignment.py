"""Sensors that look a fraction of a line apart: predicted exactly, found from what they saw, judged as ever."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.inspection.test_inspector import printed

from prooflight.commissioning.build import build_press
from prooflight.errors import PressFileError
from prooflight.inspection.inspector import Inspector
from prooflight.pages.sampling import Footprint, transfer
from prooflight.prediction.predict import predict
from prooflight.press.artefact import Press
from prooflight.press.press_file import PressFile
from prooflight.scans.alignment import SensorOffset, built_fraction, disagreement, moved_columns
from prooflight.scans.placement import Placement

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page

    MakePage = Callable[..., Page]

LINES, PIXELS = 3.4, -0.3
CAMERA = f"\n[camera]\noffset_lines = [{LINES}]\noffset_pixels = [{PIXELS}]\n"


@pytest.fixture(scope="module")
def apart(prototype: PressFile) -> Press:
    """The press of ``conftest`` with its sensor's lines apart."""
    return build_press(PressFile(Path("apart.toml"), prototype.text + CAMERA), seed=1, pixels=400)


def test_prediction_looks_a_fraction_further_and_no_scan_is_resampled(
    press: Press, apart: Press, make_page: MakePage
) -> None:
    """As if the page lay so much further.

    What is left is the rounding of places in both, to 1/8192 of a pixel: 0.7 DN of a black edge of 3,000, 0.4 sigma.
    """
    page, geometry = make_page(1), press.geometry
    shift = PIXELS * geometry.pixel_pitch_mm, (LINES - 3) * geometry.line_pitch_mm
    wanted = predict(page, sensors=press.sensors, geometry=geometry, placement=Placement(shift_mm=shift))
    found = predict(page, sensors=apart.sensors, geometry=geometry)
    sigma = np.sqrt(wanted.variance_dn2)
    off = (found.expected_dn - wanted.expected_dn) / sigma
    assert np.abs(off).max() < 0.4
    assert np.sqrt((off**2).mean()) < 0.02
    np.testing.assert_allclose(found.variance_dn2, wanted.variance_dn2, rtol=0.02)


def test_a_press_remembers_the_fraction_that_it_was_built_for(
    press: Press, apart: Press, tmp_path: Path
) -> None:
    apart.save(tmp_path / "apart.press")
    (sensor,) = Press.load(tmp_path / "apart.press").sensors
    assert built_fraction(sensor.footprint, apart.geometry) == pytest.approx((0.4, -0.3), abs=1e-6)
    footprints = [sensor.footprint]
    assert disagreement(footprints, [SensorOffset(lines=7.41, pixels=-0.3)], apart.geometry) is None
    place, built, stated = disagreement(
        footprints, [SensorOffset(lines=3.6, pixels=-0.3)], apart.geometry
    ) or (
        -1,
        0.0,
        0.0,
    )
    assert (place, built, stated) == (0, pytest.approx(0.4), pytest.approx(-0.4))
    assert disagreement([press.sensors[0].footprint], [SensorOffset(lines=5.0)], press.geometry) is None


def test_a_good_print_before_such_a_sensor_passes(apart: Press, make_page: MakePage) -> None:
    for seed in (1, 2):
        page = make_page(seed)
        verdict = Inspector.of(apart, "chi-square").inspect(page, printed(page, apart, seed).dn).verdict
        assert verdict.verdict == "good"
        assert max(abs(shift) for shift in verdict.shift_mm or (9.0,)) < 0.01


@given(across=st.floats(-1, 1), along=st.floats(-1, 1))
def test_a_moved_footprint_holds_all_light_and_blurs_alike(across: float, along: float) -> None:
    places = np.linspace(-1.5, 1.5, 601)
    one = np.clip(places + 0.5, 0, 1)
    still = Footprint(reach_mm=1.5, across=one, along=one)
    moved = still.moved(across_mm=across, along_mm=along)
    assert moved.centre_mm == pytest.approx((across, along), abs=1e-4)
    for cumulative in (moved.across, moved.along):
        assert (cumulative[0], cumulative[-1]) == pytest.approx((0, 1))
        assert (np.diff(cumulative) >= 0).all()
    frequency = np.array([0.0, 0.2, 0.4])
    np.testing.assert_allclose(
        transfer(moved.along, moved.reach_mm, frequency), transfer(still.along, 1.5, frequency), atol=1e-4
    )


def test_columns_that_are_moved_show_what_lay_further_right() -> None:
    lines = np.arange(12, dtype=np.uint16).reshape(2, 6)
    np.testing.assert_array_equal(moved_columns(lines, 2)[0], [2, 3, 4, 5, 5, 5])
    np.testing.assert_array_equal(moved_columns(lines, -1)[0], [0, 0, 1, 2, 3, 4])


def test_offsets_of_other_sensors_than_the_file_has_are_refused(prototype: PressFile) -> None:
    text = prototype.text + "\n[camera]\noffset_lines = [0.0, 1.5]\n"
    with pytest.raises(PressFileError, match=r"are of 2 sensors; give one each of the file's 1 sensors"):
        PressFile(Path("my.toml"), text).sensor_offsets()


def test_several_cameras_stand_one_behind_the_other_in_a_press_file(two_sensor_file: PressFile) -> None:
    text = two_sensor_file.text + '\n[[camera]]\nid = "A"\n[[camera]]\nid = "B"\noffset_lines = [3.4]\n'
    press_file = PressFile(Path("two.toml"), text)
    assert [one.id for one in press_file.cameras()] == ["A", "B"]
    assert [offset.lines for offset in press_file.sensor_offsets()] == [0.0, 3.4]
    with pytest.raises(PressFileError, match=r"camera\.2\.trigger: .*'sideways'"):
        PressFile(Path("two.toml"), text + 'trigger = "sideways"\n')
    one = two_sensor_file.text + '\n[camera]\ntrigger = "sideways"\n'
    with pytest.raises(PressFileError, match=r"^two\.toml: camera\.trigger: "):
        PressFile(Path("two.toml"), one)
