"""Signing in at an OpenID provider that listens on loopback: whom it lets in, and whom it must not."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

import pytest

pytest.importorskip("authlib", reason='needs pip install "prooflight-console[oidc]"')
pytest.importorskip("joserfc", reason='needs pip install "prooflight-console[oidc]"')

import httpx
from joserfc.jwk import OctKey, RSAKey
from packages.console.tests.consoles import PASSWORD, Clock, Served, served
from packages.console.tests.providers import CLIENT, SECRET, SmallProvider

from prooflight.cli import run
from prooflight.errors import InputError, RequestError
from prooflight_console.accounts.database import SCHEMA
from prooflight_console.accounts.provider import BEGUN_S, DOWN_S, KEYS_AGAIN_S, LEEWAY_S, OLDEST_S
from prooflight_console.accounts.provider_file import ProviderSettings
from prooflight_console.accounts.roles import Role, Scope

if TYPE_CHECKING:
    from collections.abc import Iterator

    from starlette.testclient import TestClient

ADDRESS = "http://localhost:8080"
ANN = {"preferred_username": "Ann", "groups": ["press-night", "canteen"]}
FILE = f"""
[oidc]
issuer = "http://127.0.0.1:9"
address = "{ADDRESS}/"
client_id = "{CLIENT}"
client_secret_file = "secret"
name = "Plant login"

