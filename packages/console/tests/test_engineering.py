"""The page Engineering: a version is made in a process of its own, replayed, put to use by a second click, and back."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.console.tests.consoles import served
from packages.console.tests.engineering_steps import at_usual_priority, build_with_little_training
from packages.line.tests.cli.test_feedback import SHEETS, told, watched
from packages.line.tests.journal.journals import record
from tests.cli.word_jobs import write_word_job

from prooflight.cli import run
from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.verdict import Verdict
from prooflight.press.artefact import Press
from prooflight.press.press_file import PressFile
from prooflight_console.accounts.roles import Role
from prooflight_console.engineering.effect import JudgedSheet, of_thresholds, of_version, recent_runs
from prooflight_console.engineering.steps import StepProgress
from prooflight_console.engineering.work import Task
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from packages.console.tests.consoles import Served
    from starlette.testclient import TestClient

PATIENCE_S = 600.0
"""Only a test that fails waits so long."""
PAGES = 21
"""More than the 20 good pages that learning needs."""


@pytest.fixture
def console(tmp_path: Path, trained_press: Press) -> Iterator[Served]:
    """A run of which every fourth sheet alarms falsely, and people said so."""
    press, journal = tmp_path / "x.press", tmp_path / "journal.sqlite"
    trained_press.save(press)
    with Journal.open(str(journal)) as opened:
        run_id = watched(opened, trained_press)
    told(journal, run_id, range(SHEETS))
    made = served(tmp_path, run=False, step=at_usual_priority, presses=(press,))
    yield made
    made.console.work.close()
    made.close()


def ended(console: Served) -> Any:
    """Wait for the end of the step."""
    end_s = time.monotonic() + PATIENCE_S
    while (task := console.console.work.task) is None or task.state == "running":
        assert time.monotonic() < end_s, "it never ended"
        time.sleep(0.05)
    return task


def audited(client: TestClient) -> list[str]:
    return [row["what"] for row in client.get("/api/v1/audit").json()["items"]]


def test_a_recalibration_is_replayed_put_to_use_and_taken_back(console: Served, trained_press: Press) -> None:
    engineer, path = console.client(Role.ENGINEER), console.console.settings.presses[0]
    before = path.read_bytes()
    assert "No version has been made yet" in engineer.get("/press/engineering").text
    answer = engineer.post("/press/engineering/work", data={"step": "recalibrate", "guaranteed_pages": "10"})
    assert answer.status_code == 200, answer.text
    task = ended(console)
    assert (task.state, task.why) == ("done", "")
    assert path.read_bytes() == before, "nothing is in use before the second click"
    # As `press recalibrate` says of this run (test_feedback): 31 of 60 alarms would go, all labelled good.
    effect = task.facts["effect"]
    assert (effect["sheets"], effect["alarms_before"], effect["fewer"], effect["fewer_good"]) == (
        240,
        60,
        31,
        31,
    )
    assert (effect["more"], effect["unknown"], effect["misprints"], effect["missed"]) == (0, 0, 0, 0)
    part = engineer.get("/press/engineering/work").text
    assert "31 alarms fewer" in part
    assert "Use this version" in part
    used = {"digest": task.digest, "seen": trained_press.digest}
    answer = engineer.post("/press/engineering/use", data=used)
    assert answer.status_code == 204, answer.text
    assert Press.load(path).digest == task.digest
    assert model_of(Press.load(path)).threshold == task.facts["threshold"]
    # Whoever saw another version in use is refused.
    assert engineer.post("/press/engineering/use", data=used).status_code == 412
    page = engineer.get("/press/engineering").text
    assert "Go back to this version" in page
    back = {"digest": trained_press.digest, "seen": task.digest}
    assert engineer.post("/press/engineering/use", data=back).status_code == 204
    assert Press.load(path).digest == trained_press.digest
    rows = audited(console.client(Role.ADMIN))
    assert rows.count("press.use") == 2
    assert {"press.begin", "press.made"} <= set(rows)


def test_good_pages_are_learned_in_four_clicks_from_the_page_of_the_press(
    console: Served, tmp_path: Path, trained_press: Press
) -> None:
    """Engineering, the confirmation that the pages are good, Learn, and Use this version."""
    job, scans = tmp_path / "job", tmp_path / "scans"
    write_word_job(job, pages=PAGES, rng=np.random.default_rng(11), tinted=False)
    press = console.console.settings.presses[0]
    made = ["simulate", str(job), "--press", str(press), "-o", str(scans), "--seed", "3", "--json"]
    assert run(made) == 0
    other = served(tmp_path, run=False, step=at_usual_priority, presses=(press,), jobs=(job,), scans=(scans,))
    engineer = other.client(Role.ENGINEER)
    assert 'href="/press/engineering"' in engineer.get("/press").text
    assert "scans" in engineer.get("/press/engineering").text
    assert engineer.post("/press/engineering/work", data={"step": "learn"}).status_code == 422
    answer = engineer.post("/press/engineering/work", data={"step": "learn", "good": "true"})
    assert answer.status_code == 200, answer.text
    task = ended(other)
    assert (task.state, task.why) == ("done", "")
    assert task.facts["pages"] == PAGES
    # No sheet of the run has evidence: nothing is known of what this version would have done, and the page says so.
    assert task.facts["effect"]["unknown"] == task.facts["effect"]["sheets"] == SHEETS
    assert f"{SHEETS} sheets have no stored evidence" in engineer.get("/press/engineering/work").text
    used = {"digest": task.digest, "seen": trained_press.digest}
    assert engineer.post("/press/engineering/use", data=used).status_code == 204
    assert model_of(Press.load(press)).real == PAGES
    # Runs of the version before are still replayed with it.
    with Journal.open(str(tmp_path / "journal.sqlite"), read_only=True) as opened:
        replayed = other.console.stations.press(opened.last_run())
    assert replayed is not None
    assert replayed.digest == trained_press.digest
    other.console.work.close()
    other.close()


def test_a_step_can_be_cancelled_and_leaves_nothing(console: Served, tmp_path: Path) -> None:
    press_file = tmp_path / "missing.toml"
    other = served(
        tmp_path,
        run=False,
        step=at_usual_priority,
        presses=console.console.settings.presses,
        press_file=press_file,
    )
    engineer = other.client(Role.ENGINEER)
    assert engineer.post("/press/engineering/work", data={"step": "build"}).status_code == 200
    task = ended(other)
    assert task.state == "failed"
    assert "missing.toml" in task.why
    assert engineer.post("/press/engineering/work", data={"step": "recalibrate"}).status_code == 200
    task = other.console.work.task
    assert task is not None
    assert engineer.post(f"/press/engineering/work/{task.id}/cancel").status_code == 200
    other.console.work.close()
    now = other.console.work.task
    assert now is not None
    assert now.state in ("cancelled", "done")
    other.close()


def test_a_press_is_built_with_the_work_that_training_distributes(
    tmp_path: Path, trained_press: Press
) -> None:
    """The step's process is daemonic, and may start no others."""
    press, press_file = tmp_path / "x.press", tmp_path / "x.toml"
    trained_press.save(press)
    press_file.write_text(PressFile.prototype().text)
    made = served(
        tmp_path, run=False, step=build_with_little_training, presses=(press,), press_file=press_file
    )
    engineer = made.client(Role.ENGINEER)
    assert engineer.post("/press/engineering/work", data={"step": "build"}).status_code == 200
    task = ended(made)
    assert (task.state, task.why) == ("done", "")
    made.console.work.close()
    made.close()


