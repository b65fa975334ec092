"""Construction of the outlets that a press file configures, and the check of every component of its plant."""

from __future__ import annotations

import ssl
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.errors import PressFileError, RequestError
from prooflight.press.outlets import LEAST_SECRET, address, secret
from prooflight_line.plant.gate.gate import exchange_s, try_controller
from prooflight_line.plant.gate.log import PlantError
from prooflight_line.plant.gate.registers import PlcStatus
from prooflight_line.plant.outlets.outlet import check

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.gate import GateSettings
    from prooflight.press.outlets import MqttBlock, OpcuaBlock, WebhookBlock, XjmfBlock
    from prooflight.press.press_file import PressFile
    from prooflight_line.plant.outlets.outlet import Outlet

REMEDY: Final = "install prooflight-line[plant]"


def outlets_of(file: PressFile, press: str | None = None) -> list[Outlet]:
    """Return all outlets of ``[plant]``, not yet connected.

    ``press`` is the name of the press in the events; None: that of the press file, where there is no run.

    PressFileError: a secret or a certificate is not available. RequestError: a library of the extra ``plant``
    is not installed.
    """
    plant, path = file.plant, file.path
    name = file.name if press is None else press
    outlets: list[Outlet] = []
    try:
        if plant.mqtt is not None:
            outlets.append(_mqtt(plant.mqtt, path, name))
        for number, block in enumerate(plant.webhook, start=1):
            outlets.append(_webhook(block, path, f"plant.webhook.{number}"))
        if plant.xjmf is not None:
            outlets += _xjmf(plant.xjmf, path)
        if plant.opcua is not None:
            outlets.append(_opcua(plant.opcua, path, name))
    except ModuleNotFoundError as error:
        raise RequestError("plant", f"{error.name} is not installed", remedy=REMEDY) from error
    return outlets


def _mqtt(block: MqttBlock, path: Path, press: str) -> Outlet:
    from prooflight_line.plant.outlets.mqtt import Mqtt

    return Mqtt(
        host=block.host,
        port=block.port or (8883 if block.tls else 1883),
        topic=block.topic or f"prooflight/{_level(press)}",
        client_id=block.client_id,
        user=block.user,
        password=secret(path, "plant.mqtt", block, "password"),
        tls=_trust(path, "plant.mqtt", block.ca_file) if block.tls else None,
        keepalive_s=block.keepalive_s,
    )


def _webhook(block: WebhookBlock, path: Path, where: str) -> Outlet:
    from prooflight_line.plant.outlets.webhook import Webhook

    key = secret(path, where, block, "secret") or ""
    if len(key) < LEAST_SECRET:
        what = f"{where}: the secret has {len(key)} characters"
        raise PressFileError(
            path, what, remedy=f"take {LEAST_SECRET} or more, such as of `openssl rand -hex 16`"
        )
    return Webhook(
        url=block.url,
        secret=key.encode(),
        kinds=None if block.events is None else frozenset(block.events),
        tls=_trust(path, where, block.ca_file),
        timeout_s=block.timeout_s,
    )


def _xjmf(block: XjmfBlock, path: Path) -> list[Outlet]:
    from prooflight_line.plant.outlets.xjmf import XjmfAnswers, XjmfPush

    outlets: list[Outlet] = []
    if block.url is not None:
        outlets.append(
            XjmfPush(
                device_id=block.device_id,
                url=block.url,
                alarms_only=block.sheets == "alarms",
                tls=_trust(path, "plant.xjmf", block.ca_file),
                timeout_s=block.timeout_s,
            )
        )
    if block.listen is not None:
        host, port = address(block.listen)
        outlets.append(XjmfAnswers(device_id=block.device_id, host=host, port=port))
    return outlets


def _opcua(block: OpcuaBlock, path: Path, press: str) -> Outlet:
    from prooflight_line.plant.outlets.opcua import OpcUa

    host, port = address(block.listen)
    certificate, key = (
        None if name is None else path.parent / name for name in (block.certificate_file, block.key_file)
    )
    for name, file in (("certificate_file", certificate), ("key_file", key)):
        if file is not None and not file.is_file():
            what = f"plant.opcua.{name}: there is no file {file}"
            raise PressFileError(path, what, remedy="name a file next to the press file")
    return OpcUa(
        host=host,
        port=port,
        press=press,
        certificate=certificate,
        key=key,
        anonymous=block.anonymous,
        user=block.user,
        password=secret(path, "plant.opcua", block, "password"),
    )


def _trust(path: Path, where: str, ca_file: str | None) -> ssl.SSLContext:
    """Return the trusted authorities: those of a file, or the system's; PressFileError if the file has none."""
    try:
        return ssl.create_default_context(cafile=None if ca_file is None else str(path.parent / ca_file))
    except (OSError, ssl.SSLError) as error:
        what = f"{where}.ca_file: {ca_file} cannot be used"
        raise PressFileError(path, what, remedy="name a PEM file of authorities to trust") from error


def _level(name: str) -> str:
    """Return a name as one level of a topic."""
    return "".join("_" if one in "+#/\x00" else one for one in name) or "_"


# --- the check of every component ---


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Result of trying one component of the plant."""

    what: str
    where: str
    answers: bool
    says: str


def answers(plant: PressFile) -> list[Answer]:
    """Try each component that the press file names, and return one answer for each.

    A component that does not answer does not keep the others from being tried.
    """
    results = []
    settings = plant.gate_settings()
    if settings is not None:
        results.append(_of_gate(settings))
    for outlet in outlets_of(plant):
        tried = check(outlet)
        report = f"{tried.answer} ({tried.milliseconds:.0f} ms)"
        results.append(Answer(what="outlet", where=tried.name, answers=tried.ok, says=report))
    return results


def _of_gate(settings: GateSettings) -> Answer:
    what = f"gate ({settings.plc.style})"
    try:
        shown = try_controller(settings)
    except PlantError as error:
        return Answer(
            what=what, where=settings.plc.where, answers=False, says=f"{error.what}; {error.remedy}"
        )
    ms = f"a result takes {1e3 * exchange_s(settings):.0f} ms at most"
    if "coil" in shown:
        report = f"the output is {'on' if shown['coil'] else 'off'}; {ms}"
        return Answer(what=what, where=settings.plc.where, answers=True, says=report)
    status = PlcStatus(shown["plc_status"] & 7)
    ready = "ready" if PlcStatus.READY in status else "not ready"
    trays = f"{shown['in_good']:,} in the good tray, {shown['in_reject']:,} rejected"
    report = f"{ready}, encoder at {shown['encoder']:,}, {trays}; {ms}"
    return Answer(what=what, where=settings.plc.where, answers=True, says=report)
