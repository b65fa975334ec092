"""The queue in the console: files come whole or not at all, by people who may, and jobs move once."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import Served, served
from packages.line.tests.job_queue.test_pairing import ORDER, Filling
from starlette.requests import ClientDisconnect

from prooflight_console.accounts.roles import Role, Scope
from prooflight_console.middleware import UPLOADS
from prooflight_line.journal.run_control import RunControl, Starter

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Iterator
    from pathlib import Path


@pytest.fixture
def filling(tmp_path: Path) -> Filling:
    return Filling(tmp_path / "jobs")


@pytest.fixture
def console(tmp_path: Path, filling: Filling) -> Iterator[Served]:
    made = served(tmp_path, queue=filling.folder.path)
    yield made
    made.close()


def test_a_job_and_its_ticket_are_sent_and_queued(console: Served, filling: Filling) -> None:
    operator = console.client(Role.OPERATOR)
    for name, content in (("order.xjdf", ORDER), ("menu.pdf", "good")):
        answer = operator.post(UPLOADS, params={"name": name}, content=content.encode())
        assert answer.status_code == 201, answer.text
        assert answer.json() == {"name": name, "bytes": len(content)}
    assert operator.get("/api/v1/queue").json()["arriving"] == ["menu.pdf", "order.xjdf"]
    assert filling.fill() == [("queued", "menu.pdf", "")]
    told = operator.get("/api/v1/queue").json()
    (job,) = told["waiting"]
    assert (job["stage"], job["name"], job["ticket"]["copies"]) == ("queued", "menu.pdf", 250)
    assert (told["arriving"], told["filled"]) == ([], False)
    page = operator.get("/queue").text
    assert "menu.pdf" in page
    assert "250 copies" in page
    assert "No process adds files to the queue" in page
    sent = next(one for one in console.accounts.audited() if one.what == "queue.send")
    assert (sent.who, sent.target) == ("operator", "menu.pdf")


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("../menu.pdf", 422),
        ("queued/000001-000000000000/menu.pdf", 422),
        (".menu.pdf", 422),
        ("menu.exe", 422),
        ("menu", 422),
        ("a" * 300 + ".pdf", 422),
        ("men\x00u.pdf", 422),
        ("", 422),
        ("there.pdf", 409),
    ],
)
def test_a_name_that_is_none_is_refused_and_leaves_nothing(
    console: Served, filling: Filling, name: str, status: int
) -> None:
    (filling.folder.path / "there.pdf").write_text("good")
    before = sorted(filling.folder.path.rglob("*"))
    answer = console.client(Role.OPERATOR).post(UPLOADS, params={"name": name}, content=b"good")
    assert answer.status_code == status, answer.text
    assert sorted(filling.folder.path.rglob("*")) == before
    assert (filling.folder.path / "there.pdf").read_text() == "good"


def test_a_file_that_breaks_off_leaves_nothing(console: Served, filling: Filling) -> None:
    async def broken() -> AsyncIterator[bytes]:
        yield b"good"
        raise ClientDisconnect

    with pytest.raises(ClientDisconnect):
        asyncio.run(console.console.queue.take("menu.pdf", broken()))
    assert [path for path in filling.folder.path.iterdir() if path.is_file()] == []
    client = console.client(Role.OPERATOR)
    assert client.post(UPLOADS, params={"name": "menu.pdf"}, content=b"").status_code == 422
    assert [path for path in filling.folder.path.iterdir() if path.is_file()] == []


def test_a_file_larger_than_other_bodies_comes_whole(console: Served, filling: Filling) -> None:
    content = b"good" * 2_000_000
    assert (
        console.client(Role.OPERATOR).post(UPLOADS, params={"name": "a.pdf"}, content=content).status_code
        == 201
    )
    assert (filling.folder.path / "a.pdf").read_bytes() == content


def test_only_those_who_may_send_and_move(console: Served, filling: Filling) -> None:
    filling.send("menu.pdf", "good")
    filling.fill()
    key = filling.folder.entries("queued")[0].key
    sends = {"url": UPLOADS, "params": {"name": "a.pdf"}, "content": b"good"}
    hold = f"/api/v1/queue/{key}/hold"
    viewer = console.client(Role.VIEWER)
    assert viewer.get("/api/v1/queue").status_code == 200
    assert "Hold" not in viewer.get("/queue").text
    for client in (viewer, console.client()):
        assert client.post(**sends).status_code in (401, 403)  # type: ignore[arg-type]
        assert client.post(hold).status_code in (401, 403)
    operator = console.client(Role.OPERATOR)
    del operator.headers["X-CSRF-Token"]
    assert operator.post(**sends).json()["type"] == "urn:prooflight:csrf"  # type: ignore[arg-type]
    assert operator.post(hold).status_code == 403
    program = console.client()
    for scope, status in ((Scope.LABELS, 403), (Scope.JOBS, 201)):
        token = console.accounts.new_token("operator", scope.value, [scope], by="test")[1]
        headers = {"Authorization": f"Bearer {token}"}
        assert program.post(**sends, headers=headers).status_code == status  # type: ignore[arg-type]


def test_jobs_are_held_released_preferred_and_removed(console: Served, filling: Filling) -> None:
    for name in ("a", "b"):
        filling.send(f"{name}.pdf", f"good {name}")
    filling.fill()
    a, b = (entry.key for entry in filling.folder.entries("queued"))
    operator = console.client(Role.OPERATOR)

    def waiting() -> list[tuple[str, str]]:
        return [(job["name"], job["stage"]) for job in operator.get("/api/v1/queue").json()["waiting"]]

    assert operator.post(f"/queue/{b}/first").status_code == 200
    assert waiting() == [("b.pdf", "queued"), ("a.pdf", "queued")]
    assert operator.post(f"/api/v1/queue/{b}/hold").json()["stage"] == "held"
    assert waiting() == [("a.pdf", "queued"), ("b.pdf", "held")]
    assert operator.post(f"/api/v1/queue/{b}/hold").status_code == 409
    assert "Release" in operator.post(f"/queue/{a}/hold").text
    operator.post(f"/queue/{b}/release")
    answer = operator.post(f"/api/v1/queue/{b}/remove").json()
    assert (answer["stage"], answer["reason"]) == ("rejected", "removed by operator")
    assert operator.post(f"/api/v1/queue/{b}/sell").status_code == 422
    assert operator.post("/api/v1/queue/999999-000000000000/hold").status_code == 409
    assert console.accounts.audited()[0].what == "queue.remove"


def test_the_next_job_is_started_where_something_waits_for_that(
    console: Served, filling: Filling, tmp_path: Path
) -> None:
    for name in ("a", "b"):
        filling.send(f"{name}.pdf", f"good {name}")
    filling.fill()
    a, b = (entry.key for entry in filling.folder.entries("queued"))
    operator, viewer = console.client(Role.OPERATOR), console.client(Role.VIEWER)
    assert "Start now" not in operator.get("/queue/jobs").text
    answer = operator.post(f"/api/v1/queue/{a}/start")
    assert answer.status_code == 409
    assert "--on-start" in answer.json()["detail"]
    control = RunControl(journal=console.journal)
    with control.starting(Starter(folder=str(tmp_path / "elsewhere"))):
        assert operator.post(f"/api/v1/queue/{a}/start").status_code == 409, "it takes jobs of another folder"
    waiting = Starter(folder=str(filling.folder.path.resolve()))
    with control.starting(waiting):
        assert operator.get("/queue/jobs").text.count("Start now</button>") == 1, "of the next job alone"
        assert "Start now" not in viewer.get("/queue/jobs").text
        assert viewer.post(f"/queue/{a}/start").status_code == 403
        assert control.start_request() is None
        assert operator.post(f"/queue/{a}/start").status_code == 200
        request = control.start_request()
        assert request is not None
        assert (request.of, request.by) == (a, "operator")
        assert operator.post("/api/v1/queue/999999-000000000000/start").status_code == 409
        control.write_starter(replace(waiting, job=a))
        assert operator.post(f"/api/v1/queue/{b}/start").status_code == 409, "a run goes on"
        control.write_starter(replace(waiting, trouble="camera: does not answer"))
        console.clock.now_s += 2
        shown = operator.get("/queue/control").text
        assert "camera: does not answer" in shown
        seen = shown.partition("seen=")[2].partition('"')[0]
        assert operator.get(f"/queue/control?seen={seen}").status_code == 204
    started = next(one for one in console.accounts.audited() if one.what == "queue.start")
    assert (started.who, started.target) == ("operator", "job 1, a.pdf")


def test_a_console_without_a_folder_has_no_queue(tmp_path: Path) -> None:
    made = served(tmp_path)
    client = made.client(Role.OPERATOR)
    assert client.get("/queue").status_code == 404
    assert client.get("/api/v1/queue").status_code == 404
    assert client.post(UPLOADS, params={"name": "a.pdf"}, content=b"good").status_code == 404
    assert 'href="/queue"' not in client.get("/").text
    made.close()