def test_only_an_engineer_changes_the_press(console: Served) -> None:
    for role in (Role.VIEWER, Role.OPERATOR):
        client = console.client(role)
        assert "Make a version" not in client.get("/press/engineering").text
        assert client.post("/press/engineering/work", data={"step": "recalibrate"}).status_code == 403
        given = {"digest": "0" * 64, "seen": "0" * 64}
        assert client.post("/press/engineering/use", data=given).status_code == 403


def test_thresholds_show_what_they_would_have_done(console: Served, trained_press: Press) -> None:
    engineer = console.client(Role.ENGINEER)
    text = engineer.get("/press/engineering/thresholds?at=3").text
    assert "The present labels result in the threshold" in text
    effects = text.count("<tr")
    assert effects == 14
    assert engineer.get("/press/engineering/thresholds?at=7").status_code == 422
    german = engineer.get("/press/engineering/thresholds", headers={"Accept-Language": "de"}).text
    assert "Die bisherigen Bewertungen ergeben die Schwelle" in german


def test_a_higher_threshold_never_alarms_more(console: Served, trained_press: Press) -> None:
    from prooflight_console.engineering.effect import judged_sheets
    from prooflight_line.journal.labels import LabelStore

    journal = console.journal
    with Journal.open(str(journal), read_only=True) as opened:
        runs = recent_runs(opened.runs(), now_s=2.0)
        sheets = list(
            judged_sheets(
                opened,
                LabelStore(journal),
                runs,
                detector="matched_filter",
                same_scale={trained_press.digest},
            )
        )
    effects = of_thresholds(sheets, trained_press, "matched_filter")
    assert [one.present for one in effects].count(True) == 1
    alarms = [one.effect.alarms for one in effects]
    assert alarms == sorted(alarms, reverse=True)
    (present,) = [one.effect for one in effects if one.present]
    assert (present.alarms, present.more, present.fewer) == (60, 0, 0)
    assert present.cost_cents == pytest.approx(60 * trained_press.costs.false_alarm_cents)


