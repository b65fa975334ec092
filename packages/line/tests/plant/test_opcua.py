"""OPC UA: a generic client browses what OPC 40100-1 names, and is told of results and states."""

from __future__ import annotations

import asyncio
import contextlib
import subprocess
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from asyncua import Client, ua
from hypothesis import given
from hypothesis import strategies as st
from packages.line.tests.plant.peers import free_port
from packages.line.tests.plant.runs import FACTS, GOOD, LONGEST_S, MISPRINT, Heard, outcome

from prooflight.detectors.verdict import Ink, Verdict
from prooflight_line.plant.events import parsed
from prooflight_line.plant.outlets import opcua_types as vision
from prooflight_line.plant.outlets.opcua import OF_PRESS, OpcUa, path
from prooflight_line.plant.outlets.opcua_corrections import FIELDS, URI
from prooflight_line.plant.outlets.outlet import Outlets, check
from prooflight_line.plant.stream import EventStream
from prooflight_line.run.notices import Notice

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
    from pathlib import Path


class Client40100:
    """A generic client that knows the companion specification's names, and nothing of Prooflight."""

    def __init__(self, client: Client, index: int) -> None:
        self.client, self.index = client, index
        self.heard: asyncio.Queue[Any] = asyncio.Queue()

    async def child(self, *names: str) -> Any:
        return await self.client.nodes.objects.get_child([f"{self.index}:{name}" for name in ("rig", *names)])

    async def state(self) -> tuple[str, str]:
        found = []
        for machine in (("VisionStateMachine",), ("VisionStateMachine", "AutomaticModeStateMachine")):
            node = await (await self.child(*machine)).get_child("0:CurrentState")
            found.append((await node.read_value()).Text or "")
        return found[0], found[1]

    async def subscribe(self, *names: str) -> None:
        types = [
            await self.client.nodes.base_event_type.get_child(
                [base if ":" in base else f"{self.index}:{base}" for base in name.split("/")]
            )
            for name in names
        ]

        class Handler:
            def event_notification(_, event: Any) -> None:
                self.heard.put_nowait(event)

        subscription = await self.client.create_subscription(20, Handler())
        await subscription.subscribe_events(await self.child(), types)

    async def next(self) -> Any:
        return await asyncio.wait_for(self.heard.get(), LONGEST_S)


RESULT = "0:TransitionEventType/ResultReadyEventType"
STATE = "0:TransitionEventType/VisionEventType/StateChangedEventType"
INCIDENT = "VisionInformationEventType"


@contextlib.asynccontextmanager
async def connected(url: str) -> AsyncIterator[Client40100]:
    async with Client(url) as client:
        await client.load_data_type_definitions()
        yield Client40100(client, await client.get_namespace_index(vision.NAMESPACE))


@contextlib.contextmanager
def served(**how: Any) -> Iterator[tuple[OpcUa, Outlets]]:
    said = Heard()
    outlet = OpcUa(host="127.0.0.1", port=free_port(), press="rig", **how)
    with Outlets([outlet], changed=said, close_s=LONGEST_S) as outlets:
        assert said.count(1)[0].connected, said.all
        yield outlet, outlets


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[OpcUa, Outlets]]:
    """One that all share who do not mind how the press stood before."""
    with served() as found:
        yield found


def asked(
    server: tuple[OpcUa, Outlets], work: Callable[[Client40100, EventStream], Coroutine[Any, Any, None]]
) -> None:
    """Do something as a client, with a run of its own."""
    outlet, outlets = server
    stream = EventStream([outlets.put], press="rig", run=3, clock=lambda: 1e9)

    async def ask() -> None:
        async with connected(outlet.url) as client:
            await work(client, stream)

    asyncio.run(ask())


def test_a_generic_client_browses_types_and_the_press(server: tuple[OpcUa, Outlets]) -> None:
    async def browse(client: Client40100, _: EventStream) -> None:
        press = await client.child()
        kind = client.client.get_node(await press.read_type_definition())
        assert (await kind.read_browse_name()).to_string() == f"{client.index}:VisionSystemType"
        assert kind.nodeid == ua.NodeId(1003, client.index)
        machine = await client.child("VisionStateMachine")
        machine_type = client.client.get_node(await machine.read_type_definition())
        names = {(await node.read_browse_name()).Name for node in await machine_type.get_children()}
        assert {*vision.VISION_STATES, *vision.VISION_TRANSITIONS, "AutomaticModeStateMachine"} <= names
        halted = await machine_type.get_child(f"{client.index}:Halted")
        assert await (await halted.get_child("0:StateNumber")).read_value() == 2
        way = await machine_type.get_child(f"{client.index}:ErrorToHaltedAuto")
        ends = [
            await way.get_referenced_nodes(refs) for refs in (ua.ObjectIds.FromState, ua.ObjectIds.ToState)
        ]
        assert [[(await node.read_browse_name()).Name for node in end] for end in ends] == [
            ["Error"],
            ["Halted"],
        ]
        result = await client.child("ResultManagement", "Results", "ResultVariable")
        assert {(await node.read_browse_name()).Name for node in await result.get_children()} == {
            name for name, _ in vision.RESULT_FIELDS
        }

    asked(server, browse)


