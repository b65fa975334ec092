"""How the running study counts."""

from __future__ import annotations

import json
import mmap
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prooflight.pages.raster import Page
from prooflight_studies.harness.page import page_text, plain
from prooflight_studies.running.drift import streaked
from prooflight_studies.running.live import _caught, memory_mb
from prooflight_studies.running.rig import Ring
from prooflight_studies.running.started import Installation, counted, highest_sustained, sustained
from prooflight_studies.running.study import Plan, Study, running_results

PAGES = Path(__file__).parents[1] / "harness" / "pages"
Seen = tuple[int | None, str, tuple[str, ...], bool]


def test_a_streak_of_less_than_a_step_is_dithered() -> None:
    page = Page(cmyk=np.zeros((2000, 120, 4), np.uint8), dpi=100.0, name="p", number=1)
    more = streaked(page, 0.001, np.random.default_rng(2)).astype(float)[..., 3]
    assert more.any(axis=0).sum() == 2
    assert more[:, more.any(axis=0)].mean() / 255 == pytest.approx(0.001, rel=0.2)


def page_of(known: dict[str, Any], *, cores: int) -> str:
    return page_text({"study": "running", **plain(running_results(known, {}, cores=cores, seed=2))})


def test_the_page_is_written_as_far_as_it_is_measured() -> None:
    page = page_of({}, cores=2)
    assert "on 2 cores. " in page
    assert "##" not in page


def test_parts_that_were_measured_with_another_seed_stay() -> None:
    stored = {
        "parts": {"drift": {"seed": 1}, "streak": {"seed": 1}},
        "drift": ["before"],
        "streak": {"runs": 1},
    }
    results = running_results({"streak": {"runs": 2}}, stored, cores=2, seed=5)
    assert results["parts"] == {"drift": {"seed": 1}, "streak": {"seed": 5}}
    assert running_results({"started_pages": []}, stored, cores=2, seed=5)["parts"] == stored["parts"]
    assert (results["started_one"], results["drift"], results["streak"]) == (None, ["before"], {"runs": 2})


def test_a_row_in_real_time_says_own_memory_apart_from_the_ring() -> None:
    row = {
        "name": "repeated designs", "detector": "matched_filter", "promise": "at most one good page in 12",
        "sensors": 1,
        "designs": 10, "prints": 100, "sheets": 2000, "asked_pages_per_s": None, "pages_per_s": 3.25, "late": 0,
        "not_inspected": 0, "misprints": 4, "cpu_s_a_page": 0.6, "drum_cpu_s_a_page": 0.001,
        "verdict_ms": {"median": 300.4, "p99": 400.0, "p99.9": 410.0, "greatest": 412.0},
        "memory_mb": {"100": (3000, 13000), "end": (3010, 13999)}, "late_sheets": [], "fringes": True,
        "good_prints": 9, "good_prints_that_alarm": 0, "wrong_prints": 1, "wrong_prints_caught": 1,
        "wrong_prints_named": 0,
    }  # fmt: skip
    page = page_of({"matched_filter": [row]}, cores=2)
    assert "| - | 3.25 | 0 | 0 | 4 | 300, 400, 410, 412 | 3000, 3010 | 13999 | 0.600 | 0.0010 |" in page
    assert "guarantees at most one good page in 12." in page
    assert "Late sheets of" not in page
    late = row | {"asked_pages_per_s": 5.0, "late": 2, "late_sheets": [[10, 837], [44, 501]]}
    assert "Late sheets of repeated designs, matched_filter: sheet 10 (837 ms), 44 (501 ms)." in page_of(
        {"matched_filter": [late]}, cores=2
    )


def test_misprints_among_the_prints_are_counted_apart_by_sheets_and_by_prints() -> None:
    """Five prints, the last of each five wrong, played twice and a bit: the third alarms once, the wrong one always."""
    scans = [np.zeros((1, 1, 1), np.uint16)] * 5
    prints = Ring(scans=scans, pages=(), sheets=12, repeated=True, wrong=frozenset((4,)))
    assert [sheet for sheet in range(12) if prints.is_wrong(sheet)] == [4, 9]
    assert not any(replace(prints, wrong=frozenset()).is_wrong(sheet) for sheet in range(12))
    said: list[Seen] = [(n, "misprint" if n in (2, 4, 9) else "good", (), True) for n in range(12)]
    assert _caught(said, prints) == {
        "good_prints": 4, "wrong_prints": 1, "false_alarms": 1, "good_sheets": 10, "caught": 2, "wrong_sheets": 2,
        "good_prints_that_alarm": 1, "wrong_prints_caught": 1, "wrong_prints_named": 0,
    }  # fmt: skip


