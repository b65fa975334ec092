"""Check of every plant component that a press file names: the gate's controller and the outlets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight_line.plant.gate.gate import exchange_s, try_controller
from prooflight_line.plant.gate.log import PlantError
from prooflight_line.plant.gate.registers import PlcStatus
from prooflight_line.plant.outlets.configured import outlets_of
from prooflight_line.plant.outlets.outlet import check

if TYPE_CHECKING:
    from prooflight.press.gate import GateSettings
    from prooflight.press.press_file import PressFile


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