def test_every_sheet_is_a_result_with_its_event_in_it(server: tuple[OpcUa, Outlets]) -> None:
    async def subscribe(client: Client40100, stream: EventStream) -> None:
        await client.subscribe(RESULT)
        stream.started(FACTS)
        stream.observe(outcome(0))
        stream.observe(outcome(1, MISPRINT))
        stream.observe(outcome(2, Verdict.skipped("p0003", "too many sheets were waiting for inspection")))
        found = [await client.next() for _ in range(3)]
        sheets = [parsed(one.ResultContent[0]) for one in found]
        assert [one.body.sheet for one in sheets] == [0, 1, 2]
        assert [one.ResultId.Id for one in found] == [one.key for one in sheets]
        assert [one.ResultState for one in found] == [vision.COMPLETED, vision.COMPLETED, vision.ABORTED]
        assert [one.Severity for one in found] == [100, 700, 700]
        bad = found[1]
        assert (bad.MeasId.Id, bad.PartId.Id, bad.JobId.Id) == ("1", "p0002", "3")
        assert (bad.MeasId.Description.Text, bad.PartId.Description.Text) == (
            "misprint, stop",
            MISPRINT.reason,
        )
        assert (bad.IsPartial, bad.IsSimulated, bad.SourceName) == (False, True, "rig")
        assert bad.ProcessingTimes.ProcessingDuration == 12.3
        assert bad.CreationTime.timestamp() == 1e9
        last = await client.child("ResultManagement", "Results", "ResultVariable", "ResultContent")
        assert parsed((await last.read_value())[0]) == sheets[2]

    asked(server, subscribe)


def test_corrections_are_offered_and_nobody_can_write_them(server: tuple[OpcUa, Outlets]) -> None:
    def printed(n: int) -> Verdict:
        ink = Ink(gain_percent=5.0 + 2 * (n % 2), dot_gain_percent=0.0, register_mm=(0.0, 0.1 * (-1) ** n))
        return replace(GOOD, inks={"K": ink})

    async def read(client: Client40100, stream: EventStream) -> None:
        index = await client.client.get_namespace_index(URI)

        async def offer(channel: str) -> dict[str, Any]:
            node = await (await client.child()).get_child([f"{index}:Corrections", f"{index}:{channel}"])
            return {
                field: await (await node.get_child(f"{index}:{field}")).read_value() for field, _ in FIELDS
            }

        await client.subscribe(RESULT)
        stream.started(FACTS)
        for n in range(30):
            stream.observe(outcome(n, printed(n)))
        for _ in range(30):
            await client.next()
        density = await offer("gain-black")
        assert (density["Deviation"], density["Offset"]) == pytest.approx((6.0, -3.0))
        assert density["StandardDeviation"] == pytest.approx(2 / np.sqrt(2) / np.sqrt(20))
        facts = {name: density[name] for name in ("Unit", "Sheets", "FirstSheet", "LastSheet")}
        assert facts == {"Unit": "%", "Sheets": 20, "FirstSheet": 10, "LastSheet": 29}
        assert (await offer("register-black-y"))["Offset"] == 0  # its deviation is not sure
        assert (await offer("gain-cyan"))["Sheets"] == 0  # nothing of it was measured
        node = await (await client.child()).get_child(
            [f"{index}:Corrections", f"{index}:gain-black", f"{index}:Offset"]
        )
        with pytest.raises(ua.UaStatusCodeError):
            await node.write_value(1.0)
        stream.started(FACTS)
        stream.observe(outcome(30, printed(0)))
        await client.next()
        assert (await offer("gain-black"))["Sheets"] == 0  # a run begins without an offer

    asked(server, read)


def test_the_state_machine_follows_the_press() -> None:
    async def follow(client: Client40100, stream: EventStream) -> None:
        assert await client.state() == ("Preoperational", "")
        await client.subscribe(STATE)
        told = [
            (lambda: stream.state("press", "preparing"), ("Operational", "Initialized")),
            (lambda: stream.state("press", "inspecting"), ("Operational", "ContinuousExecution")),
            (lambda: stream.noticed(Notice(kind="camera-away", text="it is gone")), ("Error", "")),
            (
                lambda: stream.noticed(Notice(kind="camera-back", text="it is back")),
                ("Operational", "ContinuousExecution"),
            ),
            (lambda: stream.state("press", "draining"), ("Operational", "Ready")),
            (lambda: stream.state("press", "fault"), ("Error", "")),
        ]
        stream.started(FACTS)
        first = await client.next()  # a run has begun, and nobody has said how the press stands
        assert first.ToState.Text == "Operational (ContinuousExecution)"
        for say, expected in told:
            say()
            event = await client.next()
            assert await client.state() == expected
            assert event.ToState.Text.startswith(expected[0])
            assert event.Severity == (700 if expected[0] == "Error" else 100)
        last = await (await client.child("VisionStateMachine")).get_child("0:LastTransition")
        assert (await last.read_value()).Text == "OperationalToErrorAuto"

    with served() as fresh:
        asked(fresh, follow)


