"""The console's study: delays, what never came, and a page that says what was measured and no more."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("uvicorn", reason='needs pip install "prooflight-console"')

from prooflight.detectors.disposition import without_gate
from prooflight_studies.console.alongside import BLOCKS, LoadPlan, _figures, paired_difference, slope
from prooflight_studies.console.study import ALARM_EVERY, ConsoleFigures, Delay, Load, _delay, _sheet
from prooflight_studies.harness.page import page_text, plain

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

STATED = {"rate_hz": 5.0, "commit_s": 0.5, "quick": False, "bound_s": 1.0, "alarm_every": ALARM_EVERY}


def figures() -> ConsoleFigures:
    load = Load(seconds=30.0, cpu_percent=3.2, first_mb=90.0, last_mb=91.0, sheets=150, record_ms=0.21)
    live = Delay(who="live pages", sheets=750, missing=0, median_s=0.31, p99_s=0.62, greatest_s=0.71)
    return ConsoleFigures(
        alone=load,
        watched=replace(load, sheets=750, cpu_percent=11.0),
        clients=50,
        connected=50,
        lost=(),
        delays=(live, replace(live, who="browser", missing=1)),
        alarm_s=0.41,
        cores=2,
        load=0.12,
    )


def page_of(found: ConsoleFigures, stated: Mapping[str, Any] = STATED) -> str:
    told = json.loads(json.dumps(plain(asdict(found) | dict(stated))))
    return page_text({"study": "console", **told})


def test_delays_are_from_the_verdict_and_what_never_came_is_told() -> None:
    told = {7: 100.0, 8: 100.2, 9: 100.4}
    seen = [(7, 100.3), (7, 100.5), (8, 100.7), (8, 100.7), (6, 99.0)]
    found = _delay("live pages", told, seen, times=2)
    assert (found.sheets, found.missing) == (3, 2)
    assert found.median_s == pytest.approx(0.5)
    assert found.greatest_s == pytest.approx(0.5)


def test_an_alarm_is_a_misprint_that_advises_to_stop() -> None:
    assert _sheet(4, alarm=False).verdict.verdict == "good"
    alarm = _sheet(4, alarm=True)
    assert (alarm.verdict.verdict, without_gate(alarm.verdict)[0]) == ("misprint", "stop")
    assert alarm.evidence is not None


def test_the_page_says_what_was_measured() -> None:
    text = page_of(figures())
    assert "within 0.31 s of the verdict, 99 % within 0.62 s" in text
    assert "0.41 s after its verdict, within the required second" in text
    assert "| a frame in a real browser | 750 | 1 | 0.310 s |" in text
    assert "and not within the required second" in page_of(replace(figures(), alarm_s=1.2))


def test_the_page_says_what_was_not_measured() -> None:
    load = Load(seconds=30.0, cpu_percent=None, first_mb=None, last_mb=None, sheets=150, record_ms=0.2)
    bare = replace(
        figures(), alone=load, watched=load, delays=figures().delays[:1], alarm_s=None, lost=("reset",)
    )
    text = page_of(bare)
    assert "No browser was installed" in text
    assert "not measured" in text
    assert "1 ended early" in text
    assert "shown on the screen" not in text


def beside(*, paired: bool, path: Path) -> dict[str, Any]:
    """Six windows of 20 s; a verdict a second, 10 ms later where browsers look on, and one of them late."""
    windows = [
        {
            "watched": at % 2 == 1 or not paired,
            "from_s": 20.0 * at,
            "to_s": 20.0 * (at + 1),
            "watch_percent": 80.0,
            "console_percent": 4.0 * (at % 2),
        }
        for at in range(6)
    ]
    seen = [(at + 0.5, 100.0 + 10.0 * (at // 20 % 2) + at // 40, at == 25, "good") for at in range(120)]
    samples = [{"s": 2.0 * at, "watch": 500.0 + at / 900, "console": 90.0} for at in range(60)]
    plan = LoadPlan(
        press=path / "a4.press",
        job=path / "job.pdf",
        rate_hz=1.0,
        minutes=2.0,
        clients=50,
        paired=paired,
        quick=False,
    )
    return _figures(plan, windows, samples, seen)


def test_windows_are_compared_in_pairs_and_what_follows_a_change_is_not_counted(tmp_path: Path) -> None:
    found = beside(paired=True, path=tmp_path)
    alone, watched = found["kinds"]
    assert (alone["sheets"], watched["sheets"]) == (51, 51), "17 of 20: three seconds settle"
    assert (alone["late"], watched["late"]) == (0, 1)
    assert found["difference_ms"] == pytest.approx({"mean": 10.0, "low": 10.0, "high": 10.0, "pairs": 3})
    assert watched["console_percent"] == 4.0


def test_one_pair_says_nothing() -> None:
    rows = [{"watched": False, "median_ms": 100.0}, {"watched": True, "median_ms": 110.0}]
    assert paired_difference(rows) is None
    assert paired_difference([]) is None


def test_a_slope_of_memory_has_an_interval_that_holds_it() -> None:
    hour = [10.0 * at for at in range(360)]
    found = slope(hour, [200.0 + 36.0 * s / 3600 for s in hour])
    assert found is not None
    assert found["mb_per_h"] == pytest.approx(36.0, rel=1e-6)
    assert found["low"] <= 36.0 + 1e-6
    assert found["high"] >= 36.0 - 1e-6
    assert slope(hour[: BLOCKS - 1], hour[: BLOCKS - 1]) is None


def test_the_page_says_what_was_measured_beside_and_of_memory(tmp_path: Path) -> None:
    told = STATED | {
        "beside": beside(paired=True, path=tmp_path) | {"cores": 2, "load": 0.4},
        "hour": beside(paired=False, path=tmp_path) | {"cores": 2, "load": 0.4},
        "pages": {
            "rows": [
                {"path": "/", "paint_ms": 212.0, "bytes": 83_000, "requests": 9, "violations": 0},
                {"path": "/press", "paint_ms": 412.0, "bytes": 303_000, "requests": 9, "violations": None},
            ],
            "loads": 7,
            "most_bytes": 300_000,
            "quick": False,
        },
    }
    text = page_of(figures(), told)
    assert "| 50 live pages, 3 periods | 51 | 1 | 0 | 111 ms |" in text
    assert "was +10.0 ms later with live pages (95 % interval: +10.0 to +10.0" in text
    assert "| the console | 90 MB | 90 MB | 90 MB | +0.0 MB/h" in text
    assert "1 of 2 pages need less than 300 kB" in text
    assert "| `/press` | 412 ms | 303 kB | 9 | not checked |" in text
    assert "job.pdf" in text
    assert "Memory" not in page_of(figures())
