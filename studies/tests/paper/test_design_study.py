"""What a camera's parts buy: designs, prices, and the money that comes of errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from prooflight.cli import run
from prooflight.detectors.cost import RunningCosts
from prooflight.errors import InputError, RequestError
from prooflight_studies.design.choices import Choice, Prices, choices, parse_prices
from prooflight_studies.design.results import cents_per_unit, efficient
from prooflight_studies.design.study import run_design_study
from prooflight_studies.harness.operating import Scored, at_threshold, bill, resampled_costs
from prooflight_studies.harness.protocol import Plan

if TYPE_CHECKING:
    from prooflight.press.press_file import PressFile

PLAN = Plan(
    seed=2, world="ideal", pilot=1, learn=6, tune=3, test=4, good_copies=1, misprints=1, designs_per_day=2
)


# ----- words


def test_all_combinations_the_last_field_running_fastest() -> None:
    found = choices(["sensors=1,2", "lens.f_number=2.8,4"])
    assert [dict(choice.values) for choice in found] == [
        {"sensors": 1, "lens.f_number": 2.8},
        {"sensors": 1, "lens.f_number": 4},
        {"sensors": 2, "lens.f_number": 2.8},
        {"sensors": 2, "lens.f_number": 4},
    ]


def test_one_change_at_a_time_and_values_that_go_together() -> None:
    found = choices(["sensors=1", "light.luminance_cd_m2+sensor.voltage_swing_v=200+4,50+1"], each_alone=True)
    assert [dict(choice.values) for choice in found] == [
        {},
        {"sensors": 1},
        {"light.luminance_cd_m2": 200, "sensor.voltage_swing_v": 4},
        {"light.luminance_cd_m2": 50, "sensor.voltage_swing_v": 1},
    ]
    assert [str(choice) for choice in found[:3]] == [
        "as it is",
        "sensors 1",
        "luminance_cd_m2 200, voltage_swing_v 4",
    ]


@pytest.mark.parametrize(
    "texts",
    [
        ["lens.f_number"],
        ["=2"],
        ["lens.f_number="],
        ["lens.f_number=2,,4"],
        ["a+b=1+2,3"],
        ["a=1", "b+a=1+2"],
    ],
)
def test_texts_that_name_no_designs_are_refused(texts: list[str]) -> None:
    with pytest.raises(RequestError, match="--vary"):
        choices(texts)


def test_a_design_is_the_press_file_with_its_values(two_sensor_file: PressFile, tmp_path: Path) -> None:
    one = Choice(values=(("sensors", 1), ("lens.f_number", 4))).press_file(two_sensor_file).camera()
    assert [sensor.name for sensor in one.sensors] == ["mono"]
    assert one.lens.f_number == 4
    assert Choice().press_file(two_sensor_file) is two_sensor_file
    (tmp_path / "flat.csv").write_text("380 0.5\n730 0.5\n", encoding="utf-8")
    flat = Choice(values=(("sensor.2.quantum_efficiency.file", str(tmp_path / "flat.csv")),))
    first, second = flat.press_file(two_sensor_file).camera().sensors
    np.testing.assert_allclose(second.quantum_efficiency, 0.5)
    np.testing.assert_array_equal(
        first.quantum_efficiency, two_sensor_file.camera().sensors[0].quantum_efficiency
    )


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("lens.f_nmber", 4, "f_number"),
        ("lens.f_number", -4, "f_number"),
        ("sensors", 3, "two-sensors.toml"),
        ("sensors", "two", "sensors"),
        ("sensor.2.quantum_efficiency.file", "none.csv", "none.csv"),
    ],
)
def test_fields_and_values_that_cannot_be_end_in_one_line(
    two_sensor_file: PressFile, field: str, value: float | str, told: str
) -> None:
    with pytest.raises(InputError, match=told) as refused:
        Choice(values=((field, value),)).press_file(two_sensor_file).camera()
    assert "\n" not in str(refused.value)


def test_hardware_is_written_off_over_its_life() -> None:
    of = choices(["sensors=1,2", "light.luminance_cd_m2=100,200"])
    prices = Prices(
        sensor_cents=50_000,
        life_pages=1e6,
        of_values=parse_prices(["light.luminance_cd_m2=200:30000"], of),
    )
    # 10,000 of 1,000,000 pages: a hundredth
    found = [prices.hardware_cents(choice, sensors) for choice, sensors in zip(of, (1, 1, 2, 2), strict=True)]
    assert found == [500, 800, 1000, 1300]


@pytest.mark.parametrize(
    "text", ["sensors=2", "sensors:5", "sensors=2:many", "sensors=2:inf", "sensors=3:5", "lens.f_number=2:5"]
)
def test_prices_of_nothing_are_refused(text: str) -> None:
    with pytest.raises(RequestError, match="--price"):
        parse_prices([text], choices(["sensors=1,2"]))


@pytest.mark.parametrize(
    "wrong", [{"sensor_cents": -1}, {"computing_cents": float("nan")}, {"life_pages": 0}]
)
def test_costs_below_nothing_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(RequestError, match="--"):
        Prices(**wrong)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "--vary"),
        (["--vary", "lens.f_number"], "--vary"),
        (["--vary", "lens.f_number=2.8", "--world", "real"], "world"),
        (["--vary", "lens.f_nmber=2,4"], "f_nmber"),
        (["--vary", "lens.f_number=2.8", "--detector", "eyes"], "--detector"),
        (["--vary", "lens.f_number=2.8", "--price", "sensors=2:5"], "--price"),
        (["--vary", "sensors=2"], "sensors: 2 of 1"),
        (["--vary", "lens.f_number=2.8", "--coarser", "0"], "--coarser"),
    ],
)
def test_the_command_refuses_in_one_line(
    arguments: list[str], told: str, prototype: PressFile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "press.toml"
    path.write_text(prototype.text, encoding="utf-8")
    out = str(tmp_path / "out")
    assert run(["study", "design", str(path), *arguments, "-o", out, "--cache", out]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


# ----- money


def test_cents_are_those_of_the_bill() -> None:
    costs = RunningCosts(missed_misprint_cents=1.0)
    assert cents_per_unit(costs) * 0.3 == pytest.approx(bill(costs, 0.3).with_system)


points = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=8)


@given(points=points)
def test_an_efficient_design_is_beaten_by_none_and_every_other_by_an_efficient_one(
    points: list[tuple[int, int]],
) -> None:
    flags = efficient(points)
    best = [point for point, flag in zip(points, flags, strict=True) if flag]
    for point, flag in zip(points, flags, strict=True):
        beaten = [one for one in best if one != point and one[0] <= point[0] and one[1] <= point[1]]
        assert bool(beaten) != flag


def test_costs_of_designs_drawn_again_scatter_about_the_cost() -> None:
    rng = np.random.default_rng(3)
    design = np.repeat(np.arange(10, 30), 3)
    bad = np.tile([False, True, True], 20)
    pages = Scored(score=rng.normal(size=60) + bad, bad=bad, design=np.arange(60), day=design)
    times = np.random.default_rng(1).multinomial(20, np.full(20, 1 / 20), size=1000)
    drawn = [
        resampled_costs(pages, 2.0, threshold=threshold, place=design - 10, drawn=times)
        for threshold in (0.5, -np.inf, np.inf)
    ]
    np.testing.assert_allclose(drawn[1], 1)  # always alarming
    np.testing.assert_allclose(drawn[2], 2)  # never
    # the spread of a mean of 1000: four standard errors
    error = 4 * drawn[0].std() / np.sqrt(1000)
    assert abs(drawn[0].mean() - at_threshold(pages, 0.5).cost(2.0)) < error + 1e-9


def test_a_study_of_one_design(two_sensor_file: PressFile, tmp_path: Path) -> None:
    prices = Prices(sensor_cents=1e6, computing_cents=3.0)
    rows = run_design_study(
        two_sensor_file,
        choices(["sensors=1"]),
        prices,
        tmp_path,
        cache=tmp_path / "cache",
        coarser=12,
        command="prooflight study design two.toml --vary sensors=1",
        processes=1,
        plans=[PLAN],
    )
    (row,) = rows
    assert (row.design, row.world, row.sensors, row.good) == ("sensors 1", "ideal", 1, 4)
    assert row.saving_cents.value == row.saving_cents.low == row.saving_cents.high == 0
    assert (row.hardware_cents, row.computing_cents) == (100, 3)
    assert row.error_cents.value == pytest.approx(bill(two_sensor_file.costs(), row.cost.value).with_system)
    assert row.pixel_pitch_mm == pytest.approx(two_sensor_file.camera().pixel_pitch_mm)
    assert row.efficient
    text = (tmp_path / "design.md").read_text(encoding="utf-8")
    assert "prooflight study design two.toml --vary sensors=1" in text
    with Image.open(tmp_path / "design.png") as image:
        assert image.format == "PNG"
