"""Words on sheets: added by several processes at once, never changed, and refused where they are none."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from packages.line.tests.journal.journals import facts, record

from prooflight.errors import RequestError
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import FALSE_ALARM, GOOD, Labels, LabelStore, labels_path
from prooflight_line.journal.schema import JournalError

RUN = "1@1000"
MANY = 40
SAY = """
import sys
from pathlib import Path
from prooflight_line.journal.labels import LabelStore
words = LabelStore(Path(sys.argv[1]))
for sheet in range(int(sys.argv[3])):
    words.say("good", run="1@1000", sheet=sheet, by=sys.argv[2], at_s=float(sheet))
"""


def say(words: LabelStore, word: str, **told: object) -> None:
    words.say(word, **({"run": RUN, "by": "Mei", "at_s": 5.0} | told))  # type: ignore[arg-type]


def test_two_processes_and_a_run_that_is_written_lose_no_word(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    with Journal.open(str(path)) as journal:  # holds the journal's lock all the while
        run = journal.begin_run(facts())
        saying = [
            subprocess.Popen([sys.executable, "-c", SAY, str(path), name, str(MANY)])
            for name in ("Jan", "Mei")
        ]
        for sheet in range(20):
            journal.record(run, record(sheet))
        journal.commit()
        assert [process.wait() for process in saying] == [0, 0]
        words = LabelStore(path).of_run(RUN)
        assert len(list(journal.pages(run))) == 20
    assert [word.id for word in words] == list(range(1, 2 * MANY + 1))
    for name in ("Jan", "Mei"):
        assert [word.sheet for word in words if word.by == name] == list(range(MANY))


def test_nothing_is_changed_and_nothing_taken_away(tmp_path: Path) -> None:
    words = LabelStore(tmp_path / "j.sqlite")
    say(words, "misprint", sheet=3)
    with closing(sqlite3.connect(words.path)) as connection:
        for statement in ("UPDATE words SET word = 'good'", "DELETE FROM words"):
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                connection.execute(statement)
    assert [word.word for word in words.of_run(RUN)] == ["misprint"]


def test_the_last_word_counts_and_seen_is_none(tmp_path: Path) -> None:
    words = LabelStore(tmp_path / "j.sqlite")
    assert words.of_run(RUN) == []
    assert words.last() == 0
    assert not words.path.exists()  # asking makes nothing
    say(words, "misprint", sheet=3)
    say(words, "good", sheet=3, note="only dust")
    say(words, "good", incident="2")
    say(words, "seen", incident="2")
    say(words, "misprint", sheet=3, run="1@2000")
    labels = Labels(words.of_run(RUN))
    own, on_incident = labels.of(3), labels.of(7, incident=2)
    assert own is not None
    assert on_incident is not None
    assert (own.word, own.note) == (GOOD, "only dust")
    assert on_incident.word == FALSE_ALARM  # a good alarm
    assert words.last() == 5


@pytest.mark.parametrize("wrong", [{"word": "bad"}, {"by": " "}, {"by": "a\x07b"}, {"by": "n" * 61}])
def test_what_is_no_word_or_nobodys_is_refused(tmp_path: Path, wrong: dict[str, str]) -> None:
    words = LabelStore(tmp_path / "j.sqlite")
    with pytest.raises(RequestError) as refusal:
        say(words, **({"word": "good", "sheet": 1} | wrong))  # type: ignore[arg-type]
    assert "\n" not in str(refusal.value)
    assert words.of_run(RUN) == []


@pytest.mark.parametrize("content", [b"no database at all, and longer than a header " * 30, "other"])
def test_another_file_in_its_place_is_refused_and_left_alone(tmp_path: Path, content: bytes | str) -> None:
    path = labels_path(tmp_path / "j.sqlite")
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        with closing(sqlite3.connect(path)) as connection:
            connection.execute("CREATE TABLE other (x)")
            connection.commit()
    before = path.read_bytes()
    words = LabelStore(tmp_path / "j.sqlite")
    for use in (lambda: words.of_run(RUN), lambda: say(words, "good", sheet=1)):
        with pytest.raises(JournalError) as refusal:
            use()
        assert str(path) in str(refusal.value)
    assert path.read_bytes() == before
