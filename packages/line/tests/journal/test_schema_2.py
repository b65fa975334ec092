"""A journal of an earlier version is read as it is, and brought up to date when a run is written into it."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import pytest
from packages.line.tests.journal.journals import facts, record

from prooflight.detectors.verdict import Verdict
from prooflight_line.journal.following import PageQuery, follow
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    from pathlib import Path

VERDICTS = {
    0: Verdict(page="p0", verdict="good"),
    1: Verdict(page="p1", verdict="misprint", kind="streak"),
    2: Verdict(page="p2", verdict="misprint", kind="streak", stopping_costs_more=True),
    3: Verdict.skipped("p3", 'its "action": was too late'),
}
DISPOSITIONS = [
    ("accept", "default"),
    ("stop", "default"),
    ("accept", "costs"),
    ("hold", "default"),
]
ACTIONS = {0: "accept", 1: "stop", 2: "accept", 3: "accept"}


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    """As schema 2 had it: an action as a column and in the verdict, and no disposition."""
    path = tmp_path / "journal.sqlite"
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        for sheet, verdict in VERDICTS.items():
            journal.record(run, record(sheet, verdict=verdict, kept=False))
        assert journal.commit()
    with closing(sqlite3.connect(path, isolation_level=None)) as raw:
        for sheet, action in ACTIONS.items():
            text = raw.execute("SELECT whole_verdict FROM pages WHERE sheet = ?", (sheet,)).fetchone()[0]
            verdict = json.loads(text)
            del verdict["stopping_costs_more"]
            raw.execute(
                "UPDATE pages SET disposition = ?, whole_verdict = ? WHERE sheet = ?",
                (action, json.dumps(verdict | {"action": action}), sheet),
            )
        raw.execute("ALTER TABLE pages RENAME COLUMN disposition TO action")
        raw.execute("ALTER TABLE pages DROP COLUMN decided_by")
        raw.execute("UPDATE journal SET schema = 2")
    return path


def dispositions(journal: Journal) -> list[tuple[str, str]]:
    return [(page.disposition, page.decided_by) for page in journal.pages(1)]


def test_its_rows_are_read_with_the_disposition_that_follows_from_them(earlier: Path) -> None:
    with Journal.open(str(earlier), read_only=True) as journal:
        assert dispositions(journal) == DISPOSITIONS
        assert [page.verdict for page in journal.pages(1)] == list(VERDICTS.values())
        assert journal.page(1, 3).verdict.reason == VERDICTS[3].reason
    with closing(sqlite3.connect(earlier)) as raw:
        assert raw.execute("SELECT schema FROM journal").fetchall() == [(2,)]


def test_a_run_written_into_it_brings_it_up_to_date_and_whoever_reads_it_reads_on(earlier: Path) -> None:
    with Journal.open(str(earlier), read_only=True) as reader:
        assert dispositions(reader) == DISPOSITIONS
        with Journal.open(str(earlier)) as writer:
            run = writer.begin_run(facts())
            writer.record(run, record(0, gate="divert", kept=False))
            assert writer.commit()
            assert dispositions(writer) == DISPOSITIONS
        assert dispositions(reader) == DISPOSITIONS
        assert [(page.disposition, page.decided_by) for page in reader.pages(run)] == [("divert", "gate")]


def test_it_is_followed_as_well(earlier: Path) -> None:
    follower = follow(earlier, version="test")
    assert follower is not None
    asked = PageQuery(run_id=1, to_review=True)
    rows = follower.sheets(asked, after=-1, limit=10, damaged=lambda _: None)
    follower.close()
    assert [row.page.sheet for row in rows] == [1, 2, 3]
    assert all(row.row > 0 for row in rows)


def test_a_disposition_that_does_not_follow_from_its_verdict_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts())
        journal.record(run, record(0, verdict=VERDICTS[3], kept=False))
    with closing(sqlite3.connect(path, isolation_level=None)) as raw:
        raw.execute("UPDATE pages SET disposition = 'accept'")
    with (
        Journal.open(str(path), read_only=True) as journal,
        pytest.raises(JournalError, match="disposition: differs from that of whole_verdict"),
    ):
        list(journal.pages(run))
