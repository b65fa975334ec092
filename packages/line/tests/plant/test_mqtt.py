"""MQTT against Debian's mosquitto on loopback: what is told under which topic, and that nothing is lost on the way."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import ssl
import subprocess
import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import aiomqtt
import pytest
from packages.line.tests.plant.peers import Proxy, broker, free_port
from packages.line.tests.plant.runs import FACTS, LONGEST_S, MISPRINT, Heard, event, outcome

from prooflight_line.plant.events import KINDS, parsed
from prooflight_line.plant.outlets.mqtt import TOPICS, Mqtt, topics
from prooflight_line.plant.outlets.outlet import Outlets, check
from prooflight_line.plant.stream import EventStream

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

QUICK = (0.01, 0.05)


@contextlib.contextmanager
def listening(port: int, **how: Any) -> Iterator[Heard]:
    """All that a consumer is told under rig/#: (topic, payload, retained)."""
    heard, ready = Heard(), threading.Event()
    loop = asyncio.new_event_loop()

    async def listen() -> None:
        async with aiomqtt.Client("127.0.0.1", port, **how) as client:
            await client.subscribe("rig/#", qos=1)
            ready.set()
            async for message in client.messages:
                heard((str(message.topic), bytes(message.payload), message.retain))

    task = loop.create_task(listen())

    def serve() -> None:
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(task)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        assert ready.wait(LONGEST_S)
        yield heard
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join()
        loop.run_until_complete(loop.shutdown_default_executor())
        loop.close()


def mqtt(port: int, **told: Any) -> Mqtt:
    return Mqtt(host="127.0.0.1", port=port, topic="rig", **told)


def states(told: list[Any]) -> list[tuple[str, bool]]:
    """Whether a run goes on, by each retained state."""
    return [(topic, json.loads(text)["running"]) for topic, text, _ in told if topic == "rig/state"]


def numbers(told: list[Any], part: str) -> list[int]:
    return [parsed(payload).number for topic, payload, _ in told if topic == f"rig/{part}"]


def test_a_message_a_sheet_and_an_incident_and_a_state_for_who_joins_late(tmp_path: Path) -> None:
    with broker(tmp_path) as server, listening(server.port) as heard:
        with Outlets([mqtt(server.port)]) as outlets:
            told = EventStream([outlets.put], press="rig", run=3, stream="s", clock=lambda: 1e9)
            told.started(FACTS)
            told.state("press", "inspecting")
            for n in range(3):
                told.observe(outcome(n))
            for n in range(3, 8):
                told.observe(outcome(n, MISPRINT))
            heard.until(lambda all_: len(numbers(all_, "sheet")) == 8 and len(numbers(all_, "incident")) == 3)
            heard.until(
                lambda all_: any(topic == "rig/state" and b'"count":4' in text for topic, text, _ in all_)
            )
            with listening(server.port) as late:
                first = {topic: payload for topic, payload, _ in late.count(2)}
            assert all(retained for _, _, retained in late.all[:2])
            assert first["rig/online"] == b"true"
            state = json.loads(first["rig/state"])
            assert (state["job"], state["running"], state["states"]) == (
                FACTS.job,
                True,
                {"press": "inspecting"},
            )
            assert [(one["number"], one["kind"]) for one in state["incidents"]] == [(1, "streak")]
            told.ended("finished")
        heard.until(lambda all_: all_[-1][:2] == ("rig/online", b"false"))
        events = [parsed(text) for topic, text, _ in heard.all if topic not in ("rig/online", "rig/state")]
        assert [one.number for one in events] == list(range(1, len(events) + 1))
        assert all(
            topic == f"rig/{TOPICS[one.kind]}"
            for one, (topic, *_) in zip(events, _events(heard), strict=True)
        )
        assert not any(retained for *_, retained in heard.all)
        with listening(server.port) as late:
            last = {topic: payload for topic, payload, _ in late.count(2)}
        assert (last["rig/online"], json.loads(last["rig/state"])["ending"]) == (b"false", "finished")


def _events(heard: Heard) -> list[Any]:
    return [one for one in heard.all if one[0] not in ("rig/online", "rig/state")]


def test_the_last_will_says_that_prooflight_is_gone(tmp_path: Path) -> None:
    """As where the process dies: the broker says so, not Prooflight."""
    with (
        broker(tmp_path) as server,
        listening(server.port) as heard,
        Proxy(server.port) as proxy,
        Outlets([mqtt(proxy.port)], pauses_s=QUICK) as outlets,
    ):
        heard.until(lambda told: ("rig/online", b"true", False) in told)
        stream = EventStream([outlets.put], press="rig", run=3, stream="s")
        stream.started(FACTS)
        heard.until(lambda told: ("rig/state", True) in states(told))
        stream.observe(outcome(0))
        heard.until(lambda told: bool(numbers(told, "sheet")))
        proxy.cut(refusing=True)
        heard.until(lambda told: ("rig/online", b"false", False) in told and states(told)[-1][1] is False)
        lost = json.loads([text for topic, text, _ in heard.all if topic == "rig/state"][-1])
        assert (lost["running"], lost["ending"], lost["job"]) == (False, "lost", FACTS.job)
        with listening(server.port) as late:
            late.until(lambda told: states(told)[:1] == [("rig/state", False)])
        proxy.repair()
        heard.until(lambda told: states(told)[-1][1] is True)
        heard.until(lambda told: [text for topic, text, _ in told if topic == "rig/online"][-1] == b"true")
        outlets.put(event(1))
        heard.until(lambda told: numbers(told, "notice") == [1])


