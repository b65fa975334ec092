"""`prooflight serve`: what it refuses, who may, and a console beside `watch`."""

from __future__ import annotations

import json
import multiprocessing
import re
import signal
import socket
import ssl
import subprocess
import sys
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
import pytest
from packages.console.tests.consoles import PASSWORD, write_run

from prooflight.cli import run as prooflight
from prooflight.cli.exit_codes import INTERRUPTED
from prooflight.errors import RequestError
from prooflight_console.accounts.account_store import Accounts
from prooflight_console.accounts.roles import Scope
from prooflight_console.running import Listening
from prooflight_line.cli.watch.console import console_alongside

if TYPE_CHECKING:
    from collections.abc import Iterator

PATIENCE_S = 120.0
"""Only a test that fails waits so long."""


def certificate(folder: Path) -> tuple[Path, Path]:
    """Of 127.0.0.1, signed by itself."""
    chain, key = folder / "chain.pem", folder / "key.pem"
    subject = ["-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1"]
    made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", key, "-out", chain]
    subprocess.run([*made, "-days", "2", *subject], check=True, capture_output=True)
    return chain, key


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--host", "0.0.0.0"], "give --tls-cert and --tls-key"),
        (["--host", "192.168.1.20"], "passwords and sessions could be read"),
        (["--host", "console.example"], "passwords and sessions could be read"),
        (["--tls-cert", "chain.pem"], "go together"),
        (["--tls-cert", "none.pem", "--tls-key", "none.key"], "none.pem"),
        (["--tls-cert", "text.pem", "--tls-key", "text.pem"], "cannot be used with text.pem"),
        (["--press", "none.press"], "none.press: does not exist"),
        (["--journal", "postgresql://me:secret@here/db"], "***@here"),
        (["--port", "70000"], "--port"),
    ],
)
def test_what_cannot_be_served_is_refused_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("text.pem").write_text("no certificate")
    Path("chain.pem").write_text("no certificate")
    assert prooflight(["serve", "--journal", "j.sqlite", *options]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert says in said
    assert "secret" not in said
    assert not list(tmp_path.glob("*.sqlite*")), "nothing was begun"


def test_a_port_that_is_taken_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert prooflight(["serve", "--journal", str(tmp_path / "j.sqlite"), "--port", port]) == 2
    assert f"port {port}" in capsys.readouterr().err


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_an_address_to_listen_everywhere_is_printed_as_one_that_opens(host: str) -> None:
    listening = Listening(host=host, port=0, certificate=Path("c.pem"), key=Path("k.pem"))
    assert listening.reached_at(8443) == f"https://{socket.gethostname()}:8443"
    assert listening.reached_at(8443, ("https://press.example", "https://other")) == "https://press.example"
    assert Listening(host="::1").reached_at(81, ("https://press.example",)) == "http://[::1]:81"


def test_with_a_certificate_others_may_reach_it(tmp_path: Path) -> None:
    chain, key = certificate(tmp_path)
    Listening(host="0.0.0.0", certificate=chain, key=key).check()


def test_users_are_added_listed_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = ["--data", str(tmp_path / "console.sqlite")]
    assert prooflight(["serve", "user", "add", "Ann", "--role", "admin", "--json", *data]) == 0
    told = json.loads(capsys.readouterr().out)
    assert re.fullmatch(r"http://127\.0\.0\.1:8080/welcome#[\w-]{43}", told["link"])
    assert prooflight(["serve", "user", "add", "Bob", *data]) == 0
    assert prooflight(["serve", "user", "change", "bob", "--lock", *data]) == 0
    capsys.readouterr()
    assert prooflight(["serve", "user", "list", "--json", *data]) == 0
    assert [(one["name"], one["role"], one["locked"]) for one in json.loads(capsys.readouterr().out)] == [
        ("Ann", "admin", False),
        ("Bob", "operator", True),
    ]
    for words, says in (
        (["add", "ann"], "already"),
        (["add", "Eve", "--role", "king"], "choose viewer, operator, engineer, admin"),
        (["change", "Ann", "--role", "viewer"], "last admin"),
        (["link", "Zoe"], "there is no 'Zoe'"),
        (["add", "a\x1bb"], "can be printed"),
    ):
        assert prooflight(["serve", "user", *words, *data]) == 2
        assert says in capsys.readouterr().err
    assert prooflight(["audit", "verify", *data]) == 0
    assert "5 rows" not in capsys.readouterr().out


def test_a_token_is_printed_and_reads_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = ["--data", str(tmp_path / "console.sqlite")]
    assert prooflight(["serve", "user", "add", "prometheus", "--role", "viewer", *data]) == 0
    capsys.readouterr()
    assert prooflight(["serve", "user", "token", "prometheus", *data]) == 0
    with closing(Accounts(tmp_path / "console.sqlite")) as accounts:
        who = accounts.of_token(capsys.readouterr().out.strip())
    assert who is not None
    assert (who.name, who.scopes) == ("prometheus", {Scope.READ})
    for words, says in (
        (["nobody"], "there is no 'nobody'"),
        (["prometheus", "--scope", "all"], "choose read"),
    ):
        assert prooflight(["serve", "user", "token", *words, *data]) == 2
        assert says in capsys.readouterr().err


def test_an_audit_that_is_not_there_is_no_whole_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prooflight(["audit", "verify", "--journal", str(tmp_path / "j.sqlite")]) == 2
    assert "there is no file of a console" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def sent(queue: Any, address: str, link: str | None) -> None:
    queue.put((address, link))


def test_a_console_beside_a_run_serves_what_is_written_and_ends_with_it(tmp_path: Path) -> None:
    journal = tmp_path / "j.sqlite"
    queue = multiprocessing.get_context("spawn").Queue()
    press, job = tmp_path / "x.press", tmp_path / "job.pdf"
    with console_alongside(
        True, journal=str(journal), press=press, job=job, port=0, announce=partial(sent, queue)
    ):
        address, link = queue.get(timeout=PATIENCE_S)
        write_run(journal)
        assert link is not None
        given = {"secret": link.partition("#")[2], "password": PASSWORD, "again": PASSWORD}
        with httpx.Client(base_url=address, timeout=PATIENCE_S, trust_env=False) as client:
            assert client.post("/welcome", data=given).status_code == 303
            assert client.get("/api/v1/runs/last").json()["misprints"] == 3
    with pytest.raises(httpx.ConnectError):
        httpx.get(address, trust_env=False)


def test_a_console_beside_a_run_without_a_journal_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with (
        pytest.raises(RequestError, match="shows the contents of a journal"),
        console_alongside(True, journal="none", press=tmp_path, job=tmp_path, port=0),
    ):
        pytest.fail("it was begun")
    assert capsys.readouterr().err == ""


@pytest.fixture
def console(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], str, str]]:
    """A console as a user starts it, with TLS; its process, its address and its first link."""
    write_run(tmp_path / "j.sqlite")
    chain, key = certificate(tmp_path)
    words = ["serve", "--journal", str(tmp_path / "j.sqlite"), "--port", "0"]
    words += ["--tls-cert", str(chain), "--tls-key", str(key)]
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "prooflight", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    said = [process.stdout.readline() for _ in range(3)]
    address = re.search(r"https://127\.0\.0\.1:\d+", said[0])
    assert address is not None, said
    yield process, address[0], said[2].strip()
    process.kill()
    process.wait()
    process.stdout.close()


def test_a_console_as_a_user_starts_it(
    console: tuple[subprocess.Popen[str], str, str], tmp_path: Path
) -> None:
    process, address, link = console
    trusted = ssl.create_default_context(cafile=str(tmp_path / "chain.pem"))
    with httpx.Client(base_url=address, verify=trusted, timeout=PATIENCE_S, trust_env=False) as client:
        secret = link.partition("#")[2]
        given = {"secret": secret, "password": PASSWORD, "again": PASSWORD}
        answer = client.post("/welcome", data=given)
        assert answer.status_code == 303
        assert "Secure" in answer.headers["set-cookie"]
        assert "max-age" in answer.headers["strict-transport-security"]
        assert client.get("/api/v1/runs").json()["items"][0]["misprints"] == 3
        with client.stream("GET", "/api/v1/events") as events:
            assert next(events.iter_lines()).startswith("retry")
            process.send_signal(signal.SIGINT)  # a browser that listens does not keep it
            assert process.wait(PATIENCE_S) == INTERRUPTED
