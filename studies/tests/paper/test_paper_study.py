from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.simulation.misprints.kinds import KINDS
from prooflight_studies.harness.baselines import BASELINES
from prooflight_studies.harness.measures import FIRST_SHARE, UNITS, WINDOWS
from prooflight_studies.harness.operating import least_cost
from prooflight_studies.harness.page import page_text, plain
from prooflight_studies.harness.paper_detectors import (
    AS_PRINTED,
    all_readings,
    bayes_scores,
    chosen_reading,
    chosen_rows,
    scored,
    types_of,
)
from prooflight_studies.harness.protocol import Plan
from prooflight_studies.paper.results import (
    ALPHAS,
    AS_IT_IS,
    PRINTED,
    TUNED,
    Part,
    WorldResult,
    paper_results,
    world_result,
)
from prooflight_studies.paper.study import at_pitch, draw_costs, draw_roc, paper_plans

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight_studies.harness.result_cache import Rows

PLAN = Plan(
    seed=4,
    world="ideal",
    pilot=1,
    learn=60,
    tune=40,
    test=60,
    good_copies=2,
    misprints=2,
    noises=(2.0, 4.0, 1.0),
)


QUIET = "2 sensors, 1 x our camera's noise"
"""Less than the plan's 100 %."""


def drawn_rows(plan: Plan, frames: int = 1) -> Rows:
    """Rows as if scans had been measured: misprints raise numbers, less where there is more noise."""
    rng = np.random.default_rng(9)
    designs = [index for of in ("learn", "tune", "test") for index in plan.designs(of)]
    facts = [
        (index, KINDS[(index * 2 + copy) % 12] if copy >= 2 else "", noise)
        for index in designs
        for copy in range(4)
        for noise in plan.noises
    ]
    design, kind, noise = (np.array(column) for column in zip(*facts, strict=True))
    count, wrong = len(facts), kind != ""
    severity = np.where(wrong, rng.random(count), 0.0)
    # a misprint that one sensor hardly sees the other sees well
    side = rng.random(count)
    by_sensor = severity[:, None] * np.stack([side, 1 - side], axis=1)
    shift = 6 * by_sensor[:, None, :] / noise[:, None, None]
    windows = rng.normal(size=(count, frames, 2, len(WINDOWS), FIRST_SHARE + len(UNITS)))
    windows += shift[..., None, None] * np.where(np.arange(FIRST_SHARE + len(UNITS)) == 1, -1, 1)
    chi = rng.chisquare(15, (count, frames, 2)) + 4 * shift
    baselines = rng.normal(size=(count, frames, len(BASELINES))) + shift.sum(axis=2)[..., None]
    return {
        "design": design,
        "kind": kind.astype("U16"),
        "noise": noise,
        "severity": severity,
        "draws": wrong.astype(np.int64),
        "windows": windows.astype(np.float32),
        "chi_square": chi,
        "chi_square_naive": chi,
        "chi_square_tile": chi,
        "peers": baselines,
        "unmade_kind": np.array(["plane-register"] * 3, "U16"),
    }


@pytest.fixture(scope="module")
def rows() -> Rows:
    return drawn_rows(PLAN)


@pytest.fixture(scope="module")
def result(rows: Rows) -> WorldResult:
    return world_result(rows, PLAN)


def values(result: WorldResult, name: str, which: str, network: str = TUNED) -> np.ndarray:
    (row,) = (row for row in result.tables["raw"] if (row.name, row.network) == (name, network))
    return np.array([interval.value for interval in getattr(row, which)])


def test_learning_tuning_and_testing_see_their_own_designs_alone(rows: Rows) -> None:
    chosen = [chosen_rows(rows, PLAN, of, noise=2.0) for of in ("learn", "tune", "test")]
    seen = [set(one["design"]) for one in chosen]
    assert [len(of) for of in seen] == [60, 40, 60]
    assert len(set().union(*seen)) == 160
    for of, one in zip(("learn", "tune", "test"), chosen, strict=True):
        days = {index: day.designs[0] for day in PLAN.days(of) for index in day.designs}
        assert one["day"].tolist() == [days[index] for index in one["design"].tolist()]