def test_good_prints_of_the_same_design_come_in_place_of_misprints_left_out() -> None:
    """Nine prints of three designs, three of them misprints of different ones; one is kept."""
    scans, pages = [np.full((1, 1, 1), n, np.uint16) for n in range(9)], ("a", "b", "c")
    prints = Ring(scans=scans, pages=pages, sheets=9, repeated=True, wrong=frozenset((2, 4, 6)))  # type: ignore[arg-type]
    fewer = prints.with_fewer_wrong(1)
    assert fewer.wrong == {2}
    shown = [int(scan[0, 0, 0]) for scan in fewer.scans]
    assert [one % 3 for one in shown] == [n % 3 for n in range(9)]
    assert not set(shown) & {4, 6}


@pytest.mark.skipif(memory_mb() == (0, 0), reason="the system does not tell")
def test_memory_of_this_process_is_told_apart_from_files(tmp_path: Path) -> None:
    size = 100_000_000
    (tmp_path / "ring").write_bytes(bytes(size))
    own, files = memory_mb()
    # Not numpy's: the process may have kept as much from before.
    with mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as block:
        block.write(b"1" * size)
        assert memory_mb()[0] - own >= 80
    own = memory_mb()[0]
    ring = np.memmap(tmp_path / "ring", np.uint8, "r")
    assert not ring.any()
    more, mapped = memory_mb()
    assert abs(more - own) < 40
    assert mapped - files >= 80


def test_a_part_that_is_known_is_measured_again_only_where_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[int] = []

    def streak(_study: Study) -> dict[str, Any]:
        measured.append(len(measured))
        of_page = json.loads((PAGES / "running.json").read_text())["streak"]
        return of_page | {"example": f"streak {len(measured)}"}

    monkeypatch.setattr(Study, "_streak", streak)
    (tmp_path / "running").mkdir()
    study = Study(
        out=tmp_path, cache=tmp_path, plan=Plan.of(quick=True), seed=1, one=None, inspectors=1,
        progress=lambda _text: None,
    )  # fmt: skip
    study.run(("streak",))
    assert study.run(("streak",))["streak"]["example"] == "streak 1"
    assert measured == [0]
    study.run(("streak",), again=True)
    assert "streak 2" in (tmp_path / "running.md").read_text()


def sheet(verdict: str, *, late: bool = False, reason: str = "") -> dict[str, Any]:
    """The fields that are counted of the line that `watch --json` prints of a sheet."""
    return {"verdict": verdict, "late": late, "reason": reason, "latency_ms": 100.0 + 50 * late}


def test_sheets_of_which_nothing_was_reported_are_not_inspected() -> None:
    slow = [sheet("not-inspected", reason="too many sheets were waiting for inspection")] * 2
    row = counted([sheet("good"), sheet("misprint", late=True), *slow], sheets=5)
    assert row["reasons"] == {"too many sheets were waiting for inspection": 2, "no verdict": 1}
    assert (row["sheets"], row["late"], row["not_inspected"]) == (5, 1, 3)
    assert not sustained(row)
    assert not sustained(counted([sheet("good", late=True)], sheets=1))
    assert sustained(counted([sheet("good"), sheet("misprint")], sheets=2))


@pytest.mark.parametrize("limit", [0.0, 0.5, 5.5, 7.9, 16.0, 99.0])
def test_bisection_finds_the_highest_sustained_rate(limit: float) -> None:
    tried: list[float] = []

    def sustains(rate: float) -> bool:
        tried.append(rate)
        return rate <= limit

    assert highest_sustained(sustains) == min(limit // 0.5 * 0.5, 16.0)
    assert len(tried) <= 6  # 32 steps are halved five times, and the greatest is one more


def test_a_run_that_cannot_start_ends_the_study_with_its_reason(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"no\.press"):
        Installation(folder=tmp_path).watch(
            tmp_path / "no.pdf", tmp_path / "no.press", pages_per_s=5, sheets=1, seed=1
        )


def test_the_page_states_each_run_that_a_user_starts() -> None:
    row = counted([sheet("good"), sheet("not-inspected", reason="too late")], sheets=2) | {
        "name": "sample job", "sensors": 1, "pages": 30, "prepared": False, "caches": "cold", "ready_s": 12.3,
        "asked_pages_per_s": 5.0, "highest_pages_per_s": 4.5,
    }  # fmt: skip
    assert (
        "| sample job | 30 | 1 | cold | 12 | 5.0 | 2 | 0 | 0, 0 | 1 | too late: 1 | 100, 100 | 4.5 |"
        in page_of({"started_one": [row]}, cores=2)
    )
