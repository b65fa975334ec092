"""Write the reference's pages on the plant: ``python -m docs.generators.plant`` in the root of the repository."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from docs.generators.outlets import outlets_page
from docs.generators.registers import register_page

from prooflight.files.atomic import whole_file
from prooflight_line.plant.events import BODIES, KINDS, schema

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

INTRODUCTION = """# Events for the plant

[Report results to the plant](../how-to/plant.md) describes how to configure outlets. This page is generated from the
code by `python -m docs.generators.plant`.

## Events

All outlets receive one stream of events. An event is JSON that follows the published schema
[events.schema.json](events.schema.json). Every field is always present; a number that is not known is `null`.
"""
NUMBERS = """
Each process begins a new stream, in which the numbers increase by one. A consumer of all kinds of events that detects a
gap has lost events. If Prooflight dropped them itself, `events-lost` states how many and which, and has the number of
the last of them. Events that were not acknowledged are sent again, so an event may arrive twice: `stream` and `number`
together are its key.

The field `event` of `body` names the kind of event and determines its other fields:
"""


def pages() -> Mapping[str, str]:
    """Return the text of each file, by its name under docs/reference."""
    return {
        "events.schema.json": json.dumps(schema(), indent=2) + "\n",
        "outlets.md": outlets_page(),
        "plant.md": _page(),
        "registers.md": register_page(),
    }


def write(folder: Path) -> None:
    """Write all generated files."""
    for name, text in pages().items():
        with whole_file(folder / name) as unfinished:
            unfinished.write_text(text, encoding="utf-8")


def _page() -> str:
    from prooflight_line.plant import run_messages
    from prooflight_line.plant.outlets import (
        mqtt,
        opcua,
        opcua_corrections,
        opcua_types,
        posting,
        webhook,
        xjmf_messages,
    )

    document = schema()
    parts: dict[str, Any] = document["$defs"]
    shared = {"Place", "Box", "OnSheet", "InkFound", "IncidentFacts", "Growth"}
    text = [INTRODUCTION, _fields(document), NUMBERS]
    for kind, body in zip(KINDS, BODIES, strict=True):
        part = parts[body.__name__]
        text += [f"### {kind}\n\n{part['description']}\n", _fields(part, but=("event",))]
    text.append("### Parts of events\n")
    for name in sorted(shared):
        text += [f"**{name}.** {parts[name]['description']}\n", _fields(parts[name])]
    rows = [(f"`{topic}`", what, "yes" if kept else "no") for topic, what, kept in mqtt.topics()]
    text += [
        "## MQTT\n",
        "All messages are sent with QoS 1.\n",
        _table(("topic", "content", "retained"), rows),
    ]
    headers = [
        (f"`{webhook.TIMESTAMP}`", "Time of sending, in seconds since 1970."),
        (
            f"`{webhook.SIGNATURE}`",
            "`v1=` and the HMAC-SHA256 of time, full stop and body, in hexadecimal digits.",
        ),
        (f"`{webhook.KEY}`", "`STREAM-NUMBER`, which stays the same if an event is posted again."),
    ]
    refused = ", ".join(map(str, sorted(posting.REFUSED)))
    text += ["## Webhook\n", _table(("header", "content"), headers)]
    text.append(
        f"An answer 2xx accepts an event; {refused} refuse it permanently; after any other it is posted again.\n"
    )
    details = [(f"`{kind}`", f"`{name}`") for kind, name in xjmf_messages.DETAILS.items()]
    text += [
        "## XJMF\n",
        f"Namespace `{xjmf_messages.NAMESPACE}`, version {xjmf_messages.VERSION}. If sheets have two sides,"
        " `Part` has a `Side`, a `Defect` has it as its `Face`, and `DescriptiveName` states sheet, copy and set."
        " `Passed` is 1 only for a sheet that is accepted. A `Comment` states the disposition of the sheet and the rule"
        " that decided it. A sheet that has passed the gate is reported as a `SignalNotification`. A `Defect` has the"
        " `DefectType` `ImageDefect` and one of these `DefectTypeDetails`:\n",
        _table(("kind", "`DefectTypeDetails`"), details),
        "`run package` writes the result of a completed run as one message. Its `SignalStatus` has a `JobPhase` with"
        " the times and totals of the run. Its `SignalResource` has a `Component` for each sheet of the job: `Amount`"
        " counts the copies that were judged good and accepted, and `Waste` all other printed copies, with `PartWaste`"
        f" by `WasteDetails`: {', '.join(f'`{name}`' for name in run_messages.WASTE)}. `JobID` is that of the job's"
        " ticket, or the name of its file. `JobPartID` is `run-N`. `run reprint-job` writes an XJDF with the same"
        " `JobID` and the `JobPartID` `reprint-of-run-N`.\n",
    ]
    states = [(phase, *(one or "" for one in state)) for phase, state in opcua.OF_PRESS.items()]
    text += [
        "## OPC UA\n",
        f"Namespace `{opcua_types.NAMESPACE}` (OPC 40100-1). Under Objects there is a `VisionSystemType` with the"
        " name of the press. It has `VisionStateMachine` with its `AutomaticModeStateMachine`, and"
        " `ResultManagement/Results/ResultVariable`.\n",
        _table(("press", "VisionStateMachine", "AutomaticModeStateMachine"), states),
        "If a camera is away or silent during a run, the state is Error. When Prooflight ends, the state is Halted.\n",
        "`ResultReadyEventType` is emitted for every sheet, `StateChangedEventType` at each change of state, and"
        " `VisionInformationEventType` for incidents, for sheets that have passed the gate (`CausePath` `Gate/SHEET`),"
        " and if inspection cannot keep up with the press (`Inspection`). The value of `ResultVariable` is the"
        " disposition of the last sheet. A result has these fields:\n",
        _table(("field", "type"), [(f"`{name}`", _type(kind)) for name, kind in opcua_types.RESULT_FIELDS]),
        f"`ResultState` is {opcua_types.COMPLETED} (completed) or, for a sheet that was not inspected,"
        f" {opcua_types.ABORTED} (aborted). `ResultContent` is the event as JSON. `IsSimulated` is true for the"
        " simulated drum. [Messages of each outlet](outlets.md) lists every kind of sheet.\n",
        f"Under the press there is also `Corrections`, in the namespace `{opcua_corrections.URI}`. It has an object for"
        " the density (`gain-INK`) and each register (`register-INK-x`, across, and `-y`, along) of an ink, with the"
        " offset that `run corrections` proposes. Prooflight applies none of them. `Offset` is 0 if the deviation is"
        " not significant. `Sheets` is the number of measured sheets, or 0 if they were too few; `FirstSheet` and"
        " `LastSheet` name the first and the last of them.\n",
        _table(("variable", "type"), [(f"`{name}`", _type(kind)) for name, kind in opcua_corrections.FIELDS]),
    ]
    return "\n".join(_wrapped(part) for part in text)


def _wrapped(part: str) -> str:
    """Wrap a paragraph of prose; tables, headings and texts of several paragraphs stay as they are."""
    if not part or part.startswith(("|", "#")) or "\n\n" in part:
        return part
    return textwrap.fill(part, 120, break_long_words=False, break_on_hyphens=False) + "\n"


def _fields(part: Mapping[str, Any], *, but: Sequence[str] = ()) -> str:
    rows = [
        (f"`{name}`", _kind(field_schema), " ".join(field_schema.get("description", "").split()))
        for name, field_schema in part["properties"].items()
        if name not in but
    ]
    return _table(("field", "type", "meaning"), rows) if rows else ""


def _kind(field_schema: Mapping[str, Any]) -> str:
    """Describe a type of the schema in words."""
    if "const" in field_schema:
        return f"`{field_schema['const']}`"
    if "enum" in field_schema:
        return ", ".join(f"`{one}`" for one in field_schema["enum"])
    if "$ref" in field_schema:
        return str(field_schema["$ref"]).rpartition("/")[2]
    if "anyOf" in field_schema:
        return " or ".join(_kind(one) for one in field_schema["anyOf"])
    if "oneOf" in field_schema:
        return "one of those below"
    match field_schema.get("type"):
        case "array":
            return f"list of {_kind(field_schema['items'])}"
        case "object":
            return f"by name: {_kind(field_schema['additionalProperties'])}"
        case "integer":
            return "whole number"
        case kind:
            return str(kind)


def _type(kind: Any) -> str:
    return f"`{kind if isinstance(kind, str) else kind.name}`"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines)


if __name__ == "__main__":
    write(Path("docs/reference"))