[oidc.roles]
viewer = ["everybody"]
operator = ["press-night", "press-day"]
admin = ["it"]
"""


def settings_of(folder: Path, issuer: str, **changes: str) -> ProviderSettings:
    text = FILE.replace("http://127.0.0.1:9", issuer)
    for old, new in changes.items():
        text = text.replace("[oidc]\n", f"[oidc]\n{old} = {new}\n")
    (folder / "oidc.toml").write_text(text)
    (folder / "secret").write_text(SECRET + "\n")
    return ProviderSettings.read(folder / "oidc.toml")


@dataclass
class Plant:
    console: Served
    provider: SmallProvider

    def begun(self, client: TestClient, path: str = "/sign-in/provider") -> str:
        """Press the button, and say yes there; the address to which the provider sends the browser back."""
        answer = client.get(path, follow_redirects=False)
        assert answer.status_code == 303, answer.text
        back = httpx.get(answer.headers["location"])
        assert back.status_code == 302, back.text
        assert back.headers["location"].startswith(ADDRESS + "/sign-in/provider/return?")
        return str(back.headers["location"]).removeprefix(ADDRESS)

    def sign_in(self, client: TestClient, path: str = "/sign-in/provider") -> httpx.Response:
        return client.get(self.begun(client, path), follow_redirects=False)

    def refused(self, status: int, says: str) -> None:
        """Nobody comes in, the page says why, and so does the audit."""
        client = self.console.client()
        answer = self.sign_in(client)
        assert (answer.status_code, says in answer.text) == (status, True), answer.text
        assert client.get("/api/v1/session").status_code == 401
        (entry, *_) = self.console.accounts.audited(limit=1)
        assert entry.what == "session.refused"
        assert json.loads(entry.after or "")["by"] == self.provider.issuer


@pytest.fixture
def plant(tmp_path: Path) -> Iterator[Plant]:
    """A console and a provider that have one clock."""
    with SmallProvider(clock=Clock(), redirect_uri=ADDRESS + "/sign-in/provider/return") as provider:
        provider.person = dict(ANN)
        console = served(tmp_path, provider=settings_of(tmp_path, provider.issuer))
        provider.clock = console.clock
        yield Plant(console=console, provider=provider)
        console.close()


def test_whoever_has_a_group_comes_in_with_its_role(plant: Plant) -> None:
    client = plant.console.client()
    assert f'href="{ADDRESS}/sign-in/provider?next=%2Freport"' in client.get("/sign-in?next=/report").text
    answer = plant.sign_in(client, "/sign-in/provider?next=/report")
    assert (answer.status_code, answer.headers["location"]) == (303, "/report")
    said = client.get("/api/v1/session").json()
    assert (said["name"], said["role"]) == ("Ann", "operator")
    (asked,) = plant.provider.asked
    assert len(asked["state"]) > 40
    assert len(asked["nonce"]) > 40
    assert asked["scope"] == "openid profile"
    assert SECRET not in json.dumps(asked)
    told = [(one.who, one.what) for one in plant.console.accounts.audited(limit=2)]
    assert told == [("Ann", "session.begin"), (plant.provider.issuer, "user.add")]
    assert plant.console.accounts.verified().whole


def test_the_cookie_of_a_sign_in_is_for_no_script_and_ends_with_it(plant: Plant) -> None:
    client = plant.console.client()
    answer = client.get("/sign-in/provider", follow_redirects=False)
    said = answer.headers["set-cookie"]
    assert "HttpOnly" in said
    assert "SameSite=lax" in said
    back = httpx.get(answer.headers["location"]).headers["location"].removeprefix(ADDRESS)
    assert client.cookies.get("prooflight-state")
    client.get(back, follow_redirects=False)
    assert client.cookies.get("prooflight-state") is None


@pytest.mark.parametrize("address", ["https://elsewhere.example", "//elsewhere.example", "/\\elsewhere"])
def test_coming_back_leads_to_no_other_site(plant: Plant, address: str) -> None:
    answer = plant.sign_in(plant.console.client(), f"/sign-in/provider?next={address}")
    assert (answer.status_code, answer.headers["location"]) == (303, "/")


@pytest.mark.parametrize(
    ("spoilt", "says"),
    [
        ({"nonce": "another"}, "of another sign-in"),
        ({"nonce": None}, "of another sign-in"),
        ({"aud": "another"}, "for another program"),
        ({"aud": None}, "for another program"),
        ({"aud": [CLIENT, "another"]}, "issued for another program"),
        ({"aud": [CLIENT], "azp": "another"}, "issued for another program"),
        ({"iss": "http://127.0.0.1:1"}, "of another issuer"),
        ({"exp": 1_000_000 - LEEWAY_S}, "has expired"),
        ({"exp": None}, "does not state when"),
        ({"exp": "never"}, "does not state when"),
        ({"iat": 1_000_000 - OLDEST_S - LEEWAY_S - 1}, "not of the present time"),
        ({"iat": 1_000_000 + LEEWAY_S + 1}, "not of the present time"),
        ({"nbf": 1_000_000 + LEEWAY_S + 1}, "not of the present time"),
        ({"sub": None}, "names no user"),
        ({"sub": ""}, "names no user"),
    ],
)
def test_an_id_token_that_is_not_meant_lets_nobody_in(
    plant: Plant, spoilt: dict[str, Any], says: str
) -> None:
    plant.provider.spoilt = spoilt
    plant.refused(403, says)
    plant.provider.spoilt = {}
    assert plant.sign_in(plant.console.client()).status_code == 303, "and the right one does"


def test_only_the_keys_that_the_provider_publishes_are_good(plant: Plant) -> None:
    plant.provider.signs_with = RSAKey.generate_key(2048, {"kid": "1"}, private=True)
    plant.refused(403, "is not signed by the provider")


def test_a_public_key_is_no_shared_secret(plant: Plant) -> None:
    """The old trick: HMAC by the bytes of the public key."""
    secret = plant.provider.key.as_pem(private=False)
    plant.provider.algorithm, plant.provider.signs_with = "HS256", OctKey.import_key(secret.hex())
    plant.refused(403, "is not signed by the provider")


def test_a_new_key_of_the_provider_is_learned(plant: Plant) -> None:
    assert plant.sign_in(plant.console.client()).status_code == 303
    plant.provider.key = RSAKey.generate_key(2048, {"kid": "2"}, private=True)
    plant.console.clock.now_s += KEYS_AGAIN_S
    assert plant.sign_in(plant.console.client()).status_code == 303


def test_a_return_works_once_and_only_in_the_browser_that_began(plant: Plant) -> None:
    client = plant.console.client()
    back = plant.begun(client)
    other = plant.console.client()
    answer = other.get(back, follow_redirects=False)
    assert (answer.status_code, "this browser did not start this sign-in" in answer.text) == (400, True)
    state = client.cookies.get("prooflight-state")
    assert client.get(back, follow_redirects=False).status_code == 303
    client.cookies.set("prooflight-state", state, domain="testserver.local")
    answer = client.get(back, follow_redirects=False)
    assert (answer.status_code, "was used already" in answer.text) == (400, True)


def test_a_code_that_was_used_is_refused_by_the_provider_and_said(plant: Plant) -> None:
    client = plant.console.client()
    back = plant.begun(client)
    plant.provider.codes.clear()  # somebody was quicker
    answer = client.get(back, follow_redirects=False)
    assert (answer.status_code, "did not accept the code: invalid_grant no such code" in answer.text) == (
        403,
        True,
    )


def test_a_sign_in_waits_ten_minutes(plant: Plant) -> None:
    client = plant.console.client()
    back = plant.begun(client)
    plant.console.clock.now_s += BEGUN_S + 1
    answer = client.get(back, follow_redirects=False)
    assert (answer.status_code, "took too long" in answer.text) == (400, True)


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ("error=access_denied&error_description=%3Cb%3Eno%3C%2Fb%3E", "access_denied &lt;b&gt;no&lt;/b&gt;"),
        ("code=1&iss=http%3A%2F%2F127.0.0.1%3A1", "another provider"),
        ("code=1", "another provider"),
        ("iss={issuer}", "it sent no code"),
    ],
)
def test_what_comes_back_without_a_code_of_ours_is_said(plant: Plant, told: str, says: str) -> None:
    client = plant.console.client()
    state = parse_qs(urlsplit(plant.begun(client)).query)["state"][0]
    told = told.format(issuer=plant.provider.issuer)
    answer = client.get(f"/sign-in/provider/return?state={state}&{told}", follow_redirects=False)
    assert (answer.status_code, says in answer.text) == (403, True), answer.text


def test_whoever_has_no_mapped_group_is_refused_in_words(plant: Plant) -> None:
    plant.provider.person["groups"] = ["canteen"]
    plant.refused(403, "Ann, Plant login has signed you in, but none of your groups has access")
    assert [one.name for one in plant.console.accounts.people()] == []


def test_whoever_loses_their_group_loses_sessions_and_tokens(plant: Plant) -> None:
    client = plant.console.client()
    plant.sign_in(client)
    _, token = plant.console.accounts.new_token("Ann", "display", [Scope.READ], by="Ann")
    program = {"Authorization": f"Bearer {token}"}
    assert plant.console.client().get("/api/v1/session", headers=program).status_code == 200
    plant.provider.person["groups"] = []
    plant.refused(403, "none of your groups")
    assert client.get("/api/v1/session").status_code == 401
    assert plant.console.client().get("/api/v1/session", headers=program).status_code == 401


def test_a_role_follows_the_groups_and_the_highest_counts(plant: Plant) -> None:
    client = plant.console.client()
    plant.sign_in(client)
    plant.provider.person["groups"] = ["everybody", "it", "press-day"]
    other = plant.console.client()
    plant.sign_in(other)
    assert other.get("/api/v1/session").json()["role"] == "admin"
    assert client.get("/api/v1/session").status_code == 401, "the session of the lesser role has ended"
    (person,) = plant.console.accounts.people()
    assert (person.name, person.role, person.issuer) == ("Ann", Role.ADMIN, plant.provider.issuer)
    plant.provider.person["preferred_username"] = "Ann Other"
    plant.sign_in(other)
    assert [one.name for one in plant.console.accounts.people()] == ["Ann"], (
        "the subject counts, not the name"
    )


def test_nobody_takes_the_name_of_an_account_here(plant: Plant) -> None:
    local = plant.console.client(Role.ADMIN)
    plant.provider.person["preferred_username"] = " ADMIN\x07 "
    client = plant.console.client()
    plant.sign_in(client)
    assert client.get("/api/v1/session").json()["name"] == "ADMIN (2)"
    assert local.get("/api/v1/session").json()["name"] == "admin"


def test_what_the_provider_says_is_not_changed_here(plant: Plant) -> None:
    admin = plant.console.client(Role.ADMIN)
    plant.sign_in(plant.console.client())
    page = admin.get("/setup/users").text
    assert f"signs in at {plant.provider.issuer}" in page
    assert '"/setup/users/Ann/role"' not in page
    for changes in ({"role": "admin"},):
        answer = admin.patch("/api/v1/people/Ann", json=changes)
        assert (answer.status_code, "determine the role" in answer.json()["detail"]) == (409, True)
    assert admin.post("/api/v1/people/Ann/link").status_code == 409
    assert admin.patch("/api/v1/people/Ann", json={"locked": True}).status_code == 200
    plant.refused(403, "Ann, your account for this console is locked")


def test_an_admin_of_the_provider_is_not_the_last_admin(plant: Plant) -> None:
    plant.console.client(Role.ADMIN)
    plant.provider.person["groups"] = ["it"]
    plant.sign_in(plant.console.client())
    with pytest.raises(RequestError, match="last admin"):
        plant.console.accounts.change("admin", by="test", role=Role.VIEWER)


def test_the_first_link_is_never_that_of_somebody_elsewhere(plant: Plant) -> None:
    plant.provider.person |= {"groups": ["it"], "preferred_username": "admin"}
    plant.sign_in(plant.console.client())
    secret = plant.console.accounts.first_link()
    assert secret is not None
    person = plant.console.accounts.choose(secret, PASSWORD)
    assert person is not None
    assert (person.name, person.issuer) == ("admin (2)", None)


def test_a_claim_may_lie_within_others_and_be_one_word(plant: Plant, tmp_path: Path) -> None:
    mine = settings_of(tmp_path, plant.provider.issuer, claim='"realm_access.roles"', ask_again="true")
    again = tmp_path / "again"
    again.mkdir()
    console = served(again, provider=mine)
    other = Plant(console=console, provider=plant.provider)
    plant.provider.clock = console.clock
    for held, status in (({"roles": ["it"]}, 303), ({"roles": "press-day"}, 303), ("it", 403), (None, 403)):
        plant.provider.person = {"realm_access": held, "groups": ["it"]}
        assert other.sign_in(console.client()).status_code == status, held
    assert plant.provider.asked[-1]["prompt"] == "login"
    console.close()


def test_signing_out_ends_both_sessions(plant: Plant) -> None:
    client = plant.console.client()
    plant.sign_in(client)
    client.headers["X-CSRF-Token"] = client.get("/api/v1/session").json()["csrf"]
    answer = client.post("/sign-out")
    there = urlsplit(answer.headers["hx-redirect"])
    assert f"{there.scheme}://{there.netloc}{there.path}" == f"{plant.provider.issuer}/end"
    assert parse_qs(there.query) == {
        "client_id": [CLIENT],
        "post_logout_redirect_uri": [ADDRESS + "/sign-in"],
    }
    assert client.get("/api/v1/session").status_code == 401
    local = plant.console.client(Role.VIEWER)
    assert local.post("/sign-out").headers["hx-redirect"] == "/sign-in"


def test_while_the_provider_is_down_accounts_here_go_on(plant: Plant) -> None:
    plant.provider.down()
    client = plant.console.client(Role.ADMIN)
    assert client.get("/api/v1/session").status_code == 200
    answer = plant.console.client().get("/sign-in/provider", follow_redirects=False)
    assert answer.status_code == 503
    assert "Plant login is not available" in answer.text
    assert 'name="password"' in answer.text


def test_a_provider_that_comes_again_is_asked_again(plant: Plant) -> None:
    plant.provider.answer = lambda _path: (500, b"")
    client = plant.console.client()
    answer = client.get("/sign-in/provider", follow_redirects=False)
    assert (answer.status_code, "it answers 500" in answer.text) == (503, True)
    plant.provider.answer = lambda _path: None
    assert client.get("/sign-in/provider", follow_redirects=False).status_code == 503, "not at once"
    plant.console.clock.now_s += DOWN_S
    assert plant.sign_in(client).status_code == 303


@pytest.mark.parametrize(
    ("described", "says"),
    [
        ({"issuer": "http://127.0.0.1:1"}, "it states as its issuer"),
        ({"token_endpoint": None}, "it states no token_endpoint"),
        ({"token_endpoint": "http://elsewhere.example/token"}, "is not encrypted"),
        ({"authorization_endpoint": 7}, "it states no authorization_endpoint"),
        ({"jwks_uri": "javascript:1"}, "it states no jwks_uri"),
    ],
)
def test_a_provider_that_describes_itself_wrongly_is_not_asked(
    plant: Plant, described: dict[str, Any], says: str
) -> None:
    plant.provider.described = described
    answer = plant.console.client().get("/sign-in/provider", follow_redirects=False)
    assert (answer.status_code, says in answer.text) == (503, True), answer.text


@pytest.mark.parametrize(
    ("path", "body", "status", "says"),
    [
        ("/keys", b"[]", 503, "is not a JSON object"),
        ("/keys", b'{"keys": [{"kty": "none"}]}', 503, "keys cannot be read"),
        ("/.well-known/openid-configuration", b"<html>", 503, "is not JSON"),
    ],
)
def test_nonsense_of_a_provider_is_one_line(
    plant: Plant, path: str, body: bytes, status: int, says: str
) -> None:
    plant.provider.answer = lambda asked: (200, body) if asked == path else None
    answer = plant.console.client().get("/sign-in/provider", follow_redirects=False)
    assert (answer.status_code, says in answer.text) == (status, True), answer.text


@pytest.mark.parametrize(
    ("status", "body", "answers", "says"),
    [
        (500, b"", 503, "at its token endpoint"),
        (200, b"nonsense", 403, "cannot be read"),
        (200, b"[]", 403, "no ID token"),
        (200, b'{"access_token": "a"}', 403, "no ID token"),
        (200, b'{"id_token": "a.b.c"}', 403, "is not signed"),
        (401, b'{"error": "invalid_client"}', 403, "invalid_client"),
    ],
)
def test_what_a_token_endpoint_may_say_instead(
    plant: Plant, status: int, body: bytes, answers: int, says: str
) -> None:
    plant.provider.answer = lambda asked: (status, body) if asked == "/token" else None
    answer = plant.sign_in(plant.console.client())
    assert (answer.status_code, says in answer.text) == (answers, True), answer.text


def test_without_a_provider_there_is_no_such_page(tmp_path: Path) -> None:
    console = served(tmp_path)
    client = console.client()
    for path in ("/sign-in/provider", "/sign-in/provider/return?code=1&state=2"):
        assert client.get(path, follow_redirects=False).status_code == 404
    assert "provider" not in client.get("/sign-in").text
    console.close()


# --- its file ---


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[oidc]\n", "[iodc]\n", "iodc is unknown here"),
        ("[oidc]\n", "[oidc\n", "is not TOML"),
        ("[oidc]\n", "[other]\n[oidc]\n", "other is unknown here"),
        ('issuer = "http://127.0.0.1:9"', "", "oidc.issuer is missing"),
        ("http://127.0.0.1:9", "http://login.example", "oidc.issuer must begin with https"),
        ("http://127.0.0.1:9", "login.example", "oidc.issuer must be an address"),
        (ADDRESS, "http://console.example", "oidc.address must begin with https"),
        ('client_secret_file = "secret"', 'client_secret = "x"', "must not be in a file of settings"),
        (
            'client_secret_file = "secret"',
            'client_secret_file = "none"',
            "client_secret_file: none cannot be read",
        ),
        (
            'client_secret_file = "secret"',
            'client_secret_env = "PROOFLIGHT_NONE"',
            "PROOFLIGHT_NONE is empty",
        ),
        ('client_secret_file = "secret"', 'client_secret_file = "a"\nclient_secret_env = "b"', "not both"),
        ('name = "Plant login"', 'scopes = ["profile"]', 'must contain "openid"'),
        ('name = "Plant login"', "when = 2026-01-01", "contains a date"),
        ('name = "Plant login"', 'ca_file = "none.pem"', "oidc.ca_file: none.pem is not a file"),
        ('operator = ["press-night", "press-day"]', 'boss = ["x"]', "oidc.roles.boss is not known here"),
        ('admin = ["it"]', "admin = [7]", r"oidc.roles.admin.1 "),
    ],
)
def test_a_file_that_is_wrong_says_where(tmp_path: Path, old: str, new: str, says: str) -> None:
    settings_of(tmp_path, "http://127.0.0.1:9")
    file = tmp_path / "oidc.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=says) as told:
        ProviderSettings.read(file)
    assert "\n" not in str(told.value)


def test_a_file_without_its_block_is_none(tmp_path: Path) -> None:
    file = tmp_path / "oidc.toml"
    file.write_text("")
    with pytest.raises(RequestError, match=r"has no block \[oidc\]"):
        ProviderSettings.read(file)


def test_roles_that_map_nothing_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "oidc.toml"
    file.write_text(FILE.partition("[oidc.roles]")[0] + "[oidc.roles]\n")
    with pytest.raises(RequestError, match="must map a group"):
        ProviderSettings.read(file)


def test_serve_ends_with_one_line_where_its_file_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "oidc.toml"
    file.write_text("[oidc]\n")
    journal = str(tmp_path / "runs.sqlite")
    assert run(["serve", "--journal", journal, "--port", "0", "--oidc", str(file)]) == 2
    assert "oidc.issuer is missing" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == [file]


def test_a_secret_is_shown_by_nothing(tmp_path: Path) -> None:
    assert SECRET not in repr(settings_of(tmp_path, "http://127.0.0.1:9"))


def test_a_console_file_of_before_gets_what_it_lacks(plant: Plant, tmp_path: Path) -> None:
    import sqlite3
    from contextlib import closing

    admin = plant.console.client(Role.ADMIN)
    assert admin.get("/api/v1/session").status_code == 200
    plant.console.accounts.close()
    path = plant.console.accounts.path
    with closing(sqlite3.connect(path)) as file:
        file.execute("DROP TABLE identities")
        file.execute("UPDATE console SET schema = 1")
        file.commit()
    again = served(tmp_path, run=False)
    assert [person.name for person in again.accounts.people()] == ["admin"]
    assert again.accounts.verified().whole
    again.close()
    with closing(sqlite3.connect(path)) as file:
        assert file.execute("SELECT schema FROM console").fetchone() == (SCHEMA,)
