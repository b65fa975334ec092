"""OPC UA outlet: a server after OPC 40100-1, Machine Vision, for the press's state and the results.

Under Objects is one ``VisionSystemType`` by the press's name. Its state machine follows the press, and for
every sheet it emits a ``ResultReadyEventType`` whose ``ResultContent`` is the event in JSON of the published
schema.

    run: waiting                Preoperational
         preparing              Operational, Initialized
         draining, or over      Operational, Ready
         inspecting             Operational, ContinuousExecution
    camera away or silent       Error
    run at fault                Error
    Prooflight ends             Halted
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import logging
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Final

from asyncua import ua
from asyncua.common.instantiate_util import instantiate
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.crypto.uacrypto import load_certificate, load_private_key
from asyncua.server.server import Server
from asyncua.server.user_managers import UserManager
from asyncua.ua.object_ids import ObjectIds

from prooflight import __version__
from prooflight_line.plant.events import (
    IncidentChanged,
    IncidentEnded,
    IncidentOpened,
    RunStarted,
    SheetAtGate,
    SheetJudged,
    StateChanged,
)
from prooflight_line.plant.outlets import opcua_types as vision
from prooflight_line.plant.outlets.opcua_corrections import OfferedCorrections
from prooflight_line.plant.state import PlantState

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from asyncua.common.node import Node

    from prooflight_line.plant.events import Event
    from prooflight_line.plant.outlets.opcua_types import VisionTypes
    from prooflight_line.plant.outlets.outbox import Outbox

# It warns of certificates and revised settings at every start, and logs each client that leaves; errors are raised.
logging.getLogger("asyncua").setLevel(logging.CRITICAL)

URI: Final = "urn:prooflight:opcua"
SECURE: Final = (
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
)
LOW, HIGH = 100, 700
"""Severities, in 1 to 1000, of events that are good and of all others."""
OF_PRESS: Final = {
    "waiting": ("Preoperational", None),
    "preparing": ("Operational", "Initialized"),
    "inspecting": ("Operational", "ContinuousExecution"),
    "draining": ("Operational", "Ready"),
    "stopped": ("Operational", "Ready"),
    "fault": ("Error", None),
}
"""State of the vision system and of its automatic mode, by the press's phase."""


def states_of(state: PlantState) -> tuple[str, str | None]:
    """Return the state of the vision system and of its automatic mode; None: it is in none."""
    if state.states.get("camera") in ("away", "silent") and state.running:
        return "Error", None
    phase = state.states.get("press")
    if phase in OF_PRESS:
        return OF_PRESS[phase]
    if state.ending == "fault":
        return "Error", None
    if state.running:
        return "Operational", "ContinuousExecution"
    return ("Preoperational", None) if state.ending is None else ("Operational", "Ready")


def result_state(sheet: SheetJudged) -> int:
    """Return the ``ResultState`` of a sheet: completed, or aborted if it was not inspected."""
    return vision.COMPLETED if sheet.verdict != "not-inspected" else vision.ABORTED


def severity(sheet: SheetJudged) -> int:
    """Return the severity of the event of a sheet: high if it alarms or is not accepted."""
    return LOW if sheet.incident is None and sheet.disposition == "accept" else HIGH


