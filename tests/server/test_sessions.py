"""Signing in: links, sessions that end, tries that are limited."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from tests.server.consoles import PASSWORD, Served, served

from prooflight.errors import RequestError
from prooflight.server.accounts.book import LINK_S, SESSION_S
from prooflight.server.accounts.passwords import TRIES, WINDOW_S, Passwords, Tries
from prooflight.server.accounts.roles import Role

if TYPE_CHECKING:
    from pathlib import Path


def test_the_first_start_gives_a_link_and_no_password(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    assert [person.ready for person in console.accounts.people()] == []
    first, second = console.accounts.first_link(), console.accounts.first_link()
    assert first is not None
    assert second is not None
    client = console.client()
    given = {"secret": first, "password": PASSWORD, "again": PASSWORD}
    assert client.post("/welcome", data=given).status_code == 422, "the later link ended the first"
    answer = client.post("/welcome", data=given | {"secret": second}, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    assert client.get("/api/v1/session").json()["role"] == "admin"
    assert client.post("/welcome", data=given | {"secret": second}).status_code == 422, "it works once"
    assert console.accounts.first_link() is None
    console.close()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"again": "another password"}, "not the same"),
        ({"password": "short", "again": "short"}, "10 to 200"),
        ({"secret": "nonsense"}, "used"),
    ],
)
def test_a_password_that_cannot_be_set_says_why(console: Served, changes: dict[str, str], says: str) -> None:
    secret = console.accounts.add("new", Role.VIEWER, by="test")
    given = {"secret": secret, "password": PASSWORD, "again": PASSWORD} | changes
    answer = console.client().post("/welcome", data=given)
    assert answer.status_code == 422
    assert says in answer.text


def test_a_link_ends_after_a_day(console: Served) -> None:
    secret = console.accounts.add("new", Role.VIEWER, by="test")
    console.clock.now_s += LINK_S - 1
    assert console.accounts.linked(secret) is not None
    console.clock.now_s += 2
    assert console.accounts.linked(secret) is None
    assert console.accounts.choose(secret, PASSWORD) is None


def test_a_session_ends_after_a_shift(console: Served) -> None:
    client = console.client(Role.VIEWER)
    console.clock.now_s += SESSION_S - 1
    assert client.get("/api/v1/session").status_code == 200
    console.clock.now_s += 2
    assert client.get("/api/v1/session").status_code == 401


def test_a_session_ends_by_signing_out_by_another_role_and_by_a_new_password(console: Served) -> None:
    client = console.client(Role.VIEWER)
    assert client.delete("/api/v1/session").status_code == 204
    assert client.get("/api/v1/session").status_code == 401
    client = console.client(Role.VIEWER)
    console.accounts.change("viewer", by="test", role=Role.OPERATOR)
    assert client.get("/api/v1/session").status_code == 401
    client = console.client(Role.VIEWER)
    console.accounts.choose(console.accounts.link("viewer", by="test"), "another password")
    assert client.get("/api/v1/session").status_code == 401


def test_the_cookie_is_for_this_site_and_for_no_script(tmp_path: Path) -> None:
    for secure in (False, True):
        folder = tmp_path / str(secure)
        folder.mkdir()
        console = served(folder, secure=secure)
        client = console.client()
        console.accounts.choose(console.accounts.add("a", Role.VIEWER, by="test"), PASSWORD)
        said = client.post("/api/v1/session", json={"name": "A", "password": PASSWORD}).headers["set-cookie"]
        assert "HttpOnly" in said
        assert "SameSite=lax" in said
        assert "Path=/" in said
        assert ("Secure" in said, said.startswith("__Host-")) == (secure, secure)
        console.close()


def test_wrong_passwords_are_limited_and_then_even_the_right_one_waits(console: Served) -> None:
    client = console.client(Role.VIEWER)
    given = {"name": "viewer", "password": "wrong"}
    for _ in range(TRIES["pair"]):
        assert client.post("/api/v1/session", json=given).status_code == 401
    answer = client.post("/api/v1/session", json=given | {"password": PASSWORD})
    assert (answer.status_code, answer.json()["type"]) == (429, "urn:prooflight:tries")
    assert 0 < int(answer.headers["retry-after"]) <= WINDOW_S
    console.clock.now_s += WINDOW_S
    assert client.post("/api/v1/session", json=given | {"password": PASSWORD}).status_code == 200


def test_one_address_cannot_try_many_names(console: Served) -> None:
    client = console.client()
    codes = [
        client.post("/api/v1/session", json={"name": f"n{k}", "password": "wrong"}).status_code
        for k in range(TRIES["address"] + 1)
    ]
    assert codes == [401] * TRIES["address"] + [429]


def test_a_stranger_cannot_lock_an_operator_out() -> None:
    tries = Tries(lambda: 0.0)
    for _ in range(TRIES["pair"]):
        tries.failed("Operator", "10.0.0.9")
    assert tries.wait_s("operator", "10.0.0.9") == WINDOW_S
    assert tries.wait_s("operator", "10.0.0.1") == 0


def test_a_name_that_nobody_has_is_verified_as_well() -> None:
    asked = []

    class Counting(Passwords):
        def right(self, kept: str | None, password: str) -> bool:
            asked.append(kept)
            return super().right(kept, password)

    assert not Counting().right(None, "whatever it is")
    assert asked == [None]


def test_the_last_admin_stays(console: Served) -> None:
    console.client(Role.ADMIN)
    for change in ({"role": Role.VIEWER}, {"locked": True}):
        with pytest.raises(RequestError, match="last admin"):
            console.accounts.change("admin", by="test", **change)  # type: ignore[arg-type]
    assert console.accounts.person("admin").role is Role.ADMIN


@pytest.mark.parametrize(
    "address",
    ["https://elsewhere.example", "//elsewhere.example", "/\\elsewhere.example", "javascript:1", "/\n"],
)
def test_signing_in_leads_to_no_other_site(console: Served, address: str) -> None:
    console.client(Role.VIEWER)
    given = {"name": "viewer", "password": PASSWORD, "next": address}
    answer = console.client().post("/sign-in", data=given, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")


def test_names_are_told_apart_without_regard_to_case(console: Served) -> None:
    console.accounts.add("Ann", Role.VIEWER, by="test")
    with pytest.raises(RequestError, match="already"):
        console.accounts.add("ann", Role.VIEWER, by="test")
