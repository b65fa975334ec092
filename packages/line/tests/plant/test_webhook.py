"""Posts that are signed, in order, tried again, and told as lost where they are refused."""

from __future__ import annotations

import pytest
from packages.line.tests.plant.peers import Proxy, Receiver, free_port
from packages.line.tests.plant.runs import LONGEST_S, Heard, event, outcome

from prooflight_line.plant.events import EventsLost, parsed
from prooflight_line.plant.outlets.outlet import Outlets, check
from prooflight_line.plant.outlets.webhook import KEY, SIGNATURE, TIMESTAMP, Webhook, signature, verified
from prooflight_line.plant.stream import EventStream

SECRET = b"a secret of sixteen letters"
QUICK = (0.01, 0.02)


def webhook(port: int, **told: object) -> Webhook:
    facts: dict[str, object] = {"secret": SECRET, "clock": lambda: 1_000_000.5}
    return Webhook(url=f"http://127.0.0.1:{port}/hook?token=hidden", **(facts | told))  # type: ignore[arg-type]


def numbers(taken: list[tuple[int, dict[str, str], bytes]]) -> list[int]:
    return [parsed(body).number for _, _, body in taken]


def test_every_event_arrives_in_order_and_signed() -> None:
    with Receiver() as receiver, Outlets([webhook(receiver.port)]) as outlets:
        for n in range(1, 51):
            outlets.put(event(n))
        receiver.heard.count(50)
    assert numbers(receiver.taken) == list(range(1, 51))
    for _, headers, body in receiver.taken:
        assert headers["Content-Type"] == "application/json"
        assert headers[KEY] == parsed(body).key
        assert verified(SECRET, headers, body, now_s=1_000_000)


@pytest.mark.parametrize(
    ("changed", "body", "now_s", "secret"),
    [
        ({}, b"{}", 1_000_301, SECRET),
        ({}, b"{}", 999_699, SECRET),
        ({}, b"{ }", 1_000_000, SECRET),
        ({}, b"{}", 1_000_000, b"another"),
        ({TIMESTAMP: "1000001"}, b"{}", 1_000_000, SECRET),
        ({TIMESTAMP: "soon"}, b"{}", 1_000_000, SECRET),
        ({SIGNATURE: "v1="}, b"{}", 1_000_000, SECRET),
        ({SIGNATURE: ""}, b"{}", 1_000_000, SECRET),
    ],
)
def test_what_was_changed_or_is_old_is_not_verified(
    changed: dict[str, str], body: bytes, now_s: float, secret: bytes
) -> None:
    headers = {TIMESTAMP: "1000000", SIGNATURE: signature(SECRET, "1000000", b"{}")}
    assert verified(SECRET, headers, b"{}", now_s=1_000_000)
    assert not verified(secret, headers | changed, body, now_s=now_s)


def test_the_signature_is_openssl_s() -> None:
    """printf '1000000.{}' | openssl dgst -sha256 -hmac 'a secret of sixteen letters'."""
    digest = "69f38d517229d656df96e5039278817cbcb7e8f2a7f8ec9e7d1aa63778745e9f"
    assert signature(SECRET, "1000000", b"{}") == f"v1={digest}"


@pytest.mark.parametrize("code", [500, 503, 429, 401, 404, 302])
def test_what_is_not_taken_is_sent_again_before_all_that_follow(code: int) -> None:
    said = Heard()
    with Receiver() as receiver, Outlets([webhook(receiver.port)], changed=said, pauses_s=QUICK) as outlets:
        receiver.answers = [204, code, code]
        for n in (1, 2, 3):
            outlets.put(event(n))
        receiver.heard.count(5)
    assert numbers(receiver.heard.all) == [1, 2, 2, 2, 3]
    assert numbers(receiver.taken) == [1, 2, 3]
    assert {headers[KEY] for _, headers, _ in receiver.heard.all[1:4]} == {"s-2"}
    assert any(not one.connected and f"answers {code}" in one.detail for one in said.all)
    assert said.all[-1].connected


def test_an_event_that_is_refused_is_told_as_lost_in_its_place() -> None:
    with Receiver() as receiver, Outlets([webhook(receiver.port)], pauses_s=QUICK) as outlets:
        receiver.answers = [204, 422]
        for n in (1, 2, 3):
            outlets.put(event(n))
        receiver.heard.count(4)
    assert numbers(receiver.taken) == [1, 2, 3]
    assert parsed(receiver.taken[1][2]).body == EventsLost(count=1, first=2, last=2)
    assert (outlets.health[0].lost, outlets.health[0].delivered) == (1, 3)


def test_only_the_kinds_that_were_asked_for_are_sent() -> None:
    with Receiver() as receiver:
        hook = webhook(receiver.port, kinds=frozenset({"sheet-judged"}))
        with Outlets([hook], close_s=LONGEST_S) as outlets:
            stream = EventStream([outlets.put], press="rig", stream="s")
            stream.state("press", "inspecting")
            stream.observe(outcome(0, late=True))
            stream.observe(outcome(1))
        kinds = [parsed(body).kind for _, _, body in receiver.taken]
    assert kinds == ["sheet-judged", "sheet-judged"]


def test_a_link_that_is_cut_or_hangs_loses_nothing() -> None:
    with Receiver() as receiver, Proxy(receiver.port) as proxy:
        with Outlets([webhook(proxy.port, timeout_s=0.3)], pauses_s=QUICK) as outlets:
            outlets.put(event(1))
            receiver.heard.count(1)
            proxy.cut(refusing=True)
            for n in range(2, 12):
                outlets.put(event(n))
            proxy.repair()
            receiver.heard.until(lambda told: numbers(told)[-1] == 11)
            proxy.hold()
            links = len(proxy.links.all)
            outlets.put(event(12))
            proxy.links.count(links + 1)  # it has given up waiting and tries anew
            proxy.go()
            receiver.heard.until(lambda told: numbers(told)[-1] == 12)
        seen = numbers(receiver.taken)
    assert sorted(set(seen)) == list(range(1, 13))
    assert seen == sorted(seen)


def test_checking_posts_nothing() -> None:
    with Receiver() as receiver:
        found = check(webhook(receiver.port))
        assert (found.ok, receiver.heard.all) == (True, [])
        assert "answers 405" in found.answer
        assert "hidden" not in found.name
    nobody = check(webhook(free_port()))
    assert (nobody.ok, nobody.answer) == (False, "Connection refused")
