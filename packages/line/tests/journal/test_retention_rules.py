"""Retention by customer and class: which rule wins, what goes, and what still repeats its verdict afterwards."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.journal.journals import facts, files_of, record
from tests.cli.calls import call

from prooflight.errors import RequestError
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore, run_key
from prooflight_line.journal.records import SECONDS_A_DAY, Retention, RunEnd
from prooflight_line.journal.retention_rules import Rules, customers_of

if TYPE_CHECKING:
    from pathlib import Path

TEXT = """
[retention]
verdicts_days = 100
pictures_days = 30
scans_days = 10

[[retention.customers]]
name = "Quay  Coffee"
pictures_days = 400

[[retention.customers]]
name = "Short & Co"
verdicts_days = 5
pictures_days = 5
scans_days = 20

[[retention.customers]]
name = "quay coffee"
scans_days = 15
"""
NOW_S = 1000 * SECONDS_A_DAY
PICTURE = {"cut0": np.ones((1, 20, 20), np.uint16), "cut0_mm": np.zeros(4)}
SCAN = {"whole": np.ones((40, 40), np.uint16), "whole_mm": np.zeros(4)}


@pytest.fixture
def rules(tmp_path: Path) -> Rules:
    (tmp_path / "rules.toml").write_text(TEXT)
    return Rules.read(tmp_path / "rules.toml")


@pytest.mark.parametrize(
    ("settings", "days", "gone"),
    [
        ({}, 10, ()),
        ({}, 11, ("scans",)),
        ({}, 31, ("pictures", "scans")),
        ({}, 101, ("verdicts",)),
        ({"customer": "short & co"}, 19, ()),  # its longer rule wins
        ({"customer": "short & co"}, 31, ("pictures", "scans")),  # its shorter ones do not
        ({"customer": "short & co"}, 101, ("verdicts",)),
        ({"customer": " QUAY coffee "}, 14, ()),
        ({"customer": "Quay Coffee"}, 399, ("scans",)),
        ({"customer": "Quay Coffee"}, 401, ("verdicts",)),  # which stay as long as the pictures
        ({"ticket": {"customer": "Quay Coffee"}}, 101, ("scans",)),
        ({"customer": "Short & Co", "ticket": {"customer": "Quay Coffee"}}, 101, ("scans",)),
        ({"customer": "Short & Co", "ticket": {"customer": "Quay Coffee"}}, 19, ()),
        ({"customer": 3, "ticket": "none"}, 101, ("verdicts",)),
    ],
)
def test_the_longest_rule_wins(
    rules: Rules, settings: dict[str, Any], days: float, gone: tuple[str, ...]
) -> None:
    assert rules.of(customers_of(settings)).over(days) == gone
    assert Retention(rules=rules).over(settings, days) == gone


def test_what_no_rule_states_is_stored_for_ever(tmp_path: Path) -> None:
    (tmp_path / "rules.toml").write_text("[retention]\nscans_days = 1.5\n")
    days = Rules.read(tmp_path / "rules.toml").of([])
    assert (days.scans, days.pictures, days.verdicts) == (1.5, math.inf, math.inf)
    with pytest.raises(ValueError, match="another limit would break them"):
        Retention(rules=Rules.read(tmp_path / "rules.toml"), days=3.0)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "retention: is missing"),
        ("[retention]\ndays = 3", "retention.days: is not known here"),
        ("[retention]\nscans_days = 0", "retention.scans_days: must be greater than 0"),
        ("[retention]\nscans_days = inf", "retention.scans_days"),
        ('[retention]\nscans_days = "3"', "retention.scans_days"),
        ("[[retention.customers]]\nscans_days = 3", "retention.customers.1.name: is missing"),
        ("[retention", "is not TOML"),
    ],
)
def test_a_rule_that_is_none_is_one_line(text: str, what: str, tmp_path: Path) -> None:
    (tmp_path / "rules.toml").write_text(text)
    with pytest.raises(RequestError, match=what.replace("[", r"\[")):
        Rules.read(tmp_path / "rules.toml")


def aged(path: Path, *ages_and_settings: tuple[float, dict[str, Any]]) -> Path:
    """Runs of so many days ago, each with a picture and a scan in one pack, and a last run that always stays."""
    with Journal.open(str(path)) as journal:
        for days, settings in (*ages_and_settings, (0.0, {})):
            ended_s = NOW_S - days * SECONDS_A_DAY
            run = journal.begin_run(facts(started_s=ended_s - 60, settings=settings))
            own = record(1).evidence or {}
            journal.record(run, record(1, evidence={**own, **PICTURE}))
            journal.record(run, record(2, evidence={**own, **SCAN}))
            journal.end_run(run, RunEnd(ended_s=ended_s, ending="finished"))
    return path


def stored(journal: Journal, run: int) -> tuple[set[str], set[str]]:
    first, second = (set(journal.page(run, sheet).evidence or {}) for sheet in (1, 2))
    return first, second


def test_pictures_and_scans_go_alone_and_holds_always_win(rules: Rules, tmp_path: Path) -> None:
    own = {"values", "wrong_page"}
    quay = {"customer": "Quay Coffee"}
    path = aged(tmp_path / "j.sqlite", (200, {}), (50, {}), (50, quay), (20, {}), (200, {}))
    retention = Retention(rules=rules)
    with Journal.open(str(path)) as journal:
        LabelStore(path).hold(run=run_key(journal.run(5)), by="Anna", at_s=1.0, reason="claim 17")
        due = {one.run: (one.classes, one.packs) for one in journal.due(retention, now_s=NOW_S)}
        assert due == {
            1: (("verdicts",), 1),
            2: (("pictures", "scans"), 1),
            3: (("scans",), 1),
            4: (("scans",), 1),
        }
        before = files_of(path)
        done = journal.tidy(retention, now_s=NOW_S)
        assert (done.runs, done.packs, done.thinned, done.on_hold, done.refused) == ([1], 1, 3, [5], [])
        assert len(files_of(path)) == 5
        assert len(set(before) & set(files_of(path))) == 2  # of the run on hold, and of the last
        assert stored(journal, 2) == (own, own)
        assert stored(journal, 3) == stored(journal, 4) == (own | {"cut0", "cut0_mm"}, own)
        assert stored(journal, 5)[1] == own | {"whole", "whole_top", "whole_mm"}
        np.testing.assert_array_equal(
            (journal.page(3, 1).evidence or {})["values"], (record(1).evidence or {})["values"]
        )
        assert journal.due(retention, now_s=NOW_S) == []
        assert journal.tidy(retention, now_s=NOW_S).thinned == 0
    with Journal.open(str(path)) as again:
        assert again.unclaimed.moved == 0


def test_evidence_that_is_damaged_stays_and_is_named(rules: Rules, tmp_path: Path) -> None:
    path = aged(tmp_path / "j.sqlite", (50, {}), (50, {}))
    files_of(path)[0].write_bytes(b"damaged")
    with Journal.open(str(path)) as journal:
        done = journal.tidy(Retention(rules=rules), now_s=NOW_S)
    assert (done.thinned, len(done.refused)) == (1, 1)
    assert "evidence 1 stays: it is damaged" in done.refused[0]


def test_the_command_says_what_would_go_before_it_goes(
    rules: Rules, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = aged(tmp_path / "j.sqlite", (200, {}), (50, {"customer": "Quay Coffee"}))
    monkeypatch.setattr("time.time", lambda: NOW_S)
    options = ("run", "tidy", "--journal", path, "--rules", tmp_path / "rules.toml")
    before = path.read_bytes(), files_of(path)
    code, out, _ = call(capsys, *options, "--dry-run", "--json")
    assert (code, [one["classes"] for one in json.loads(out)]) == (0, [["verdicts"], ["scans"]])
    assert (path.read_bytes(), files_of(path)) == before
    code, out, _ = call(capsys, *options)
    assert code == 0
    assert out.index("To be removed by age") < out.index("1 run and 1 file of evidence")
    assert "Quay Coffee" in out
    assert "1 file thinned" in out
    assert call(capsys, *options, "--days", 3)[0] == 2
    code, _, error = call(capsys, "run", "tidy", "--journal", path, "--megabytes", 3, "--dry-run")
    assert (code, "leave --megabytes out" in error) == (2, True)
