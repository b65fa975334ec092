"""Words on sheets and what follows from them, as a user calls it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.journal.journals import facts, record
from safetensors import safe_open

from prooflight.cli import run
from prooflight.cli.show import people
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.verdict import Verdict
from prooflight.errors import PressError
from prooflight.press.artefact import Press
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore, run_key

if TYPE_CHECKING:
    from prooflight_line.journal.journal import Journal as Opened

SAMPLE, RATE = 0.25, 0.1
SHEETS = 240


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(people, "width", 160)


@pytest.fixture
def old(trained_press: Press, tmp_path: Path) -> Path:
    path = tmp_path / "old.press"
    trained_press.save(path)
    return path


def watched(journal: Opened, press: Press, *, sheets: int = SHEETS) -> int:
    """A run of which every fourth sheet alarms, falsely: the press is not the one that was taught."""
    assert "matched_filter" in press.detectors
    edge = model_of(press).threshold
    run_id = journal.begin_run(facts(press_digest=press.digest, settings={"sample": SAMPLE}))
    for sheet in range(sheets):
        alarm = sheet % 4 == 1
        score = edge + (0.01 * (sheet + 1) if alarm else -0.01 * (sheet + 1))
        verdict = Verdict(
            page="p0001",
            verdict="misprint" if alarm else "good",
            kind="density" if alarm else None,
            score=score,
            threshold=edge,
            detector="matched_filter",
        )
        asked = 1.0 if alarm else SAMPLE if sheet % 4 == 0 else None
        journal.record(run_id, replace(record(sheet, kept=False, verdict=verdict), asked=asked))
    journal.commit()
    return run_id


def told(path: Path, run_id: int, sheets: range) -> None:
    with Journal.open(str(path), read_only=True) as journal:
        key = run_key(journal.run(run_id))
    words = LabelStore(path)
    for sheet in sheets:
        if sheet % 4 < 2:
            words.say("good", run=key, sheet=sheet, by="Mei", at_s=2.0)


def said(capsys: pytest.CaptureFixture[str], *words: object) -> Any:
    capsys.readouterr()
    assert run([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_mark_reaches_a_run_that_is_going_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "j.sqlite"
    with Journal.open(str(path)) as journal:  # whoever watches holds it
        run_id = journal.begin_run(facts())
        journal.record(run_id, record(7, kept=False))
        journal.commit()
        told = said(
            capsys, "run", "mark", run_id, 7, "good", "--by", "Mei", "--why", "dust", "--journal", path
        )
        assert (told["run"], told["sheet"], told["word"], told["by"], told["note"]) == (
            1,
            7,
            "good",
            "Mei",
            "dust",
        )
        assert run(["run", "mark", "last", "7", "unknown", "--by", "Jan", "--journal", str(path)]) == 0
        assert "does not affect the threshold" in capsys.readouterr().out
    assert [word.word for word in LabelStore(path).of_run("1@1000")] == ["good", "unknown"]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("run", "mark", "1", "7", "bad", "--by", "Mei"), "there is no label 'bad'"),
        (("run", "mark", "1", "8", "good", "--by", "Mei"), "run 1 has no sheet 8"),
        (("run", "mark", "9", "7", "good", "--by", "Mei"), "there is no run 9"),
        (("run", "mark", "1", "7", "good", "--by", " "), "name"),
    ],
)
def test_a_mark_that_is_none_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], why: str
) -> None:
    path = tmp_path / "j.sqlite"
    with Journal.open(str(path)) as journal:
        run_id = journal.begin_run(facts())
        journal.record(run_id, record(7, kept=False))
    assert run([*words, "--journal", str(path)]) == 2
    told = capsys.readouterr().err.strip()
    assert why in told
    assert "\n" not in told
    assert not LabelStore(path).path.exists()


def test_a_press_is_calibrated_anew_replayed_and_brought_back(
    old: Path, trained_press: Press, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, new, back = tmp_path / "j.sqlite", tmp_path / "new.press", tmp_path / "back.press"
    with Journal.open(str(path)) as journal:
        run_id = watched(journal, trained_press)
    open_questions = said(capsys, "run", "sampled", "--journal", path)
    assert len(open_questions["sheets"]) == SHEETS // 2
    assert open_questions["missed"] is None
    told(path, run_id, range(SHEETS))
    answered = said(capsys, "run", "sampled", "--journal", path)
    assert answered["sheets"] == []
    assert answered["false_alarms"]["value"] == pytest.approx(0.25)
    assert answered["missed"]["value"] == 0
    found = said(capsys, "press", "recalibrate", old, "--journal", path, "-o", new)
    assert found["threshold"] > found["threshold_before"]
    assert found["replaces"] == trained_press.digest
    (replay,) = found["replayed"]
    # 60 told sheets of weight 4 and 60 alarms of weight 1: with the new sheet, (1 + 29) / 301 is at most a tenth.
    assert (replay["alarms"], len(replay["gone"]), replay["come"]) == (60, 31, [])
    assert replay["gone_told"] == {"good": 31}
    loaded = Press.load(new)
    assert "matched_filter" in loaded.detectors
    assert loaded.digest == found["digest"]
    assert model_of(loaded).threshold == found["threshold"]
    assert "labelled by people" in str(model_of(loaded).guarantee)
    pages = model_of(loaded).recalibrations[-1]
    assert set(pages.sheet) == {sheet for sheet in range(SHEETS) if sheet % 4 < 2}
    assert model_of(loaded).decide(found["threshold"] + 0.1).misprint
    assert model_of(loaded).decide(found["threshold"] + 0.1).p_value <= RATE
    assert said(capsys, "press", "go-back", new, "-o", back)["digest"] == trained_press.digest
    assert Press.load(back).digest == trained_press.digest
    again = tmp_path / "again.press"
    twice = said(capsys, "press", "recalibrate", new, "--journal", path, "--promise", 5, "-o", again)
    assert twice["replaces"] == found["digest"]  # runs of the press before count on
    assert said(capsys, "press", "go-back", again, "-o", back)["digest"] == found["digest"]
    assert Press.load(back).digest == found["digest"]
    for command in (("run", "show"), ("run", "sampled"), ("run", "tolerances")):
        assert run([*command, "--journal", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "false alarms: 25.00% of good sheets" in shown
    assert "No false alarm occurs often enough" in shown  # these have no place


def test_what_cannot_be_promised_is_refused(
    old: Path, trained_press: Press, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, new = tmp_path / "j.sqlite", tmp_path / "new.press"
    with Journal.open(str(path)) as journal:
        run_id = watched(journal, trained_press, sheets=40)
        journal.begin_run(facts(press_digest="another"))
    told(path, run_id, range(16))
    wrong = [
        (("recalibrate", old, "--journal", path, "-o", new), "5 more are needed"),
        (("recalibrate", old, "--journal", path, "-o", old), "to be replaced"),
        (("recalibrate", old, "--journal", tmp_path / "none.sqlite", "-o", new), "there is no journal"),
        (("go-back", old, "-o", new), "was never recalibrated"),
    ]
    for words, why in wrong:
        assert run(["press", *map(str, words)]) == 2
        said = capsys.readouterr().err.strip()
        assert why in said, said
        assert "\n" not in said
    assert not new.exists()


def test_an_artefact_that_promises_more_than_its_pages_is_refused(
    old: Path, trained_press: Press, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, new = tmp_path / "j.sqlite", tmp_path / "new.press"
    with Journal.open(str(path)) as journal:
        run_id = watched(journal, trained_press)
    told(path, run_id, range(SHEETS))
    assert run(["press", "recalibrate", str(old), "--journal", str(path), "-o", str(new)]) == 0
    press = Press.load(new)
    assert "matched_filter" in press.detectors
    pages = model_of(press).recalibrations[-1]
    for changes, field in (
        ({"rate": 1e-4}, "labelled0.score"),
        ({"weight": np.zeros_like(pages.weight)}, "labelled0.weight"),
        ({"alarms_from": float("inf")}, "labelled0.alarms_from"),
        ({"passed_weight": 0.5}, "labelled0.passed_weight"),
    ):
        bad = press.with_detector(
            "matched_filter", replace(model_of(press), recalibrations=(replace(pages, **changes),))
        )
        with pytest.raises(PressError, match=field):
            bad.save(tmp_path / "bad.press")
    with safe_open(new, "np") as file:
        assert {name for name in file.keys() if ".labelled0." in name}  # noqa: SIM118
