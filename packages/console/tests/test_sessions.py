"""Signing in: links, sessions that end, tries that are limited."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import PASSWORD, Served, served

from prooflight.cli import run
from prooflight.errors import RequestError
from prooflight_console.accounts.account_store import LINK_S, SESSION_S
from prooflight_console.accounts.passwords import TRIES, WINDOW_S, Passwords, Tries
from prooflight_console.accounts.roles import Role

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
        ({"again": "another password"}, "do not match"),
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


def test_the_page_of_a_link_names_whose_it_is_and_nobody_else_is_told(console: Served) -> None:
    client, secret = console.client(), console.accounts.add("new", Role.VIEWER, by="test")
    assert 'id="welcome-who"' in client.get("/welcome").text
    assert client.post("/welcome/name", data={"secret": secret}).json() == {"name": "new"}
    assert client.post("/welcome/name", data={"secret": "nonsense"}).status_code == 404
    console.accounts.choose(secret, PASSWORD)
    assert client.post("/welcome/name", data={"secret": secret}).status_code == 404


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


def test_signing_in_rightly_locks_nobody_out(console: Served) -> None:
    """A shift begins behind a proxy: all come from one address."""
    console.client(Role.VIEWER)
    client, right = console.client(), {"name": "viewer", "password": PASSWORD}
    codes = [client.post("/api/v1/session", json=right).status_code for _ in range(TRIES["name"] + 1)]
    assert set(codes) == {200}
    wrong = [client.post("/api/v1/session", json=right | {"name": f"n{k}"}).status_code for k in range(3)]
    assert wrong == [401] * 3, "failures of others count, and only these"


def test_a_success_between_forgives_nothing_to_the_address(console: Served) -> None:
    console.client(Role.VIEWER)
    client, right = console.client(), {"name": "viewer", "password": PASSWORD}
    for k in range(TRIES["address"]):
        client.post("/api/v1/session", json={"name": f"n{k}", "password": "wrong"})
        if k < TRIES["address"] - 1:
            assert client.post("/api/v1/session", json=right).status_code == 200
    assert client.post("/api/v1/session", json=right).status_code == 429


@pytest.mark.parametrize(("trusted", "locked"), [((), True), (("testclient",), False), (("10.0.0.9",), True)])
def test_behind_a_trusted_proxy_an_address_is_that_of_the_browser(
    tmp_path: Path, trusted: tuple[str, ...], locked: bool
) -> None:
    """What a browser says itself of where it comes from is believed of no one."""
    console = served(tmp_path, trusted_proxies=trusted)
    client = console.client()
    for k in range(TRIES["address"]):
        headers = {"X-Forwarded-For": f"198.51.100.7, 203.0.113.{5 if trusted else k}"}
        given = {"name": f"n{k}", "password": "wrong"}
        assert client.post("/api/v1/session", json=given, headers=headers).status_code == 401
    another = {"X-Forwarded-For": "203.0.113.99"}
    given = {"name": "somebody", "password": "wrong"}
    assert client.post("/api/v1/session", json=given, headers=another).status_code == (429 if locked else 401)
    forged = {"X-Forwarded-For": "192.0.2.1, 203.0.113.5"}
    assert client.post("/api/v1/session", json=given, headers=forged).status_code == 429
    console.close()


def test_an_address_that_is_none_is_no_trusted_proxy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["serve", "--journal", str(tmp_path / "j.sqlite"), "--trusted-proxy", "my proxy"]
    assert run(given) == 2
    said = capsys.readouterr().err
    assert "'my proxy' is not an address" in said
    assert said.count("\n") == 1


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


def test_an_admin_who_cannot_sign_in_yet_does_not_count(console: Served) -> None:
    console.client(Role.ADMIN)
    link = console.accounts.add("second", Role.ADMIN, by="test")
    for change in ({"role": Role.VIEWER}, {"locked": True}):
        with pytest.raises(RequestError, match="last admin who can sign in"):
            console.accounts.change("admin", by="test", **change)  # type: ignore[arg-type]
    console.accounts.choose(link, PASSWORD)
    assert console.accounts.change("admin", by="test", role=Role.VIEWER).role is Role.VIEWER


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("\u0430dmin", "mixes letters of Cyrillic and Latin"),
        ("adm\u03b9n", "mixes letters of Greek and Latin"),
        ("\u0440\u0430\u0440\u0430", "looks like it"),
        ("\uff50\uff41\uff50\uff41", "looks like it"),
        ("Jan\nMei", "on one line"),
        ("Jan\tMei", "on one line"),
        ("Jan\u200bMei", "on one line"),
        ("\u202eJan", "on one line"),
        ("a/b", "names are part of addresses"),
        ("..", "letters that can be printed"),
        ("a?b", "names are part of addresses"),
    ],
)
def test_a_name_that_people_cannot_tell_apart_or_that_breaks_a_line_or_an_address_is_refused(
    console: Served, name: str, why: str
) -> None:
    console.accounts.add("papa", Role.VIEWER, by="test")
    admin = console.client(Role.ADMIN)
    answer = admin.post("/api/v1/people", json={"name": name, "role": "viewer"})
    assert (answer.status_code, why in answer.json()["detail"]) == (409, True), answer.text
    assert why in admin.post("/setup/users", data={"name": name, "role": "viewer"}).text.replace("&#39;", "'")
    assert len(console.accounts.people()) == 2


@pytest.mark.parametrize(
    "name",
    ["Mei Lin", "Jos\u00e9", "O'Neil", "\u041e\u043b\u044f", "\u674e\u96f7", "\u00d6zlem", "M\u00fcller 2"],
)
def test_a_name_of_any_one_script_signs_in_whatever_its_case(console: Served, name: str) -> None:
    console.accounts.choose(console.accounts.add(name, Role.VIEWER, by="test"), PASSWORD)
    for given in (name, name.upper(), name.lower()):
        answer = console.client().post("/api/v1/session", json={"name": given, "password": PASSWORD})
        assert (answer.status_code, answer.json()["name"]) == (200, name)


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