def test_costs_change_like_a_threshold_and_labels_keep_counting(
    console: Served, trained_press: Press
) -> None:
    engineer, path = console.client(Role.ENGINEER), console.console.settings.presses[0]

    def step(**given: str) -> Any:
        answer = engineer.post("/press/engineering/work", data=given)
        assert answer.status_code == 200, answer.text
        return ended(console)

    given = {"step": "costs", "false_alarm_cents": "2,0", "missed_misprint_cents": "50"}
    for wrong in ("0", "-1", "nan", "inf", "much"):
        answer = engineer.post("/press/engineering/work", data={**given, "false_alarm_cents": wrong})
        assert answer.status_code == 422, wrong
    task = step(**given)
    assert (task.state, task.why) == ("done", "")
    effect = task.facts["effect"]
    assert (effect["sheets"], effect["alarms_before"], effect["alarms"], effect["unknown"]) == (
        240,
        60,
        60,
        0,
    )
    assert effect["cost_cents"] == effect["cost_cents_before"] == pytest.approx(120)
    assert Press.load(path).digest == trained_press.digest, "nothing is in use before the second click"
    used = {"digest": task.digest, "seen": trained_press.digest}
    assert engineer.post("/press/engineering/use", data=used).status_code == 204
    changed = Press.load(path)
    assert (changed.costs.false_alarm_cents, changed.costs.missed_misprint_cents) == (2.0, 50.0)
    assert changed.costs.misprint_rate == trained_press.costs.misprint_rate
    assert model_of(changed).threshold == model_of(trained_press).threshold
    assert "2 cents for a false alarm, 50 for" in engineer.get("/press/engineering").text
    assert engineer.get("/press/engineering/thresholds").text.count("<tr") == 14
    assert "The present labels result in" in engineer.get("/press/engineering/calibration").text
    assert "they are already in use" in step(**given).why
    # The runs of the press before it have its scores: their labels set its threshold.
    assert step(step="recalibrate", guaranteed_pages="10").facts["effect"]["fewer"] == 31


