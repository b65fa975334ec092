"""The journal keeps what it is given, says what it cannot, and forgets in the order it was told to."""

from __future__ import annotations

import csv
import errno
import json
import math
import sqlite3
from dataclasses import MISSING, fields, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from packages.line.tests.journal.journals import facts, files_of, limit, record

from prooflight.detectors.verdict import Code, Ink, Region, Verdict
from prooflight.errors import RequestError
from prooflight.files import lock
from prooflight.files.content import content_digest
from prooflight_line.journal import packs
from prooflight_line.journal.aside import unclaimed_folder
from prooflight_line.journal.exporting import run_facts, write_csv
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore, labels_path, run_key
from prooflight_line.journal.opening import default_journal
from prooflight_line.journal.queue import JournalQueue
from prooflight_line.journal.records import PageRecord, Retention, RunEnd
from prooflight_line.journal.schema import JournalError

DAY_S = 86_400.0

FULL = Verdict(
    page="p0007",
    verdict="misprint",
    probability=1 / 3,
    score=math.pi,
    threshold=0.1 + 0.2,
    p_value=5e-324,
    kind="streak",
    regions=(
        Region(x_mm=83.1, y_mm=0.1, width_mm=0.5, height_mm=297.0, score=np.float64(9.7), kind="streak"),
        Region(x_mm=1.0, y_mm=2.0, width_mm=3.0, height_mm=4.0, score=6.0, kind="unknown"),
    ),
    shift_mm=(0.1, -0.2),
    milliseconds=12.5,
    detector="matched_filter",
    family="streak/light",
    reason="streak at x = 83 mm – “né”",
    inks={"C": Ink(gain_percent=-3.25, dot_gain_percent=1.5, register_mm=(0.03, -0.01))},
    expected_cost={"accept": 0.03, "stop": 0.006},
    stopping_costs_more=True,
    widened=1.28,
    codes=(
        Code(
            symbology="QR Code",
            text="né",
            read=None,
            checked=True,
            grade=0.0,
            weakest="does not read",
            x_mm=20.0,
            y_mm=244.0,
            width_mm=27.5,
            height_mm=27.5,
        ),
    ),
    promise_suspended=True,
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.sqlite"


# --- what goes in comes out ---


def test_a_page_comes_back_with_everything(path: Path) -> None:
    for field in fields(Verdict):  # who adds a field to a verdict adds it here
        if field.default is not MISSING:
            assert getattr(FULL, field.name) != field.default, field.name
    kept = {
        "values": np.random.default_rng(1).standard_normal(400).astype(np.float32),
        "wrong_page": np.array(True),
        "cut0": np.arange(24, dtype=np.uint16).reshape(1, 4, 6),
    }
    given_ = record(
        7,
        verdict=FULL,
        job_page=None,
        late=True,
        faults=("slip", "lost-lines"),
        notes=("black rises by 0.05 % a page",),
        nuisance={"gain-C": np.float32(0.25)},
        evidence=kept,
    )
    with Journal.open(f"sqlite:///{path}") as journal:
        run = journal.begin_run(facts())
        journal.record(run, given_)
        assert journal.commit()
    with Journal.open(str(path), read_only=True) as journal:
        found = journal.page(run, 7)
        (row,) = journal.pages(run)
    assert found.verdict == FULL
    for field in fields(PageRecord):
        if field.name != "evidence":
            assert getattr(found, field.name) == getattr(given_, field.name)
            assert getattr(row, field.name) == getattr(given_, field.name)
    assert found.evidence is not None
    assert found.evidence.keys() == kept.keys()
    for name, array in kept.items():
        assert found.evidence[name].dtype == array.dtype
        np.testing.assert_array_equal(found.evidence[name], array)


def test_rows_from_before_promises_could_be_suspended_are_read(path: Path) -> None:
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        journal.record(run, record(1, kept=False))
        assert journal.commit()
    with sqlite3.connect(path) as database:
        (text,) = database.execute("SELECT whole_verdict FROM pages").fetchone()
        before = json.loads(text)
        assert before.pop("promise_suspended") is False
        database.execute("UPDATE pages SET whole_verdict = ?", [json.dumps(before)])
    with Journal.open(str(path), read_only=True) as journal:
        assert journal.page(run, 1).verdict.promise_suspended is False
        assert journal.run(run).promise_suspended_from is None


@pytest.mark.parametrize("score", [0.5, math.inf])
def test_a_run_says_from_which_sheet_its_promise_was_suspended(path: Path, score: float) -> None:
    """Each run by itself; a note of another thing says nothing, nor does a reason that only looks like it."""
    looks_like = 'a page named "promise_suspended": true'
    with Journal.open(str(path)) as journal:
        for since in (3, 99):
            run = journal.begin_run(facts())
            for sheet in range(6):
                one = record(sheet, score=0.5, kept=False, notes=("said",) if sheet in (1, since) else ())
                verdict = replace(one.verdict, reason=looks_like)
                if sheet >= since:
                    verdict = replace(verdict, verdict="misprint", score=score, promise_suspended=True)
                journal.record(run, replace(one, verdict=verdict))
        assert journal.commit()
        assert [one.promise_suspended_from for one in journal.runs()] == [3, None]
        assert journal.run(1).promise_suspended_from == 3
        assert run_facts(journal.run(1))["promise_suspended_from"] == 3
        assert [one.verdict.promise_suspended for one in journal.pages(1)] == [False] * 3 + [True] * 3
        text = StringIO()
        write_csv(journal.pages(1), text)
    assert [row["promise_suspended"] for row in csv.DictReader(StringIO(text.getvalue()))] == (
        ["False"] * 3 + ["True"] * 3
    )


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_that_json_does_not_know_survive(path: Path, value: float) -> None:
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        alarm = Verdict(page="p0001", verdict="misprint", score=value, threshold=1.0)
        journal.record(run, record(1, verdict=alarm))
        assert journal.commit()
        score = journal.page(run, 1).verdict.score
    np.testing.assert_equal(score, value)


Act = st.one_of(
    st.tuples(st.integers(0, 5), st.floats(allow_nan=False), st.booleans()),
    st.just("commit"),
    st.just("restart"),
)


@settings(max_examples=12)
@given(acts=st.lists(Act, max_size=14))
def test_the_last_word_on_a_sheet_stands_whatever_comes_between(
    tmp_path_factory: pytest.TempPathFactory, acts: list[Any]
) -> None:
    path = tmp_path_factory.mktemp("journal") / "j.sqlite"
    said: dict[int, tuple[float, bool]] = {}
    journal = Journal.open(str(path))
    run = journal.begin_run(facts())
    for act in acts:
        if act == "commit":
            assert journal.commit()
        elif act == "restart":
            journal.close()
            journal = Journal.open(str(path))
            assert journal.last_run().id == run
        else:
            sheet, score, evidence = act
            journal.record(run, record(sheet, score=score, kept=evidence))
            said[sheet] = score, evidence
    journal.close()
    with Journal.open(str(path)) as journal:  # opening cleans up behind what was replaced
        pages = [journal.page(run, page.sheet) for page in journal.pages(run)]
    assert {page.sheet: (page.verdict.score, page.evidence is not None) for page in pages} == said
    named = {sheet for sheet, (_, evidence) in said.items() if evidence}
    assert bool(files_of(path)) == bool(named)


# --- runs ---


def test_runs_say_how_they_are_and_what_came_of_them(path: Path) -> None:
    bad = replace(FULL, page="p0002")
    with Journal.open(str(path)) as journal:
        first = journal.begin_run(facts())
        journal.record(first, record(1))
        journal.record(first, record(2, verdict=bad, late=True))
        journal.record(first, record(3, verdict=Verdict(page="p3", verdict="not-inspected")))
        journal.record(first, record(4, faults=("slip",)))
        end = RunEnd(ended_s=2000.0, ending="stopped", detail="by hand", counts={"late": 1})
        journal.end_run(first, end)
        second = journal.begin_run(facts(job="other.pdf", sheets=None))
        assert journal.run(second).state == "running"
        with Journal.open(str(path), read_only=True) as reader:
            assert reader.run(second).state == "running"
    with Journal.open(str(path), read_only=True) as reader:
        runs = reader.runs()
        assert [run.state for run in runs] == ["stopped", "interrupted"]
        assert runs[0].end == end
        assert runs[0].facts == facts()
        assert runs[1].facts.sheets is None
        counts = (runs[0].pages, runs[0].misprints, runs[0].not_inspected, runs[0].late, runs[0].faulty)
        assert counts == (4, 1, 1, 1, 1)
        assert runs == [reader.run(first), reader.last_run()]
        assert [page.sheet for page in reader.pages(first, passed=False)] == [2, 3, 4]


def test_who_reads_a_long_run_does_not_stop_who_writes(path: Path) -> None:
    with Journal.open(str(path)) as journal, Journal.open(str(path), read_only=True) as reader:
        run = journal.begin_run(facts())
        for sheet in range(1200):
            journal.record(run, record(sheet, kept=False))
        journal.commit()
        for opened in (journal, reader):
            reading = opened.pages(run)
            next(reading)
            journal.record(run, record(5000, kept=False))
            assert journal.commit()
            assert sum(1 for _ in reading) >= 1199


# --- what is no journal ---


def test_a_journal_of_another_schema_is_one_clear_error(path: Path) -> None:
    Journal.open(str(path)).close()
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE journal SET schema = 7")
    connection.close()
    for read_only in (False, True):
        with pytest.raises(
            JournalError, match=r"journal\.sqlite: has schema 7, this version reads schema 3; "
        ) as refusal:
            Journal.open(str(path), read_only=read_only)
        assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "content", [b"not a database, but a longish text of a hundred bytes or so" * 3, None]
)
def test_what_is_no_journal_is_refused_and_left_alone(path: Path, content: bytes | None) -> None:
    if content is None:
        with sqlite3.connect(path) as connection:
            connection.execute("CREATE TABLE songs (name)")
        connection.close()
    else:
        path.write_bytes(content)
    before = path.read_bytes()
    for read_only in (False, True):
        with pytest.raises(JournalError, match="journal"):
            Journal.open(str(path), read_only=read_only)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    "url", ["postgresql://host/runs", "sqlite://", "sqlite:///:memory:", "sqlite:///x.sqlite?mode=ro", "://"]
)
def test_urls_without_a_file_are_refused(url: str) -> None:
    with pytest.raises(JournalError, match="sqlite:///FILE"):
        Journal.open(url)