def test_oracle_costs_obey_equation_7_and_honest_ones_are_no_lower(result: WorldResult) -> None:
    alpha = np.array(ALPHAS)
    for row in [*result.tables["raw"], *result.detectors]:
        oracle, honest = (np.array([i.value for i in getattr(row, which)]) for which in ("oracle", "honest"))
        assert (np.diff(oracle) >= 0).all()
        assert (np.diff(np.diff(oracle) / np.diff(alpha)) <= 1e-9).all()
        assert (oracle <= np.minimum(1, alpha) + 1e-12).all()
        assert (honest >= oracle - 1e-12).all()
        # 300 pages are easier to suit than all of them
        assert (np.array(row.papers) <= oracle + 0.05 * np.minimum(1, alpha)).all()


@pytest.mark.parametrize("network", [AS_IT_IS, TUNED])
def test_two_sensors_cost_less_than_one_and_noise_costs(result: WorldResult, network: str) -> None:
    one, quiet, two, noisy = (
        values(result, name, "oracle", network)[3]
        for name in ("1 sensor", QUIET, "2 sensors", "2 sensors, noise 200%")
    )
    assert two < one
    assert quiet < two < noisy


def test_every_row_of_the_papers_tables_is_there_for_both_networks(result: WorldResult) -> None:
    names = {"1 sensor", "2 sensors", "2 sensors, one misprint type", "2 sensors, noise 200%"}
    rows = [(row.name, row.network) for row in result.tables["raw"]]
    assert sorted(rows) == sorted(
        (name, network) for name in {*names, QUIET} for network in (AS_IT_IS, TUNED)
    )
    assert names <= {*PRINTED}
    assert {row.name for row in result.detectors} > {*BASELINES}
    assert result.good == {"learn": 120, "tune": 80, "test": 120}
    assert sum(sum(made) for made in result.made.values()) == result.bad["test"] == 120
    assert result.unmade == {"plane-register": 3}


def test_the_network_as_printed_is_not_tuned(rows: Rows, result: WorldResult) -> None:
    for noise, title in ((2.0, "2 sensors"), (4.0, "2 sensors, noise 200%"), (1.0, QUIET)):
        learn, test = (chosen_rows(rows, PLAN, of, noise=noise) for of in ("learn", "test"))
        (scores,) = bayes_scores(learn, (test,), AS_PRINTED, frame=0)
        want = [least_cost(scored(test, scores), alpha).cost(alpha) for alpha in ALPHAS]
        assert values(result, title, "oracle", AS_IT_IS) == pytest.approx(want)


def part_of(result: WorldResult, press: Press) -> Part:
    return Part(pitch_mm=0.254, press=press, result=result, seconds=60.0, made=100)


def test_where_c_rises_with_noise_is_said(result: WorldResult, two_sensor_press: Press) -> None:
    """By the tables' own figures; noise below 100 % plays no part."""
    (frame,) = plain(paper_results([part_of(result, two_sensor_press)], seed=4, quick=True))["parts"][0][
        "frames"
    ]
    assert len(frame["orders"]) == 4
    for order in frame["orders"]:
        first, last = (
            values(result, name, order["way"], order["network"])
            for name in ("2 sensors", "2 sensors, noise 200%")
        )
        assert order["ends"] == order["every"] == np.array(ALPHAS)[last > first].tolist()
    assert any(order["ends"] for order in frame["orders"])


def test_misses_of_kinds_add_up_to_all_misses(result: WorldResult) -> None:
    for row in result.detectors:
        missed = sum(
            share * count
            for kind, made in result.made.items()
            for share, count in zip(row.misses_by_kind[kind], made, strict=True)
            if count > 0
        )
        assert missed == pytest.approx(row.missed[ALPHAS.index(1.0)])


def test_in_whatever_order_rows_come_the_result_is_the_same(rows: Rows, result: WorldResult) -> None:
    order = np.random.default_rng(1).permutation(len(rows["kind"]))
    mixed = {name: column if name == "unmade_kind" else column[order] for name, column in rows.items()}
    again = world_result(mixed, PLAN)
    for row, other in zip(result.detectors, again.detectors, strict=True):
        assert [i.value for i in other.honest] == [i.value for i in row.honest]
        assert [i.value for i in other.oracle] == pytest.approx([i.value for i in row.oracle])
    assert again.readings == result.readings


