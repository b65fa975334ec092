"""The audit: everything that changes stands in it, and a row that was changed is told."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import Served

from prooflight.cli import run as prooflight
from prooflight_console.accounts.roles import Role, Scope

if TYPE_CHECKING:
    from collections.abc import Callable


def rows(console: Served) -> list[tuple[str, str]]:
    return [(entry.who, entry.what) for entry in reversed(console.accounts.audited(limit=500))]


def test_who_did_what_before_and_after(console: Served) -> None:
    admin = console.client(Role.ADMIN)
    admin.post("/api/v1/people", json={"name": "Ann", "role": "viewer"})
    admin.patch("/api/v1/people/Ann", json={"role": "operator"})
    admin.post("/api/v1/runs/1/incidents/1/labels", json={"label": "false-alarm", "note": "a hair"})
    console.client().post("/api/v1/session", json={"name": "Ann", "password": "wrong"})
    assert rows(console)[-4:] == [
        ("admin", "user.add"),
        ("admin", "user.change"),
        ("admin", "words.say"),
        ("Ann", "session.refused"),
    ]
    changed = console.accounts.audited()[2]
    assert (changed.target, changed.before, changed.after) == (
        "Ann",
        '{"locked": false, "role": "viewer"}',
        '{"locked": false, "role": "operator"}',
    )
    told = admin.get("/api/v1/audit", params={"limit": 2}).json()
    assert [entry["what"] for entry in told["items"]] == ["session.refused", "words.say"]
    rest = admin.get("/api/v1/audit", params={"before": told["next"], "limit": 2}).json()
    assert [entry["what"] for entry in rest["items"]] == ["user.change", "user.add"]


def spoil(console: Served, sql: str) -> None:
    """As somebody would who can write the file."""
    with sqlite3.connect(console.accounts.path) as connection:
        for table in ("audit",):
            for way in ("update", "delete"):
                connection.execute(f"DROP TRIGGER {table}_{way}")
        connection.execute(sql)


def fill(console: Served) -> None:
    console.client(Role.ADMIN)
    for name in ("a", "b", "c"):
        console.accounts.new_token("admin", name, [Scope.READ], by="admin")


@pytest.mark.parametrize(
    ("sql", "says"),
    [
        ("UPDATE audit SET who = 'nobody' WHERE id = 3", "row 3 was changed"),
        ("UPDATE audit SET after = '{}' WHERE id = 4", "row 4 was changed"),
        ("DELETE FROM audit WHERE id = 2", "row 2 is missing"),
        ("UPDATE audit SET previous = digest WHERE id = 5", "row 5 does not follow the row before it"),
    ],
)
def test_a_broken_chain_is_told(
    console: Served, capsys: pytest.CaptureFixture[str], sql: str, says: str
) -> None:
    fill(console)
    assert console.accounts.verified().whole
    spoil(console, sql)
    assert console.accounts.verified().why == says
    assert prooflight(["audit", "verify", "--journal", str(console.journal)]) == 1
    assert says in capsys.readouterr().err
    told = console.client(Role.ADMIN).get("/api/v1/audit/chain").json()
    assert (told["whole"], told["why"]) == (False, says)


def test_an_end_that_was_cut_off_shows_beside_a_head_that_was_noted(
    console: Served, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(console)
    head = console.accounts.verified().head
    command = ["audit", "verify", "--journal", str(console.journal)]
    assert prooflight(command) == 0
    assert head in capsys.readouterr().out
    spoil(console, "DELETE FROM audit WHERE id = (SELECT max(id) FROM audit)")
    assert prooflight(command) == 0, "the chain alone cannot know"
    assert prooflight([*command, "--head", head]) == 1
    assert "cut off or rebuilt" in capsys.readouterr().err


@pytest.mark.parametrize("sql", ["UPDATE audit SET who = 'x'", "DELETE FROM audit"])
def test_rows_are_only_added(console: Served, sql: str) -> None:
    fill(console)
    console.client(Role.OPERATOR).post("/api/v1/runs/1/incidents/1/labels", json={"label": "seen"})
    with (
        sqlite3.connect(console.accounts.path) as connection,
        pytest.raises(sqlite3.IntegrityError, match="append-only"),
    ):
        connection.execute(sql)


@pytest.mark.parametrize(
    "make",
    [
        lambda path: path.write_text("no database, but long enough to be looked at " * 40),
        lambda path: sqlite3.connect(path).execute("CREATE TABLE other (x)"),
        lambda path: path.mkdir(),
    ],
)
def test_a_file_that_is_no_console_s_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], make: Callable[[Path], object]
) -> None:
    path = tmp_path / "other.sqlite"
    make(path)
    assert prooflight(["serve", "user", "list", "--data", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "other.sqlite" in said
