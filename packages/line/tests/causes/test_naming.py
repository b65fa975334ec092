"""Causes by the press's own names, and the trends and nozzles that they rest on."""

from __future__ import annotations

import numpy as np
import pytest
from packages.line.tests.causes.rows import GEOMETRY, region, rolled, row

from prooflight.press.parts import HeadBlock, PartsBlock, RollerBlock
from prooflight_line.causes.naming import NO_ROLLER, named_causes
from prooflight_line.causes.trends import trends_of

HEADS = (
    HeadBlock(name="black bar", ink="K", first_nozzle_mm=-1.0, nozzle_pitch_um=25_400 / 600, nozzles=5000),
    HeadBlock(name="cyan bar", ink="C", first_nozzle_mm=-1.2, nozzle_pitch_um=25_400 / 600, nozzles=5000),
)
PARTS = PartsBlock(
    rollers=(
        RollerBlock(name="fuser", circumference_mm=94.2),
        RollerBlock(name="drum", circumference_mm=942.5),
    ),
    heads=HEADS,
)


def named(records: list, parts: PartsBlock = PARTS) -> list:  # type: ignore[type-arg]
    return named_causes(records, geometry=GEOMETRY, parts=parts)


@pytest.mark.parametrize(("distance", "name", "sheets"), [(94.3, "fuser", 6), (941.0, "drum", 40)])
def test_a_roller_is_named(distance: float, name: str, sheets: int) -> None:
    (cause,) = named(rolled(distance, sheets=sheets))
    assert (cause.kind, cause.names) == ("roller", (name,))
    assert name in cause.text


def test_a_roller_that_is_not_stated_is_not_named() -> None:
    for parts in (PARTS, PartsBlock()):
        (cause,) = named(rolled(83.0, sheets=6), parts)
        assert (cause.kind, cause.names) == ("roller", ())
        assert NO_ROLLER in cause.text


def test_one_place_of_all_sheets_may_be_a_roller_too() -> None:
    parts = PartsBlock(rollers=(RollerBlock(name="cylinder", circumference_mm=155.0),))
    (cause,) = named([row(sheet, region(50, 80)) for sheet in range(9)], parts)
    assert (cause.kind, cause.names) == ("page", ("cylinder",))


def test_the_nozzle_of_a_streak() -> None:
    x = -1.0 + 1999 * 25.4 / 600
    off = (0.03, -0.02, 0.0, -0.03, 0.02)
    rows = [
        row(at, region(x + one, 148, kind="streak", width=0.2, height=297, ink="K"))
        for at, one in enumerate(off)
    ]
    (cause,) = named(rows)
    assert (cause.kind, cause.names, cause.nozzle) == ("streak", ("black bar",), 2000)
    wide = [row(9, region(x + 0.5, 148, kind="streak", width=2.0, height=297, ink="K"))]
    assert named([*rows, *wide])[0].nozzle == 2000
    beside = [row(at, region(x + 4, 148, kind="streak", width=7, height=297, ink="K")) for at in range(9, 19)]
    (cause,) = named([*rows, *beside])
    assert (cause.nozzle, cause.sheets) == (2000, 15)


def test_a_streak_without_an_ink_names_all_heads_there() -> None:
    rows = [row(sheet, region(100, 148, kind="streak", width=0.2, height=297)) for sheet in range(3)]
    assert named(rows)[0].names == ("black bar", "cyan bar")
    assert "states no heads" in named(rows, PartsBlock())[0].text
    assert "no head" in named([row(s, region(-9, 9, kind="streak", width=0.2)) for s in range(3)])[0].text


def test_single_marks_and_paper() -> None:
    rng = np.random.default_rng(4)
    rows = [row(sheet) for sheet in range(40)]
    rows[7] = row(7, region(50, 80))
    assert [(one.kind, one.marks) for one in named(rows)] == [("single", 1)]
    paper = [row(sheet, region(*rng.uniform(10, 200, 2))) for sheet in range(20)]
    assert [one.kind for one in named(paper)] == ["paper"]
    assert named([row(0), row(1)]) == []


def test_misprints_as_a_whole_have_a_cause_without_a_trend() -> None:
    rows = [row(at, region(105, 148, kind="plane-register", width=210, height=297)) for at in range(9, 20)]
    (cause,) = named([row(0), *rows])
    assert (cause.kind, cause.names, cause.sheets, cause.first_sheet) == ("register", (), 11, 9)
    assert named([row(0), *rows[:4]]) == []


def test_places_where_a_register_shows_come_after_it() -> None:
    # A step of 0.3 mm at sheet 20; where it shows best is one place of every sheet from then on. Seed 8.
    noise = 0.03 * np.random.default_rng(8).standard_normal(60)
    rows = [
        row(at, *([region(50, 80)] if at >= 20 else []), nuisance={"register-cyan-x": off})
        for at, off in enumerate((noise + 0.3 * (np.arange(60) >= 20)).tolist())
    ]
    register, page = named(rows)
    assert (register.kind, register.names, register.sheets) == ("register", ("cyan",), 40)
    assert (page.kind, page.sheets) == ("page", 40)
    # Of marks on sheets in register, as of a roller that marked others before, it is no account.
    early = [
        row(at, region(50, 80), nuisance=one.nuisance) if at < 20 else one for at, one in enumerate(rows)
    ]
    assert [one.kind for one in named(early)] == ["page", "register"]


def test_the_plane_that_the_page_is_located_by_is_the_one_that_is_displaced() -> None:
    # Black prints most of the page and steps by 0.3 mm to the right: all others are recorded to its left. Seed 9.
    noise, planes = (
        0.03 * np.random.default_rng(9).standard_normal((60, 4)),
        ("cyan", "magenta", "yellow", "black"),
    )
    noise[20:, :3] -= 0.3
    rows = [
        row(at, nuisance={f"register-{ink}-x": off for ink, off in zip(planes, one, strict=True)})
        for at, one in enumerate(noise.tolist())
    ]
    first = named(rows)[0]
    assert (first.kind, first.ink) == ("register", "black")
    assert first.change == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("shape", ["step", "drift"])
def test_a_trend_comes_out(shape: str) -> None:
    # Seed 5; a change of eight standard deviations of one sheet, within 4 sd of its estimate.
    rng = np.random.default_rng(5)
    change = np.where(np.arange(60) >= 25, 0.12, 0) if shape == "step" else np.linspace(0, 0.12, 60)
    values = 0.015 * rng.standard_normal(60) + change
    (trend,) = trends_of([row(at, nuisance={"gain-cyan": value}) for at, value in enumerate(values.tolist())])
    assert (trend.shape, trend.channel.name) == (shape, "gain-cyan")
    assert trend.change == pytest.approx(0.12, abs=4 * trend.sd)
    assert shape == "drift" or abs(trend.sheet - 25) <= 1
    assert len(trend.beyond) == (np.abs(values[trend.sheet :]) > 0.07).sum()
    assert trend.beyond[0] >= trend.sheet


def test_noise_has_no_trend() -> None:
    # 1 % for each run; of 40 runs, seed 6, more than 4 have a chance of 1e-5.
    rng = np.random.default_rng(6)
    alarms = 0
    for _ in range(40):
        values = 0.03 * rng.standard_normal((60, 2))
        records = [
            row(at, nuisance={"gain-cyan": one[0], "register-black-x": one[1]})
            for at, one in enumerate(values)
        ]
        alarms += bool(trends_of(records))
    assert alarms <= 4
    assert trends_of([row(at, nuisance={"gain-cyan": 0.1 * at}) for at in range(5)]) == []