def test_a_link_that_is_cut_and_a_broker_that_restarts_lose_nothing(tmp_path: Path) -> None:
    with (
        broker(tmp_path) as server,
        Proxy(server.port) as proxy,
        Outlets([mqtt(proxy.port, timeout_s=1.0)], pauses_s=QUICK, close_s=LONGEST_S) as outlets,
    ):
        with listening(server.port) as heard:
            for n in range(1, 201):
                outlets.put(event(n))
                if n % 50 == 0:
                    heard.until(lambda told, n=n: n - 20 in numbers(told, "notice"))
                    proxy.cut()
            heard.until(lambda told: 200 in numbers(told, "notice"))
            assert sorted(set(numbers(heard.all, "notice"))) == list(range(1, 201))
        server.end()
        for n in range(201, 221):
            outlets.put(event(n))
        server.start()
        with listening(server.port) as heard:
            outlets.put(event(221))
            heard.until(lambda told: 221 in numbers(told, "notice"))
    assert outlets.health[0].delivered == 221
    assert (outlets.health[0].lost, outlets.given_up) == (0, {})


def test_a_link_that_hangs_is_given_up_and_what_was_under_way_sent_again(tmp_path: Path) -> None:
    with broker(tmp_path) as server, Proxy(server.port) as proxy, listening(server.port) as heard:
        with Outlets([mqtt(proxy.port, timeout_s=0.5)], pauses_s=QUICK) as outlets:
            proxy.links.count(1)
            heard.until(lambda told: ("rig/online", b"true", False) in told)
            proxy.hold()
            for n in range(1, 101):
                outlets.put(event(n))
            proxy.links.count(2)
            proxy.go()
            heard.until(lambda told: 100 in numbers(told, "notice"))
        assert sorted(set(numbers(heard.all, "notice"))) == list(range(1, 101))


@pytest.fixture
def certificates(tmp_path: Path) -> Path:
    """An authority of our own and a certificate of it for loopback, by openssl."""

    def openssl(*words: str) -> None:
        subprocess.run(["openssl", *words], cwd=tmp_path, check=True, capture_output=True)

    ca = ("-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=ca", "-keyout", "ca.key")
    openssl("req", *ca, "-out", "ca.pem", "-addext", "keyUsage=critical,keyCertSign")
    openssl(
        "req", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=here", "-keyout", "key.pem", "-out", "one.csr"
    )
    (tmp_path / "ext").write_text("subjectAltName=IP:127.0.0.1\n", encoding="utf-8")
    signed = ("-in", "one.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-days", "2", "-extfile", "ext")
    openssl("x509", "-req", *signed, "-CAcreateserial", "-out", "one.pem")
    return tmp_path


# paho leaves the socket of a handshake that failed to the collector of garbage.
@pytest.mark.filterwarnings("ignore:.*ssl.SSLSocket:pytest.PytestUnraisableExceptionWarning")
def test_tls_and_a_password_are_asked_for(tmp_path: Path, certificates: Path) -> None:
    passwords = tmp_path / "passwords"
    subprocess.run(
        ["mosquitto_passwd", "-b", "-c", str(passwords), "press", "ink"], check=True, capture_output=True
    )
    lines = (
        *(
            f"{name} {certificates / file}"
            for name, file in (("certfile", "one.pem"), ("keyfile", "key.pem"))
        ),
        f"password_file {passwords}",
        "allow_anonymous false",
        "user root",
    )
    with broker(tmp_path, *lines) as server:
        trusted = ssl.create_default_context(cafile=str(certificates / "ca.pem"))
        good = mqtt(server.port, user="press", password="ink", tls=trusted)
        assert check(good).ok
        wrong = check(replace(good, password="water"))
        assert not wrong.ok
        assert wrong.answer == "Not authorized"
        stranger = check(replace(good, tls=ssl.create_default_context()))
        assert not stranger.ok
        assert "certificate" in stranger.answer.lower()
        gc.collect()  # here the warning is expected; any later test would fail by it
        consumer = listening(server.port, username="press", password="ink", tls_context=trusted)
        with consumer as heard, Outlets([good]) as outlets:
            outlets.put(event(1))
            heard.until(lambda told: numbers(told, "notice") == [1])
    assert "ink" not in repr(good)


def test_checking_says_who_answers(tmp_path: Path) -> None:
    with broker(tmp_path) as server:
        found = check(mqtt(server.port))
        assert (found.ok, found.answer) == (True, f"a broker at 127.0.0.1:{server.port}")
    nobody = check(mqtt(free_port()))
    assert not nobody.ok
    assert "refused" in nobody.answer.lower()


def test_every_kind_of_event_has_a_topic() -> None:
    assert set(TOPICS) == set(KINDS)
    assert [topic for topic, _, retained in topics("rig") if retained] == ["rig/online", "rig/state"]
