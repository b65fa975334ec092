"""Who may: deny by default, roles, tokens, CSRF, and changes that another site sent."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from docs.generators.console_endpoints import endpoints_page
from fastapi import APIRouter, FastAPI
from packages.console.tests.consoles import PASSWORD, Served
from sqlalchemy import update

from prooflight_console.access import EndpointError, endpoint_rows, include, refuse_unguarded
from prooflight_console.accounts.database import tokens_table
from prooflight_console.accounts.roles import Role, Scope
from prooflight_console.app import console_app
from prooflight_console.problems import FOR_PROGRAMS, MEDIA_TYPE
from prooflight_console.settings import ConsoleSettings

if TYPE_CHECKING:
    from starlette.testclient import TestClient

PAGE = Path(__file__).resolve().parents[3] / "docs" / "reference" / "console-endpoints.md"
BODIES: dict[str, Any] = {
    "/api/v1/people": {"name": "new", "role": "viewer"},
    "/api/v1/tokens": {"name": "t", "scopes": ["read"]},
}
WORD = {"label": "seen"}


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    """Of a journal that is not there."""
    return console_app(ConsoleSettings.of(tmp_path_factory.mktemp("console") / "journal.sqlite"))


def test_an_endpoint_that_names_no_role_is_refused_when_the_console_is_made() -> None:
    router = APIRouter()

    @router.get("/api/v1/everything")
    def everything() -> dict[str, str]:
        return {}

    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    include(app, router)
    with pytest.raises(EndpointError, match=r"GET /api/v1/everything does not state who may call it"):
        refuse_unguarded(app)


def test_what_fastapi_adds_by_itself_is_refused_as_well() -> None:
    with pytest.raises(EndpointError, match=r"/openapi\.json"):
        refuse_unguarded(FastAPI())


def test_the_table_of_endpoints_is_what_the_document_says(app: FastAPI) -> None:
    assert PAGE.read_text() == endpoints_page(app), "run `python -m docs.generators.console_endpoints`"


def test_little_is_open_to_all(app: FastAPI) -> None:
    opened = {(method, path) for method, path, role, _ in endpoint_rows(app) if role == "open"}
    assert opened == {
        ("GET", "/sign-in"),
        ("POST", "/sign-in"),
        ("GET", "/kiosk"),
        ("POST", "/kiosk"),
        ("GET", "/sign-in/provider"),
        ("GET", "/sign-in/provider/return"),
        ("GET", "/welcome"),
        ("POST", "/welcome"),
        ("POST", "/welcome/name"),
        ("GET", "/static/{name:path}"),
        ("POST", "/api/v1/session"),
        ("GET", "/healthz"),
        ("GET", "/readyz"),
    }


def ask(client: TestClient, method: str, path: str) -> int:
    values = {"run": "1", "sheet": "10", "incident": "1", "name": "nobody", "token": "1", "code": "de"}
    values |= {"layer": "scan", "level": "0", "column": "0", "row": "0"}
    address = re.sub(r"\{(\w+)(?::\w+)?\}", lambda found: values.get(found[1], "1"), path)
    if method == "GET" and path.endswith("/events"):
        pytest.skip("goes on for ever; test_live asks it")
    return client.request(method, address, json=BODIES.get(path, WORD)).status_code


@pytest.mark.parametrize("role", list(Role))
def test_every_endpoint_refuses_roles_below_its_own_and_no_other(console: Served, role: Role) -> None:
    client, wrong = console.client(role), []
    for method, path, asked, _ in endpoint_rows(console.app):
        if asked == "open" or path.endswith("/events") or path in ("/sign-out",):
            continue
        if (method, path) == ("DELETE", "/api/v1/session"):
            continue
        refused = ask(client, method, path) == 403
        if refused == role.may(Role(asked)):
            wrong.append((method, path, asked))
    assert not wrong


def test_the_event_stream_of_a_page_without_a_session_ends_for_good(console: Served) -> None:
    answer = console.client().get("/now/events?after=0", headers={"accept": "text/event-stream"})
    assert (answer.status_code, answer.content) == (204, b"")  # a browser reconnects after anything else


def test_nobody_gets_anything(console: Served) -> None:
    client = console.client()
    for method, path, asked, _ in endpoint_rows(console.app):
        if asked == "open" or path.endswith("/events"):
            continue
        address = re.sub(r"\{[^}]+\}", "1", path)
        answer = client.request(method, address, json=WORD, follow_redirects=False)
        if not path.startswith(FOR_PROGRAMS) and method == "GET":
            assert answer.status_code == 303, path
            assert answer.headers["location"].startswith("/sign-in?next=")
        else:
            assert answer.status_code == 401, path
        if path.startswith("/api/"):
            assert answer.headers["content-type"] == MEDIA_TYPE
            assert answer.json()["type"] == "urn:prooflight:sign-in"


def test_a_change_without_the_session_s_csrf_token_is_refused(console: Served) -> None:
    client = console.client(Role.OPERATOR)
    address = "/api/v1/runs/1/incidents/1/labels"
    right = client.headers.pop("X-CSRF-Token")
    for headers in ({}, {"X-CSRF-Token": "wrong"}, {"X-CSRF-Token": right[:-1]}):
        answer = client.post(address, json=WORD, headers=headers)
        assert (answer.status_code, answer.json()["type"]) == (403, "urn:prooflight:csrf")
    assert client.post(address, json=WORD, headers={"X-CSRF-Token": right}).status_code == 201
    assert client.get("/api/v1/runs").status_code == 200, "reading asks for none"


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://elsewhere.example"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_what_another_site_sent_is_refused_even_with_the_token(
    console: Served, headers: dict[str, str]
) -> None:
    client = console.client(Role.OPERATOR)
    answer = client.post("/api/v1/runs/1/incidents/1/labels", json=WORD, headers=headers)
    assert answer.json()["type"] == "urn:prooflight:origin"
    given = {"name": "operator", "password": PASSWORD}
    assert client.post("/api/v1/session", json=given, headers=headers).status_code == 403


def test_a_token_may_what_its_scopes_say_and_its_owner_may(console: Served) -> None:
    console.client(Role.OPERATOR)
    _, reading = console.accounts.new_token("operator", "screen", [Scope.READ], by="test")
    _, all_of = console.accounts.new_token("operator", "all", list(Scope), by="test")
    client, words = console.client(), "/api/v1/runs/1/incidents/1/labels"
    # A token of the time when the scope had another name goes on working.
    token, former = console.accounts.new_token("operator", "former", [Scope.READ], by="test")
    own = tokens_table.c.id == token.id
    with console.accounts.engine.begin() as connection:
        connection.execute(update(tokens_table).where(own).values(scopes=["read", "words"]))
    for secret, says, sees_audit in ((reading, 403, 403), (all_of, 201, 403), (former, 201, 403)):
        headers = {"Authorization": f"Bearer {secret}"}
        assert client.get("/api/v1/runs", headers=headers).status_code == 200
        assert client.post(words, json=WORD, headers=headers).status_code == says
        assert client.get("/api/v1/audit", headers=headers).status_code == sees_audit, "an operator's token"
        assert client.get("/api/v1/tokens", headers=headers).status_code == 403, "no token makes tokens"


def test_a_token_ends_when_it_is_revoked_or_its_owner_locked_out(console: Served) -> None:
    console.client(Role.ADMIN)
    console.client(Role.VIEWER)
    client = console.client()
    first, secret = console.accounts.new_token("viewer", "a", [Scope.READ], by="test", days=1)
    headers = {"Authorization": f"Bearer {secret}"}
    assert client.get("/api/v1/session", headers=headers).status_code == 200
    console.clock.now_s += 86_401
    assert client.get("/api/v1/session", headers=headers).json()["type"] == "urn:prooflight:token"
    _, secret = console.accounts.new_token("viewer", "b", [Scope.READ], by="test")
    headers = {"Authorization": f"Bearer {secret}"}
    console.accounts.change("viewer", by="test", locked=True)
    assert client.get("/api/v1/session", headers=headers).status_code == 401
    console.accounts.change("viewer", by="test", locked=False)
    assert client.get("/api/v1/session", headers=headers).status_code == 200
    console.accounts.revoke(first.id + 1, by="test")
    assert client.get("/api/v1/session", headers=headers).status_code == 401


def test_neither_passwords_nor_secrets_lie_in_the_file(console: Served) -> None:
    console.client(Role.VIEWER)
    _, token = console.accounts.new_token("viewer", "a", [Scope.READ], by="test")
    link = console.accounts.link("viewer", by="test")
    session = console.accounts.begin("viewer")
    files = [console.accounts.path, console.accounts.path.with_name(console.accounts.path.name + "-wal")]
    held = b"".join(file.read_bytes() for file in files)
    for secret in (token, link, session, PASSWORD):
        assert secret.encode() not in held


def test_the_console_s_file_is_its_owner_s_alone(console: Served) -> None:
    assert console.accounts.path.stat().st_mode & 0o077 == 0