def test_costs_decide_which_alarms_are_accepted(trained_press: Press) -> None:
    """At 0.01 and 0.1 cents stopping pays from a probability of 1/11; another page stops at any costs."""
    edge = model_of(trained_press).threshold

    def judged(sheet: int, chance: float, *, accepted: bool, state: str = "") -> JudgedSheet:
        verdict = Verdict(
            page="p0001",
            verdict="misprint",
            score=edge + 1,
            threshold=edge,
            probability=chance,
            expected_cost=RunningCosts().expected_cents(chance),
            stopping_costs_more=accepted,
            detector="matched_filter",
        )
        kept = record(sheet, kept=False, verdict=verdict)
        return JudgedSheet(run=1, record=kept, state=state, same_scale=True)

    sheets = [
        judged(0, 0.05, accepted=True, state="misprint"),
        judged(1, 0.5, accepted=False),
        judged(2, 0.05, accepted=False),  # another page
    ]
    for alarm, miss, accepted, missed, cents, cents_before in (
        (0.01, 1.0, 0, 0, 0.02, 1.02),
        (10.0, 0.1, 2, 1, 10.1, 20.1),
    ):
        press = trained_press.with_costs(false_alarm_cents=alarm, missed_misprint_cents=miss)
        effect = of_version(sheets, press, "matched_filter")
        assert (effect.alarms, effect.accepted_before, effect.accepted) == (3, 1, accepted)
        assert effect.missed == missed
        assert effect.cost_cents == pytest.approx(cents)
        assert effect.cost_cents_before == pytest.approx(cents_before)


def test_the_time_left_is_that_of_the_part(tmp_path: Path) -> None:
    """However long the parts before it took."""
    made = served(tmp_path, run=False)
    work, clock = made.console.work, made.clock
    work._task = Task(id="1", step="build", by="Ann", began_s=clock(), progress=StepProgress(what="starting"))
    left = []
    for seconds, what, done in ((500, "pages", 0), (10, "pages", 1), (10, "pages", 2), (5, "days", 1)):
        clock.now_s += seconds
        work._now("1", progress=StepProgress(what=what, done=done, total=10))
        task = work.task
        assert task is not None
        left.append(task.left_s)
    assert left == [None, 9 * 10.0, 4 * 20.0, 9 * 5.0]
    made.close()


def test_a_console_without_a_press_says_so(tmp_path: Path) -> None:
    made = served(tmp_path)
    assert "--press X.press" in made.client(Role.ENGINEER).get("/press/engineering").text
    made.close()


# --- history ---


def test_the_history_shows_every_run_and_the_notes_of_people(tmp_path: Path) -> None:
    from packages.console.tests.consoles import write_run

    made = served(tmp_path, run=False)
    for started_s in (1_000.0, 90_000.0, 180_000.0):
        write_run(made.journal, started_s=started_s)
    operator, viewer = made.client(Role.OPERATOR), made.client(Role.VIEWER)
    given = {"text": "<b>new lamp</b>", "day": "1970-01-02"}
    assert viewer.post("/press/history/notes", data=given).status_code == 403
    assert operator.post("/press/history/notes", data=given).status_code == 204
    assert operator.post("/press/history/notes", data={**given, "day": "soon"}).status_code == 422
    assert operator.post("/press/history/notes", data={**given, "text": " "}).status_code in (409, 422)
    page = operator.get("/press/history").text
    assert "&lt;b&gt;new lamp&lt;/b&gt;" in page
    charts = viewer.get("/press/history/charts").text
    assert charts.count("<circle") >= 3
    assert charts.count('class="noted"') == charts.count("<svg")
    assert all(f'href="/press?run={run}"' in charts for run in (1, 2, 3))
    assert operator.post("/press/history/notes/1/remove").status_code == 204
    assert "new lamp" not in operator.get("/press/history").text
    recorded = [row["what"] for row in made.client(Role.ADMIN).get("/api/v1/audit").json()["items"]]
    assert {"history.note", "history.remove"} <= set(recorded)
    made.close()