def test_incidents_are_told_once_they_are_news(server: tuple[OpcUa, Outlets]) -> None:
    async def subscribe(client: Client40100, stream: EventStream) -> None:
        await client.subscribe(INCIDENT)
        for n in range(4):
            stream.observe(outcome(n, MISPRINT))
        for n in range(4, 40):
            stream.observe(outcome(n, GOOD))
        found = [await client.next() for _ in range(4)]
        assert [one.Message.Text for one in found] == [
            "incident opened: streak, 120 mm from the left, along the travel, 1 sheet",
            "incident changed: streak, 120 mm from the left, along the travel, 2 sheets",
            "incident changed: streak, 120 mm from the left, along the travel, 4 sheets",
            "incident ended: streak, 120 mm from the left, along the travel, 4 sheets",
        ]
        assert {one.CausePath for one in found} == {"Incident/1"}

    asked(server, subscribe)


def test_two_servers_of_one_process_both_tell_results(server: tuple[OpcUa, Outlets]) -> None:
    """As where one is started again."""

    async def subscribe(client: Client40100, stream: EventStream) -> None:
        await client.subscribe(RESULT)
        stream.observe(outcome(0))
        assert (await client.next()).MeasId.Id == "0"

    asked(server, subscribe)
    with served() as other:
        asked(other, subscribe)
    asked(server, subscribe)


def test_nobody_can_write(server: tuple[OpcUa, Outlets]) -> None:
    async def write(client: Client40100, _: EventStream) -> None:
        node = await (await client.child("VisionStateMachine")).get_child("0:CurrentState")
        with pytest.raises(ua.UaStatusCodeError):
            await node.write_value(ua.LocalizedText("Halted"))
        with pytest.raises(ua.UaStatusCodeError):
            await client.client.nodes.objects.add_object(client.index, "mine")

    asked(server, write)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    for name, uri in (("server", "urn:prooflight:opcua"), ("client", "urn:somebody")):
        subject = ("-subj", f"/CN={name}", "-addext", f"subjectAltName=URI:{uri},DNS:localhost")
        usage = ("-addext", "keyUsage=digitalSignature,nonRepudiation,keyEncipherment,dataEncipherment")
        files = ("-keyout", f"{name}-key.pem", "-out", f"{name}.pem", "-days", "2")
        subprocess.run(
            ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", *files, *subject, *usage],
            cwd=folder,
            check=True,
            capture_output=True,
        )
    return folder


@pytest.fixture(scope="module")
def guarded(certificates: Path) -> Iterator[OpcUa]:
    how = {"certificate": certificates / "server.pem", "key": certificates / "server-key.pem"}
    with served(**how, anonymous=False, user="plant", password="ink") as (outlet, _):
        yield outlet


@pytest.mark.parametrize(
    ("user", "password", "encrypted", "welcome"),
    [
        ("plant", "ink", True, True),
        ("plant", "water", True, False),
        ("nobody", "ink", True, False),
        (None, None, True, False),
        ("plant", "ink", False, False),
        (None, None, False, False),
    ],
)
def test_with_a_certificate_all_is_encrypted_and_users_are_asked(
    certificates: Path, guarded: OpcUa, user: str | None, password: str | None, encrypted: bool, welcome: bool
) -> None:
    async def come() -> str:
        client = Client(guarded.url)
        if encrypted:
            names = ",".join(str(certificates / name) for name in ("client.pem", "client-key.pem"))
            await client.set_security_string(f"Basic256Sha256,SignAndEncrypt,{names}")
        if user is not None:
            client.set_user(user)
            client.set_password(password or "")
        async with client:
            return ",".join(await client.get_namespace_array())

    assert "ink" not in repr(guarded)
    if welcome:
        assert vision.NAMESPACE in asyncio.run(come())
    else:
        with pytest.raises((ua.UaError, ConnectionError)):
            asyncio.run(come())


def test_checking_says_whether_address_and_certificate_can_be_used(
    server: tuple[OpcUa, Outlets], certificates: Path, tmp_path: Path
) -> None:
    free = OpcUa(host="127.0.0.1", port=free_port(), press="rig")
    assert check(free, within_s=LONGEST_S).ok
    taken = check(OpcUa(host="127.0.0.1", port=server[0].port, press="rig"), within_s=LONGEST_S)
    assert (taken.ok, taken.answer) == (False, "Address already in use")
    gone = OpcUa(
        host="127.0.0.1",
        port=free_port(),
        press="rig",
        certificate=tmp_path / "no.pem",
        key=certificates / "server-key.pem",
    )
    found = check(gone, within_s=LONGEST_S)
    assert (found.ok, found.answer) == (False, "No such file or directory")


@given(st.lists(st.sampled_from([*OF_PRESS.values(), ("Halted", None)]), min_size=2, max_size=6))
def test_every_way_leads_by_transitions_of_the_specification(ways: list[tuple[str, str | None]]) -> None:
    for (start, _), (end, _) in pairwise(ways):
        here = start
        for step in path(start, end, vision.VISION_TRANSITIONS):
            assert step.by == f"{here}To{step.to}Auto"
            here = step.to
        assert here == end
