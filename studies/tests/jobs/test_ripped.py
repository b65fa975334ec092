"""The study of presses that rip: pages are split by number, rows compare, and counts are those of rows."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from prooflight.errors import RequestError
from prooflight.pages.pdf.rip_model import UNSTATED, RipModel
from prooflight.press.artefact import Press
from prooflight_studies.rip.cases import CASES, case_pdf
from prooflight_studies.ripped.printing import RIPS, as_printed, device_cmyk, fits, rip_of, statements
from prooflight_studies.ripped.study import (
    WORLDS,
    FalseAlarmPlan,
    counts,
    run_false_alarm_study,
    spread,
    whole_rows,
)

needs_ghostscript = pytest.mark.skipif(shutil.which("gs") is None, reason="Ghostscript is not installed")


def rows_of(alarms: list[bool], kinds: list[str], *, rip: str = "am-1200") -> dict[str, np.ndarray]:
    count = len(alarms)
    return {
        "world": np.full(count, "press", "U32"),
        "rip": np.full(count, rip, "U32"),
        "statement": np.full(count, "stated", "U32"),
        "judged": np.ones(count, bool),
        "alarm": np.array(alarms),
        "uninspected": np.zeros(count, bool),
        "kind": np.array(kinds, "U32"),
        "page": np.array([f"d{n:03}" for n in range(count)], "U32"),
    }


def test_counts_are_those_of_rows(trained_press: Press) -> None:
    rows = rows_of([True, False, False, True, True], ["", "", "", "streak", "scum"])
    (row,) = counts(rows, trained_press)
    assert (row.good, row.alarms, row.misprints, row.caught, row.learned) == (3, 1, 2, 2, 0)
    assert row.pages_with_alarms == ("d000",)
    assert row.false_alarms.startswith("1 of 3")


def test_every_page_is_printed_equally_often_by_every_rip() -> None:
    judged, taught_by = [f"d{n:03}" for n in range(1, 80, 2)], [f"d{n:03}" for n in range(0, 90, 2)]
    pieces = FalseAlarmPlan(seed=1, prints=300).pieces(judged, taught_by)
    for rip in RIPS:
        for world in ("press", "measured"):
            here = [piece for piece in pieces if (piece.rip, piece.world) == (rip.name, world)]
            prints = [(piece.page, copy) for piece in here if piece.judged for copy in piece.good]
            assert sorted(prints) == [(page, copy) for page in judged for copy in range(8)]
            misprints = [(piece.page, copy) for piece in here if piece.judged for copy in piece.misprints]
            assert sorted(misprints) == [(page, copy) for page in judged for copy in range(2)]
            taught = {piece.page for piece in here if not piece.judged}
            assert len(taught) == 40
            assert not taught & set(judged)
    assert pieces == sorted(pieces, key=lambda piece: not piece.judged)
    assert pieces[0] in FalseAlarmPlan(seed=1, prints=160).pieces(
        judged, taught_by
    )  # more prints: the same first


def test_a_row_has_as_many_copies_as_every_page_of_it() -> None:
    pieces = FalseAlarmPlan(seed=1, prints=16).pieces(["d001", "d003"], [f"d{n:03}" for n in range(0, 90, 2)])
    missing = [
        next(one for one in pieces if (one.page, one.rip, one.world, one.good[0]) == which)
        for which in (
            ("d003", "own", "press", 4),
            ("d001", "contone-1200", "press", 0),
            ("d003", "contone-1200", "press", 4),
            ("d002", "am-1200", "press", 0),
        )
    ]
    kept = whole_rows(pieces, [piece for piece in pieces if piece not in missing])

    def copies(rip: str) -> set[tuple[str, int]]:
        return {
            (one.page, copy)
            for one in kept
            if (one.rip, one.world) == (rip, "press") and one.judged
            for copy in one.good
        }

    assert copies("own") == {(page, copy) for page in ("d001", "d003") for copy in range(4)}
    assert copies("diffusion-1200") == {(page, copy) for page in ("d001", "d003") for copy in range(8)}
    learned = {(one.rip, one.world) for one in kept if not one.judged}
    every = {(rip.name, world) for rip in RIPS for world in WORLDS}
    # Nothing is judged by continuous tone, and a page that am-1200 was to learn is missing.
    assert every - learned == {("contone-1200", "press"), ("am-1200", "press")}
    assert all((one.rip, one.world) != ("contone-1200", "press") for one in kept)


def test_few_pages_are_spread_over_all() -> None:
    assert spread("abcdefgh", 2) == ["c", "g"]
    assert spread("abc", 9) == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ({"learned": 5}, "cannot learn from 5 pages"),
        ({"rips": ("indigo",)}, "there is no 'indigo'"),
        ({"worlds": ("ideal",)}, "there is no 'ideal'"),
        ({"statements": ("guessed",)}, "there is no 'guessed'"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(plan: dict[str, object], message: str) -> None:
    with pytest.raises(RequestError, match=message):
        FalseAlarmPlan(seed=1, **plan)  # type: ignore[arg-type]


def test_a_press_that_was_not_taught_is_refused(press: Press, tmp_path: Path) -> None:
    press.save(tmp_path / "a.press")
    with pytest.raises(RequestError, match="was not trained for the matched filter"):
        run_false_alarm_study(
            tmp_path / "a.press", tmp_path, tmp_path, cache=tmp_path, plan=FalseAlarmPlan(seed=1)
        )


def test_a_folder_without_pages_is_refused(trained_press: Press, tmp_path: Path) -> None:
    trained_press.save(tmp_path / "a.press")
    with pytest.raises(RequestError, match="0 pages of odd and 0 of even numbers"):
        run_false_alarm_study(
            tmp_path / "a.press", tmp_path, tmp_path, cache=tmp_path, plan=FalseAlarmPlan(seed=1)
        )


@needs_ghostscript
def test_a_page_comes_from_the_press_s_own_rip(press: Press, tmp_path: Path) -> None:
    pdf = tmp_path / "d001.pdf"
    pdf.write_bytes(case_pdf(CASES[0]))
    (tmp_path / "cmyk").mkdir()
    assert fits(pdf, press, tmp_path / "cmyk") == ""
    converted = device_cmyk(pdf, tmp_path / "cmyk")
    drawn = {rip.name: as_printed(converted, press, rip) for rip in RIPS}
    assert drawn["own"].dpi == press.dpi
    assert {page.dpi for name, page in drawn.items() if name != "own"} == {600.0}
    for page in drawn.values():
        assert page.width_mm == pytest.approx(drawn["own"].width_mm, abs=0.1)
    # Away from edges all print the ink of the case; by dots, its light on average.
    middle = {
        name: page.cmyk[page.cmyk.shape[0] // 2, page.cmyk.shape[1] // 2] for name, page in drawn.items()
    }
    for name in ("contone-1200", "contone-600"):
        np.testing.assert_allclose(middle[name].astype(int), CASES[0].inks, atol=2)


def test_what_is_stated_is_resolution_and_screen(press: Press) -> None:
    model = RipModel(fill="any-part")
    assert list(statements(press, rip_of("own"), UNSTATED)) == ["nothing"]
    of_press = statements(press, rip_of("am-1200"), model)
    assert of_press["nothing"] is press
    assert of_press["stated"].rip_engine.name == "ghostscript"
    for name in ("stated", "identified"):
        assert of_press[name].rip_dpi == 1200.0
        assert of_press[name].screen == rip_of("am-1200").screen
    assert of_press["identified"].rip_model == model
    assert of_press["identified"].rip_engine == press.rip_engine