def test_there_is_nothing_to_read_where_nobody_wrote(path: Path) -> None:
    with pytest.raises(JournalError, match="there is no journal"):
        Journal.open(str(path), read_only=True)
    assert not list(path.parent.iterdir())
    with Journal.open(str(path)) as journal:
        with pytest.raises(JournalError, match="no run 1; it contains no runs yet"):
            journal.last_run()
        run = journal.begin_run(facts())
        with pytest.raises(JournalError, match="no run 9; the last is run 1"):
            journal.run(9)
        with pytest.raises(JournalError, match="run 1 has no sheet 5"):
            journal.page(run, 5)


def test_one_writes_at_a_time(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock, "PATIENCE_S", 0.0)
    with Journal.open(str(path)), pytest.raises(JournalError, match="written by another"):
        Journal.open(str(path))
    Journal.open(str(path)).close()


def test_the_default_lies_in_the_users_data(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert default_journal() == tmp_path / "prooflight" / "journal.sqlite"


# --- evidence ---


def test_what_a_writer_left_that_died_before_its_rows_is_put_aside(path: Path) -> None:
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        journal.record(run, record(1))
        journal.commit()
        (kept,) = files_of(path)
        packs.write_pack(kept.with_name("orphan.npz"), {2: {"values": np.zeros(3)}})
        kept.with_name(".half.npz.part").write_bytes(b"x")
    with Journal.open(str(path), read_only=True):
        assert len(files_of(path)) == 3  # who only reads moves nothing
    said: list[str] = []
    with Journal.open(str(path), announce=said.append) as journal:
        assert files_of(path) == [kept]
        aside = unclaimed_folder(path)
        assert {file.name for file in aside.rglob("*") if file.is_file()} == {"orphan.npz", ".half.npz.part"}
        assert len(said) == 1
        assert f"2 files (0.0 MB) that no page of the journal names were moved to {aside}" in said[0]
        assert journal.page(run, 1).evidence is not None


def test_evidence_that_is_gone_or_damaged(path: Path) -> None:
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        journal.record(run, record(1))
        journal.commit()
        (file,) = files_of(path)
        file.write_bytes(file.read_bytes()[:-30])
        with pytest.raises(JournalError, match="is damaged"):
            journal.page(run, 1)
        file.unlink()
        assert journal.page(run, 1).evidence is None


# --- a disk that is full ---


def test_a_full_disk_is_announced_once_and_nothing_is_lost_when_space_is_back(path: Path) -> None:
    said: list[str] = []
    with Journal.open(str(path), announce=said.append) as journal:
        run = journal.begin_run(facts())
        limit(journal, 4)
        acknowledged = 0
        for sheet in range(150):
            journal.record(run, record(sheet, verdict=replace(FULL, reason="x" * 200)))
            if sheet % 10 == 9 and journal.commit():
                acknowledged = sheet + 1
        assert 0 <= acknowledged < 150
        assert len(said) == 1
        assert "full" in said[0]
        assert journal.health.trouble is not None
        assert journal.health.waiting == 150 - acknowledged
        assert sum(1 for _ in journal.pages(run)) == acknowledged
        other = journal.begin_run(facts())  # even a new run goes on
        assert other == run + 1
        limit(journal, 0)
        assert journal.commit()
        assert len(said) == 2
        assert "writes again; 0 pages" in said[1]
        assert (journal.health.trouble, journal.health.waiting) == (None, 0)
        assert [page.sheet for page in journal.pages(run)] == list(range(150))
        assert journal.page(run, 149).evidence is not None
        assert journal.run(other).pages == 0
    with Journal.open(str(path)):
        assert len(files_of(path)) == len({file.name for file in files_of(path)}) > 0


def test_what_a_bounded_queue_gives_up_is_counted_and_told(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    said: list[str] = []
    size = sum(array.nbytes for array in (record(1).evidence or {}).values())
    with Journal.open(str(path), announce=said.append) as journal:
        journal._queue = JournalQueue(most_pages=50, most_evidence_bytes=10 * size)
        run = journal.begin_run(facts())
        with monkeypatch.context() as patched:
            patched.setattr(packs, "write_pack", full)
            for sheet in range(80):
                journal.record(run, record(sheet))
                assert not journal.commit()
        assert len(said) == 1
        assert "no space left on device" in said[0]
        health = journal.health
        assert (health.waiting, health.dropped_pages, health.dropped_evidence) == (50, 30, 70)
        assert journal.commit()
        assert "30 pages and the evidence of 70" in said[1]
        row = journal.run(run)
        assert (row.pages, row.dropped_pages, row.dropped_evidence) == (50, 30, 70)
        assert [page.sheet for page in journal.pages(run)] == list(range(30, 80))
        assert [journal.page(run, sheet).evidence is not None for sheet in (69, 70, 79)] == [
            False,
            True,
            True,
        ]


@settings(max_examples=60)
@given(
    acts=st.lists(st.sampled_from(["plain", "evidence", "fail"]), max_size=40),
    most_pages=st.integers(1, 6),
    most_evidence=st.integers(0, 4),
)
def test_the_queue_never_holds_more_than_it_may_and_counts_the_rest(
    acts: list[str], most_pages: int, most_evidence: int
) -> None:
    size = sum(array.nbytes for array in (record(0).evidence or {}).values())
    queue = JournalQueue(most_pages=most_pages, most_evidence_bytes=most_evidence * size)
    for sheet, act in enumerate(acts):
        if act == "fail":
            queue.put_back(queue.take())
        else:
            queue.add(1, record(sheet, kept=act == "evidence"))
    pages = [page for _, page in queue.take().pages]
    assert queue.waiting == len(pages)  # taken is not written
    queue.written()
    assert queue.waiting == 0
    added = [sheet for sheet, act in enumerate(acts) if act != "fail"]
    assert [page.sheet for page in pages] == added[-most_pages:]
    assert queue.dropped_pages == max(len(added) - most_pages, 0)
    assert sum(page.evidence is not None for page in pages) <= most_evidence


def test_much_is_written_in_pieces_and_a_run_ends_with_its_last() -> None:
    queue = JournalQueue()
    queue.begin(1, facts())
    for sheet in range(600):
        queue.add(1, record(sheet, kept=False))
    queue.end(1, RunEnd(ended_s=0.0, ending="finished"))
    pieces = []
    while not (batch := queue.take()).empty:
        if len(pieces) == 1 and batch.pages[0][1].sheet == 256:
            queue.put_back(batch)
            batch = queue.take()
        pieces.append(batch)
        queue.written()
    assert [page.sheet for piece in pieces for _, page in piece.pages] == list(range(600))
    assert [bool(piece.begun) for piece in pieces] == [True, False, False]
    assert [bool(piece.ended) for piece in pieces] == [False, False, True]


# --- forgetting ---


@pytest.fixture
def three_runs(path: Path) -> Journal:
    """Runs that ended 30, 20 and 10 days after time 0, five packs of evidence each."""
    journal = Journal.open(str(path))
    for days in (30, 20, 10):
        run = journal.begin_run(facts(started_s=0.0))
        for sheet in range(5):
            kept = {"noise": np.random.default_rng([run, sheet]).bytes(50_000)}
            arrays = {name: np.frombuffer(value, np.uint8) for name, value in kept.items()}
            journal.record(run, record(sheet, evidence=arrays))
            journal.commit()
        journal.end_run(run, RunEnd(ended_s=(40 - days) * DAY_S, ending="finished"))
    return journal


def test_runs_that_ended_too_long_ago_go_with_all_that_is_theirs(path: Path, three_runs: Journal) -> None:
    with three_runs as journal:
        journal.tidy(Retention(days=25.0), now_s=40 * DAY_S)
        assert [run.id for run in journal.runs()] == [2, 3]
        assert len(files_of(path)) == 10
        journal.tidy(Retention(days=1.0), now_s=1000 * DAY_S)
        assert [run.id for run in journal.runs()] == [3]  # the last keeps its number from being given again
    with Journal.open(str(path)) as journal:
        assert journal.begin_run(facts()) == 4


def test_the_oldest_evidence_goes_first_and_then_the_oldest_runs(path: Path, three_runs: Journal) -> None:
    def evidence(journal: Journal, run: int) -> list[bool]:
        return [journal.page(run, sheet).evidence is not None for sheet in range(5)]

    with three_runs as journal:
        whole = journal.megabytes
        journal.tidy(Retention(megabytes=whole - 0.33), now_s=0.0)
        assert journal.megabytes <= whole - 0.33
        assert [evidence(journal, run) for run in (1, 2)] == [[False] * 5, [False, False, True, True, True]]
        assert evidence(journal, 3) == [True] * 5
        assert len(files_of(path)) == 8
        assert [run.pages for run in journal.runs()] == [5, 5, 5]
        journal.tidy(Retention(megabytes=0.001), now_s=0.0)  # less than an empty journal takes
        assert [run.id for run in journal.runs()] == [3]
        assert evidence(journal, 3) == [False] * 5
        assert not files_of(path)


def test_a_database_shrinks_when_runs_go(path: Path) -> None:
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        for sheet in range(2000):
            journal.record(run, record(sheet, kept=False))
        journal.end_run(run, RunEnd(ended_s=1.0, ending="finished"))
        journal.begin_run(facts())
    full = path.stat().st_size
    with Journal.open(str(path)) as journal:
        journal.tidy(Retention(days=1.0), now_s=10 * DAY_S)
    assert path.stat().st_size < full / 5


@pytest.mark.parametrize("bad", [{"days": 0.0}, {"megabytes": -1.0}, {"days": math.nan}])
def test_a_journal_that_keeps_nothing_is_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must be above 0"):
        Retention(**bad)


def test_a_digest_follows_content_and_names(tmp_path: Path) -> None:
    job = tmp_path / "job"
    job.mkdir()
    (job / "a.tif").write_bytes(b"one")
    first = content_digest(job)
    assert first == content_digest(job)
    assert content_digest(job / "a.tif") != first
    (job / "a.tif").rename(job / "b.tif")
    assert content_digest(job) != first


def test_nothing_of_a_run_on_hold_goes_until_the_hold_is_lifted(path: Path, three_runs: Journal) -> None:
    holds = LabelStore(path)
    with three_runs as journal:
        key = run_key(journal.run(1))
        holds.hold(run=key, by="Anna", at_s=1.0, reason="claim 17")
        with pytest.raises(RequestError, match="is on hold already"):
            holds.hold(run=key, by="Anna", at_s=2.0, reason="again")
        tidied = journal.tidy(Retention(days=1.0, megabytes=0.001), now_s=1000 * DAY_S)
        assert (tidied.runs, tidied.on_hold) == ([2], [1])
        assert all(journal.page(1, sheet).evidence for sheet in range(5))
        assert not any(journal.page(3, sheet).evidence for sheet in range(5))
        with pytest.raises(RequestError, match="none is given"):
            holds.hold(run=key, by="Anna", at_s=3.0, reason=" ", lift=True)
        holds.hold(run=key, by="Bert", at_s=3.0, reason="settled", lift=True)
        assert journal.tidy(Retention(days=1.0), now_s=1000 * DAY_S).runs == [1]
    assert [(one.word, one.by, one.note) for one in holds.of_run(key)] == [
        ("hold", "Anna", "claim 17"),
        ("lifted", "Bert", "settled"),
    ]


def test_holds_that_cannot_be_read_keep_everything(path: Path, three_runs: Journal) -> None:
    labels_path(path).write_bytes(b"damaged")
    with three_runs as journal:
        with pytest.raises(JournalError, match="words"):
            journal.tidy(Retention(days=1.0), now_s=1000 * DAY_S)
        assert [run.id for run in journal.runs()] == [1, 2, 3]
