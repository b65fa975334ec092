"""Sign-in by badge or PIN at a kiosk: only there, for short, as an operator at most, and with a name in the audit."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest
from packages.console.tests.consoles import ADDRESS, PASSWORD
from starlette.testclient import TestClient

from prooflight_console.accounts.kiosks import FULL_IDLE_S, IDLE_S, MOST_FAILED
from prooflight_console.accounts.roles import Role

if TYPE_CHECKING:
    from packages.console.tests.consoles import Served

PIN, BADGE = "271953", "0047112233"


@pytest.fixture
def device(console: Served) -> TestClient:
    """A browser that an administrator made a kiosk; Erik, an engineer, has a PIN and a badge."""
    admin = console.client(Role.ADMIN)
    engineer = console.client(Role.ENGINEER)
    answer = engineer.post("/setup/kiosks/pin", data={"pin": PIN, "again": PIN})
    assert "The PIN is set." in answer.text
    given = {"person": "engineer", "badge": BADGE}
    assert "The badge is set." in admin.post("/setup/kiosks/badge", data=given).text
    answer = admin.post("/setup/kiosks/enrol", data={"name": "Press 2, delivery"})
    assert answer.status_code == 204
    assert admin.get("/api/v1/session").status_code == 401, "the admin is signed out on the device"
    del admin.headers["X-CSRF-Token"]
    return admin


def signed_in(device: TestClient, **given: str) -> int:
    """Sign in at the device, and take the CSRF token that its pages have."""
    answer = device.post("/kiosk", data=given, follow_redirects=False)
    if answer.status_code == 303:
        found = re.search(r'name="csrf" content="([^"]+)"', device.get("/").text)
        assert found is not None
        device.headers["X-CSRF-Token"] = found[1]
    return answer.status_code


def audited(console: Served) -> list[Any]:
    return [(one.who, one.what) for one in console.accounts.audited(limit=100)]


@pytest.mark.parametrize("given", [{"badge": BADGE}, {"name": "engineer", "pin": PIN}])
def test_a_person_signs_in_as_operator_at_most_and_acts_under_their_name(
    console: Served, device: TestClient, given: dict[str, str]
) -> None:
    assert signed_in(device, **given) == 303
    session = device.get("/api/v1/session").json()
    assert (session["name"], session["role"]) == ("engineer", "operator")
    assert device.post("/api/v1/runs/1/incidents/1/labels", json={"label": "seen"}).status_code == 201
    assert ("engineer", "words.say") in audited(console)
    assert device.get("/setup/zones/1").status_code == 403
    # Nothing that outlives the session: no token, no PIN, no password.
    assert device.post("/api/v1/tokens", json={"name": "x", "scopes": ["read"]}).status_code == 403
    assert device.post("/setup/tokens", data={"name": "x"}).status_code == 403
    assert device.post("/setup/kiosks/pin", data={"pin": PIN, "again": PIN}).status_code == 403
    assert device.post("/sign-out").status_code == 204
    assert device.get("/api/v1/session").status_code == 401


def test_a_session_ends_when_nobody_acts_and_not_while_somebody_does(
    console: Served, device: TestClient
) -> None:
    assert signed_in(device, badge=BADGE) == 303
    for _ in range(4):
        console.clock.now_s += IDLE_S - 1
        assert device.get("/", headers={"Sec-Fetch-Mode": "navigate"}).status_code == 200
    console.clock.now_s += IDLE_S - 1
    assert device.get("/api/v1/now").status_code == 200, "what a page fetches by itself is no action"
    console.clock.now_s += 2
    assert device.get("/api/v1/session").status_code == 401
    answer = device.get("/alarms", follow_redirects=False)
    assert answer.headers["location"].startswith("/kiosk?next=")


def test_a_full_password_gives_the_own_role_and_ends_too(console: Served, device: TestClient) -> None:
    given = {"name": "engineer", "password": PASSWORD}
    assert device.post("/sign-in", data=given, follow_redirects=False).status_code == 303
    assert device.get("/api/v1/session").json()["role"] == "engineer"
    console.clock.now_s += FULL_IDLE_S + 1
    assert device.get("/api/v1/session").status_code == 401


def test_badge_and_pin_are_taken_nowhere_else(console: Served, device: TestClient) -> None:
    elsewhere = TestClient(console.app, base_url=ADDRESS, raise_server_exceptions=False)
    console.clients.append(elsewhere)
    assert "This device is no kiosk" in elsewhere.get("/kiosk").text
    assert signed_in(elsewhere, badge=BADGE) == 403
    elsewhere.cookies.set("prooflight-kiosk", "guessed")
    assert signed_in(elsewhere, badge=BADGE) == 403
    console.accounts.kiosks.revoke(1, by="admin")
    assert signed_in(device, badge=BADGE) == 403


def test_a_revoked_kiosk_ends_its_sessions(console: Served, device: TestClient) -> None:
    assert signed_in(device, badge=BADGE) == 303
    console.accounts.kiosks.revoke(1, by="admin")
    assert device.get("/api/v1/session").status_code == 401


def test_wrong_pins_lock_the_pin_and_nothing_else(console: Served, device: TestClient) -> None:
    for _ in range(MOST_FAILED):
        assert signed_in(device, name="engineer", pin="000001") == 401
    assert signed_in(device, name="engineer", pin=PIN) == 429, "the limit of a quarter of an hour"
    console.clock.now_s += 1000
    assert signed_in(device, name="engineer", pin=PIN) == 401, "locked until another PIN is set"
    assert ("console", "kiosk.locked") in audited(console)
    assert signed_in(device, badge=BADGE) == 303, "the badge is not"
    console.accounts.kiosks.set_pin("engineer", "864209", by="engineer")
    assert signed_in(device, name="engineer", pin="864209") == 303


def test_badges_cannot_be_tried_one_after_the_other(console: Served, device: TestClient) -> None:
    answers = [signed_in(device, badge=f"00471122{number:02}") for number in range(7)]
    assert answers == [401] * 5 + [429] * 2


@pytest.mark.parametrize(
    "pin", ["12345", "1234567890123", "111111", "123456", "987654", "12a456", "", "٠١٢٣٥٧"]
)
def test_pins_that_anybody_guesses_are_refused(console: Served, pin: str) -> None:
    engineer = console.client(Role.ENGINEER)
    assert engineer.post("/setup/kiosks/pin", data={"pin": pin, "again": pin}).status_code == 422
    assert not console.accounts.kiosks.keys()


def test_a_locked_person_and_another_ones_badge(console: Served, device: TestClient) -> None:
    console.client(Role.OPERATOR)
    other = console.client(Role.ADMIN)
    given = {"person": "operator", "badge": BADGE}
    assert other.post("/setup/kiosks/badge", data=given).status_code in (409, 422)
    console.accounts.change("engineer", by="admin", locked=True)
    assert signed_in(device, badge=BADGE) == 401
    assert signed_in(device, name="engineer", pin=PIN) == 401


def test_only_an_admin_enrols_and_hands_out_badges(console: Served) -> None:
    engineer = console.client(Role.ENGINEER)
    assert engineer.post("/setup/kiosks/enrol", data={"name": "x"}).status_code == 403
    assert engineer.post("/setup/kiosks/badge", data={"person": "x", "badge": BADGE}).status_code == 403
    assert engineer.post("/setup/kiosks/remove", data={"person": "x"}).status_code == 403
    assert "Make this device a kiosk" not in engineer.get("/setup/kiosks").text


def test_pins_and_badges_are_in_no_file_as_they_are(console: Served, device: TestClient) -> None:
    assert signed_in(device, badge=BADGE) == 303
    data = console.console.settings.data
    content = b"".join(file.read_bytes() for file in data.parent.glob(f"{data.name}*") if file.is_file())
    assert PIN.encode() not in content
    assert BADGE.encode() not in content