@dataclass(slots=True, kw_only=True)
class OpcUa:
    """A server at one address."""

    host: str
    port: int
    press: str
    certificate: Path | None = None
    """File of the certificate; None: nothing is encrypted, for clients on this machine only."""
    key: Path | None = None
    anonymous: bool = True
    user: str | None = None
    password: str | None = field(default=None, repr=False)
    state: PlantState = field(default=PlantState(), init=False, repr=False)

    @property
    def name(self) -> str:
        """Name of the outlet, for people."""
        return f"OPC UA at {self.url}"

    @property
    def url(self) -> str:
        """Address to which clients connect."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"opc.tcp://{host}:{self.port}/prooflight"

    async def run(self, outbox: Outbox) -> None:
        """Serve the events; see ``Outlet``."""
        async with self._server() as server:
            types = await vision.build(server)
            system = await VisionSystem.begin(server, types, self.press)
            await server.start()
            try:
                outbox.up(self.url)
                await system.follow(self.state)
                while (event := await outbox.head()) is not None:
                    self.state = self.state.after(event)
                    await system.follow(self.state)
                    await system.tell(event, self.state)
                    outbox.delivered(event)
                await system.enter("Halted", None)
            finally:
                await server.stop()

    async def reach(self) -> str:
        """Check whether address, certificate and key can be used; see ``Outlet``."""
        if self.certificate is not None and self.key is not None:
            await load_certificate(self.certificate.read_bytes(), _format(self.certificate))
            await load_private_key(self.key.read_bytes(), extension=_format(self.key))
        listening = await asyncio.start_server(lambda _, writer: writer.close(), self.host, self.port)
        listening.close()
        return f"{self.host}:{self.port} is free to listen at"

    @contextlib.asynccontextmanager
    async def _server(self) -> Any:
        server = Server(user_manager=_Users(self.user, self.password, anonymous=self.anonymous))
        await server.init()
        server.set_endpoint(self.url)
        server.set_server_name(f"Prooflight {self.press}")
        await server.set_application_uri(URI)
        now = datetime.now(UTC)
        await server.set_build_info(
            product_uri=URI,
            manufacturer_name="Prooflight",
            product_name="Prooflight",
            software_version=__version__,
            build_number=__version__,
            build_date=now,
        )
        tokens: list[type] = [ua.AnonymousIdentityToken] if self.anonymous else []
        server.set_identity_tokens([*tokens, *([ua.UserNameIdentityToken] if self.user else [])])
        if self.certificate is None or self.key is None:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        else:
            server.set_security_policy(list(SECURE))
            await server.load_certificate(self.certificate.read_bytes(), format=_format(self.certificate))
            await server.load_private_key(self.key.read_bytes(), format=_format(self.key))
        yield server


class VisionSystem:
    """The press's ``VisionSystemType`` object."""

    def __init__(
        self,
        server: Server,
        types: VisionTypes,
        generators: dict[str, Any],
        nodes: dict[str, Node],
        corrections: OfferedCorrections,
    ) -> None:
        self._server, self._types, self._generators, self._nodes = server, types, generators, nodes
        self._corrections = corrections
        self._now: tuple[str, str | None] = ("", None)

    @classmethod
    async def begin(cls, server: Server, types: VisionTypes, press: str) -> VisionSystem:
        """Add the object under Objects."""
        index, kinds = types.index, types.nodes
        system = await server.nodes.objects.add_object(
            index, press, objecttype=kinds["VisionSystemType"].nodeid
        )
        machine = await system.get_child(f"{index}:VisionStateMachine")
        automatic = await machine.get_child(f"{index}:AutomaticModeStateMachine")
        results = await system.get_child([f"{index}:ResultManagement", f"{index}:Results"])
        last, *_ = await instantiate(
            results,
            kinds["ResultType"],
            bname=ua.QualifiedName("ResultVariable", index),
            dname=ua.LocalizedText("ResultVariable"),
            idx=index,
        )
        nodes = {"machine": machine, "automatic": automatic, "last": last}
        for name, _ in vision.RESULT_FIELDS:
            nodes[name] = await last.get_child(f"{index}:{name}")
        generators = {
            name: await server.get_event_generator(kinds[name], emitting_node=system.nodeid)
            for name in ("StateChangedEventType", "ResultReadyEventType", "VisionInformationEventType")
        }
        await server.nodes.server.add_reference(system, ObjectIds.HasNotifier, bidirectional=False)
        corrections = await OfferedCorrections.begin(server, system)
        vision_system = cls(server, types, generators, nodes, corrections)
        await vision_system.enter("Preoperational", None)
        await vision_system._write_state("automatic", "VisionAutomaticModeStateMachineType", Step(to=""))
        return vision_system

    async def follow(self, state: PlantState) -> None:
        """Set the state of the vision system to that of the press."""
        await self.enter(*states_of(state))

    async def enter(self, state: str, mode: str | None) -> None:
        """Go to a state and to one of its automatic mode, by the available transitions."""
        was, was_mode = self._now
        for step in path(was, state, vision.VISION_TRANSITIONS):
            await self._write_state("machine", "VisionStateMachineType", step)
        if mode != was_mode:
            start = was_mode
            if start is None:
                start = vision.AUTOMATIC_STATES[0]
                await self._write_state("automatic", "VisionAutomaticModeStateMachineType", Step(to=start))
            steps = [Step(to="")] if mode is None else path(start, mode, vision.AUTOMATIC_TRANSITIONS)
            for step in steps:
                await self._write_state("automatic", "VisionAutomaticModeStateMachineType", step)
        self._now = state, mode
        if was and (was, was_mode) != self._now:
            generator = self._generators["StateChangedEventType"]
            generator.event.FromState = ua.LocalizedText(_worded((was, was_mode)))
            generator.event.ToState = ua.LocalizedText(_worded(self._now))
            generator.event.Severity = HIGH if state == "Error" else LOW
            await generator.trigger(message=f"{_worded((was, was_mode))} to {_worded(self._now)}")

    async def tell(self, event: Event, state: PlantState) -> None:
        """Emit the events to which clients subscribe."""
        match event.body:
            case RunStarted() as started:
                await self._corrections.note(started)
            case SheetJudged() as sheet:
                await self._corrections.note(sheet)
                await self._result(event, sheet, state)
            case SheetAtGate() as passed:
                generator = self._generators["VisionInformationEventType"]
                generator.event.CausePath = f"Gate/{passed.sheet}"
                generator.event.Severity = LOW if passed.tray == "good" else HIGH
                text = f"sheet {passed.sheet} at the gate: {passed.disposition}, {passed.code}, tray {passed.tray}"
                await generator.trigger(_moment(event.time_s), text)
            case StateChanged(of="inspection", state=inspection, detail=detail):
                generator = self._generators["VisionInformationEventType"]
                generator.event.CausePath = "Inspection"
                generator.event.Severity = HIGH if inspection == "overloaded" else LOW
                await generator.trigger(_moment(event.time_s), detail)
            case (
                IncidentOpened(incident=incident)
                | IncidentChanged(incident=incident)
                | IncidentEnded(incident=incident)
            ):
                generator = self._generators["VisionInformationEventType"]
                generator.event.CausePath = f"Incident/{incident.number}"
                generator.event.Severity = LOW if isinstance(event.body, IncidentEnded) else HIGH
                what = event.kind.replace("-", " ")
                where = f", {incident.where}" if incident.where else ""
                sheets = "1 sheet" if incident.count == 1 else f"{incident.count:,} sheets"
                await generator.trigger(_moment(event.time_s), f"{what}: {incident.kind}{where}, {sheets}")

    async def _result(self, event: Event, sheet: SheetJudged, state: PlantState) -> None:
        structures = self._types.structures
        ended = _moment(event.time_s)
        took = timedelta(milliseconds=sheet.latency_ms or 0.0)
        identity = structures["ResultIdDataType"](Id=event.key)
        values: dict[str, Any] = {
            "ResultId": identity,
            "IsPartial": False,
            "IsSimulated": state.simulated,
            "ResultState": result_state(sheet),
            "MeasId": structures["MeasIdDataType"](
                Id=str(sheet.sheet), Description=ua.LocalizedText(f"{sheet.verdict}, {sheet.disposition}")
            ),
            "PartId": structures["PartIdDataType"](Id=sheet.page, Description=ua.LocalizedText(sheet.reason)),
            "JobId": structures["JobIdDataType"](
                Id=str(state.run or 0), Description=ua.LocalizedText(state.job)
            ),
            "CreationTime": ended,
            "ProcessingTimes": structures["ProcessingTimesDataType"](
                StartTime=ended - took,
                EndTime=ended,
                AcquisitionDuration=0.0,
                ProcessingDuration=sheet.latency_ms or 0.0,
            ),
            "ResultContent": [event.json()],
        }
        generator = self._generators["ResultReadyEventType"]
        for name, kind in vision.RESULT_FIELDS:
            setattr(generator.event, name, values[name])
            variant = kind if isinstance(kind, ua.VariantType) else ua.VariantType.ExtensionObject
            await self._write(name, ua.Variant(values[name], variant))
        await self._write("last", ua.Variant(sheet.disposition, ua.VariantType.String))
        generator.event.Severity = severity(sheet)
        await generator.trigger(ended, f"sheet {sheet.sheet}: {sheet.verdict}, {sheet.disposition}")

    async def _write(self, node: str, value: ua.Variant) -> None:
        await self._server.write_attribute_value(self._nodes[node].nodeid, ua.DataValue(value))

    async def _write_state(self, machine: str, type_name: str, step: Step) -> None:
        written = (("CurrentState", step.to), ("LastTransition", step.by))
        for variable, name in written:
            if name is None:
                continue
            node = await self._nodes[machine].get_child(f"0:{variable}")
            await node.write_value(ua.LocalizedText(name))
            kind = self._types.nodes.get(f"{type_name}.{name}")
            identity = ua.NodeId() if kind is None else kind.nodeid
            await (await node.get_child("0:Id")).write_value(ua.Variant(identity, ua.VariantType.NodeId))


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step of a state machine."""

    to: str
    """State that the step enters; empty: none."""
    by: str | None = None
    """Transition of the step; None: there is none, as when a machine begins."""


def path(start: str, end: str, transitions: Sequence[str]) -> list[Step]:
    """Return the shortest path from a state to another; with ``start`` empty, the machine begins in ``end``.

    >>> [step.to for step in path("Initialized", "ContinuousExecution", vision.AUTOMATIC_TRANSITIONS)]
    ['Ready', 'ContinuousExecution']
    """
    if not start:
        return [Step(to=end)]
    ways: dict[str, list[Step]] = {start: []}
    waiting = [start]
    while waiting and end not in ways:
        here = waiting.pop(0)
        for transition in transitions:
            one, other = transition.removesuffix("Auto").split("To")
            if one == here and other not in ways:
                ways[other] = [*ways[here], Step(to=other, by=transition)]
                waiting.append(other)
    return ways[end]


class _Users(UserManager):
    """Users who may read; no user may write."""

    def __init__(self, user: str | None, password: str | None, *, anonymous: bool) -> None:
        self._user, self._password, self._anonymous = user, password, anonymous

    def get_user(
        self,
        iserver: object,
        username: str | None = None,
        password: str | None = None,
        certificate: object = None,
    ) -> User | None:
        """Return the user; None refuses. See ``asyncua.server.user_managers.UserManager``."""
        if username is None:
            return User(role=UserRole.User, name="anonymous") if self._anonymous else None
        expected = self._password
        if expected is None or password is None or username != self._user:
            return None
        if hmac.compare_digest(password.encode(), expected.encode()):
            return User(role=UserRole.User, name=username)
        return None


def _format(file: Path) -> str:
    """Return the format of a certificate or a key; OSError if it cannot be read."""
    return "pem" if file.read_bytes().startswith(b"-----BEGIN") else "der"


def _worded(state: tuple[str, str | None]) -> str:
    return state[0] if state[1] is None else f"{state[0]} ({state[1]})"


def _moment(time_s: float) -> datetime:
    return datetime.fromtimestamp(time_s, UTC)