def test_the_chosen_reading_is_the_least_costly_on_the_tuning_rows(rows: Rows) -> None:
    learn, tune = (chosen_rows(rows, PLAN, of, noise=2.0) for of in ("learn", "tune"))
    reading, costs = chosen_reading(learn, tune, frame=0)
    assert set(costs) == set(all_readings())
    assert costs[reading] == min(costs.values())
    assert AS_PRINTED in costs
    # and where the test pages fare otherwise plays no part
    assert chosen_reading(learn, tune, frame=0)[0] == reading


def test_permuting_pages_permutes_scores(rows: Rows) -> None:
    learn, test = (chosen_rows(rows, PLAN, of, noise=2.0) for of in ("learn", "test"))
    order = np.random.default_rng(2).permutation(len(test["kind"]))
    mixed = {name: column[order] for name, column in test.items()}
    (scores,) = bayes_scores(learn, (test,), AS_PRINTED, frame=0)
    (permuted,) = bayes_scores(learn, (mixed,), AS_PRINTED, frame=0)
    np.testing.assert_array_equal(permuted, scores[order])


def test_types_are_the_scopes_of_worlds_toml() -> None:
    kinds = np.array(["", "streak", "density", "wrong-page"])
    assert types_of(kinds, types=2) == ["correct", "local", "global", "global"]
    assert types_of(kinds, types=1) == ["correct", "misprint", "misprint", "misprint"]


def test_a_camera_farther_away_sees_the_same_field_with_coarser_pixels(two_sensor_file: PressFile) -> None:
    own = two_sensor_file.camera()
    far = at_pitch(two_sensor_file, 0.254).camera()
    assert far.pixel_pitch_mm == pytest.approx(0.254)
    assert far.line_pitch_mm == pytest.approx(0.254, rel=1e-6)
    field, of_far = (camera.sensors[0].pixels * camera.pixel_pitch_mm for camera in (own, far))
    assert of_far == pytest.approx(field, abs=0.254)
    assert at_pitch(two_sensor_file, own.pixel_pitch_mm) is two_sensor_file


@pytest.mark.parametrize("quick", [False, True])
def test_plans_cover_both_worlds_and_all_noises(quick: bool) -> None:
    plans = paper_plans(seed=1, quick=quick, own_pitch_mm=0.105)
    assert {plan.world for _, plan in plans} == {"ideal", "press"}
    in_fours = [
        plan for _, plan in plans if np.divide(plan.noises[:4], plan.noises[0]).tolist() == [1, 2, 3, 4]
    ]
    assert {plan.world for plan in in_fours} == ({"ideal"} if quick else {"ideal", "press"})
    if not quick:
        assert len(plans) == 6
        assert {(pitch, plan.world) for pitch, plan in plans} >= {(0.105, "ideal"), (0.105, "press")}
        assert plans[0][1].learn == 1000


def test_the_page_shows_the_papers_digits_beside_ours(result: WorldResult, two_sensor_press: Press) -> None:
    in_press = replace(result, plan=replace(PLAN, world="press", noises=(1.0,)))
    parts = [part_of(result, two_sensor_press), part_of(in_press, two_sensor_press)]
    text = page_text({"study": "paper", **plain(paper_results(parts, seed=4, quick=True))})
    for table, printed in PRINTED.values():
        assert f"paper, {table} | {' | '.join(printed)} |" in text
    for name in ("ideal world at 0.254", "press world at 0.254", "--seed 4 --quick", *BASELINES, *KINDS):
        assert name in text
    tables = [block.splitlines() for block in text.split("\n\n") if block.startswith("|") or "\n|" in block]
    for lines in tables:
        widths = {line.count("|") for line in lines if line.startswith("|")}
        assert len(widths) == 1, lines[0]


def test_pictures_are_drawn(tmp_path: Path, result: WorldResult) -> None:
    for draw in (draw_roc, draw_costs):
        path = tmp_path / f"{draw.__name__}.png"
        draw(path, [result, result])
        assert path.read_bytes().startswith(b"\x89PNG")
