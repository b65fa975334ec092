"""XJMF messages: verdicts as ``QualityControlResult`` of CIP4's XJDF 2.1, section 6 and its schema.

Lengths are points (1/72 inch), rectangles go from the lower left corner to the upper right one, origin at the
sheet's lower left. Names of sheets, jobs and devices are NMTOKENs there: other characters become underscores.
Severities are whole numbers from 0 to 100.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

from lxml import etree  # type: ignore[import-untyped]

from prooflight import __version__
from prooflight.cmyk import NAME_OF_INK
from prooflight_line.plant.events import EventsLost, SheetAtGate, SheetJudged

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight_line.plant.events import Box, Event, OnSheet

    _Element = Any

NAMESPACE: Final = "http://www.CIP4.org/JDFSchema_2_0"
VERSION: Final = "2.1"
"""Version of XJMF; it is the first with ``Inspection`` and ``Defect``."""
MIME: Final = "application/vnd.cip4-xjmf+xml"
POINTS_A_MM: Final = 72 / 25.4
RESOURCE: Final = "QualityControlResult"
DETAILS: Final = {
    "missing-plane": "MissingSeparation",
    "swapped-planes": "SwappedSeparations",
    "density": "InkDensity",
    "plane-register": "Registration",
    "streak": "Streak",
    "banding": "Banding",
    "spots-voids": "SpotOrVoid",
    "ghost-smear": "GhostOrSmear",
    "local-blur": "Blur",
    "missing-content": "MissingContent",
    "wrong-page": "WrongPage",
    "scum": "Scumming",
}
"""``DefectTypeDetails`` for each kind of misprint; CIP4 leaves the names open. Other kinds are given by
their own names."""
SURE_SIGMAS: Final = 20.0
"""Deviation of a region at which its severity is 100. assumed: good prints reach 5."""
MOST_DEFECTS: Final = 100
MOST_TEXT: Final = 2000
_NO_NAME = re.compile(r"[^\w.:-]", re.ASCII)
_NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
OK, NOT_XML, UNSUPPORTED, INVALID = 0, 3, 5, 6
"""Return codes, as JDF has had them since 1.0: success, unreadable, not implemented here, invalid parameters."""


def signals(
    events: Iterable[Event], *, device_id: str, job: str, sheet_mm: tuple[float, float] | None = None
) -> bytes:
    """Return one XJMF with a ``SignalResource`` for each ``sheet-judged`` among events.

    There must be at least one. ``sheet_mm`` is width and height; None: not known, and defects have no box.
    """
    sheets = [(event, event.body) for event in events if isinstance(event.body, SheetJudged)]
    if not sheets:
        message = "no sheet has a verdict"
        raise ValueError(message)
    root = root_of(device_id, sheets[-1][0].time_s)
    for event, sheet in sheets:
        signal = element(root, "SignalResource", ChannelMode="Reliable")
        header_of(signal, device_id, event.time_s, identifier=f"S-{event.key}")
        _resource_info(signal, [(event, sheet)], job, sheet_mm)
    return written(root)


def response(
    events: Iterable[Event],
    *,
    device_id: str,
    job: str,
    query_id: str | None,
    time_s: float,
    sheet_mm: tuple[float, float] | None = None,
) -> bytes:
    """Return the answer to a ``QueryResource``: the results of the last sheets.

    ``query_id`` is the identifier of the query.
    """
    root = root_of(device_id, time_s)
    answer = element(root, "ResponseResource", ReturnCode=str(OK))
    header_of(answer, device_id, time_s, query_id=query_id)
    sheets = [(event, event.body) for event in events if isinstance(event.body, SheetJudged)]
    _resource_info(answer, sheets, job, sheet_mm)
    return written(root)


def lost(event: Event, *, device_id: str) -> bytes:
    """Return a ``SignalNotification`` of an event ``events-lost``: some results were not delivered."""
    root = root_of(device_id, event.time_s)
    signal = element(root, "SignalNotification", ChannelMode="Reliable")
    header_of(signal, device_id, event.time_s, identifier=f"S-{event.key}")
    notification = element(signal, "Notification", Class="Warning")
    if isinstance(event.body, EventsLost):
        loss = event.body
        what = "1 message was lost" if loss.count == 1 else f"{loss.count:,} messages were lost"
        element(notification, "Comment").text = f"{what}, {loss.first} to {loss.last}"
    return written(root)


def at_gate(event: Event, passed: SheetAtGate, *, device_id: str) -> bytes:
    """Return a ``SignalNotification`` of a sheet that has passed the gate; a warning if its tray is not the
    decided one.
    """
    root = root_of(device_id, event.time_s)
    signal = element(root, "SignalNotification", ChannelMode="Reliable")
    header_of(signal, device_id, event.time_s, identifier=f"S-{event.key}")
    expected = "good" if passed.disposition == "accept" else "reject"
    note = element(signal, "Notification", Class="Event" if passed.tray == expected else "Warning")
    late = "" if passed.in_time else ", which came too late"
    element(
        note, "Comment"
    ).text = (
        f"sheet {passed.sheet} at the gate: {passed.disposition} ({passed.code}){late}; tray: {passed.tray}"
    )
    return written(root)


def offered(lines: Iterable[str], *, device_id: str, job: str, time_s: float) -> bytes:
    """Return a ``SignalNotification`` of corrections that are offered, a comment each; none is applied.

    XJMF has no resource for offsets of density and register, so that a person or a program of the plant decides.
    """
    root = root_of(device_id, time_s)
    signal = element(root, "SignalNotification", ChannelMode="Reliable")
    header_of(signal, device_id, time_s, identifier="S-corrections")
    note = element(signal, "Notification", Class="Information")
    for line in lines:
        element(note, "Comment").text = clean(f"offered for {job}, not applied: {line}")
    return written(root)


def refusal(kind: str, text: str, code: int, *, device_id: str, query_id: str | None, time_s: float) -> bytes:
    """Return the answer to a message that cannot be answered; ``kind`` is the message's, such as ``Resource``."""
    root = root_of(device_id, time_s)
    answer = element(root, f"Response{kind}", ReturnCode=str(code))
    header_of(answer, device_id, time_s, query_id=query_id)
    notification = element(answer, "Notification", Class="Error")
    element(notification, "Comment").text = clean(text)
    return written(root)


def written(root: _Element) -> bytes:
    """Return the message as it is sent."""
    text: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
    return text


def name(text: str) -> str:
    """Return the text as an NMTOKEN.

    >>> name("a brochure.pdf"), name("")
    ('a_brochure.pdf', '_')
    """
    return _NO_NAME.sub("_", text)[:200] or "_"


def clean(text: str) -> str:
    """Return the text without characters that XML does not allow."""
    return _NO_XML.sub("\ufffd", text)[:MOST_TEXT]


def severity(sheet: SheetJudged) -> int:
    """Return the severity of a sheet as a whole: 0 if it is good; for a misprint its probability in percent,
    at least 50.

    A sheet that was not inspected has no severity, and the function is not called for it.
    """
    if sheet.verdict == "good":
        return 0
    chance = 1.0 if sheet.probability is None else min(max(sheet.probability, 0.0), 1.0)
    return max(50, round(100 * chance))


def box_points(box: Box, height_mm: float) -> str:
    """Return lower left and upper right corner, from the sheet's lower left. [point]"""
    left, right = box.x_mm, box.x_mm + box.width_mm
    low, high = height_mm - box.y_mm - box.height_mm, height_mm - box.y_mm
    return " ".join(_number(POINTS_A_MM * one) for one in (left, low, right, high))


# --- parts ---


def _resource_info(
    above: _Element, sheets: list[tuple[Event, SheetJudged]], job: str, sheet_mm: tuple[float, float] | None
) -> None:
    info = element(above, "ResourceInfo", JobID=name(job), Scope="Job")
    resource_set = element(info, "ResourceSet", Name=RESOURCE, Usage="Output")
    for event, sheet in sheets:
        _sheet(resource_set, event, sheet, sheet_mm)
        for ink in sheet.inks:
            if ink.register_x_mm is not None and ink.register_y_mm is not None:
                resource = _resource(resource_set, sheet, Separation=NAME_OF_INK[ink.ink].capitalize())
                result = _result(resource, event, sheet)
                _registration(result, ink.register_x_mm, ink.register_y_mm, reference="Print")


def _sheet(above: _Element, event: Event, sheet: SheetJudged, sheet_mm: tuple[float, float] | None) -> None:
    resource = _resource(above, sheet)
    result = _result(resource, event, sheet)
    result.set("QualityControlMethods", "Inspection")
    if sheet.verdict != "not-inspected":
        good = sheet.verdict == "good"
        # Passed is what a receiver releases: a sheet that is well printed and is not accepted is neither.
        result.set("Passed", str(int(good and sheet.disposition == "accept")))
        result.set("Failed", str(int(not good)))
        result.set("Severity", str(severity(sheet)))
        inspection = element(result, "Inspection")
        if not good:
            _defects(inspection, sheet, sheet_mm)
    if sheet.shift_x_mm is not None and sheet.shift_y_mm is not None:
        _registration(result, sheet.shift_x_mm, sheet.shift_y_mm, reference="Paper")


def _resource(above: _Element, sheet: SheetJudged, **part: str) -> _Element:
    own = sheet.on_sheet
    named = sheet.page if own is None else f"{sheet.page}, {_worded(own)}"
    resource = element(above, "Resource", ExternalID=f"sheet-{sheet.sheet}", DescriptiveName=clean(named))
    if not part:
        if sheet.reason:
            element(resource, "Comment").text = clean(sheet.reason)
        element(resource, "Comment").text = f"disposition: {sheet.disposition} ({sheet.decided_by})"
    if own is not None and own.side is not None:
        part = {"Side": _face(sheet), **part}
    element(resource, "Part", SheetName=name(sheet.page), **part)
    return resource


def _worded(own: OnSheet) -> str:
    """Describe, for people, the sheet of which this is a side."""
    side = f"{own.side} of " if own.side else ""
    of_set = "" if own.set is None else f", set {own.set}"
    return f"{side}sheet {own.sheet} ({own.name}, copy {own.copy}{of_set})"


def _face(sheet: SheetJudged) -> str:
    own = sheet.on_sheet
    return "Back" if own is not None and own.side == "back" else "Front"


def _result(resource: _Element, event: Event, sheet: SheetJudged) -> _Element:
    inspected = sheet.verdict != "not-inspected"
    return element(
        resource,
        RESOURCE,
        End=time_text(event.time_s),
        MeasurementUsage="Standard",
        Measurements=str(int(inspected)),
        Sample=f"{sheet.sheet} {sheet.sheet}",
    )


def _defects(inspection: _Element, sheet: SheetJudged, sheet_mm: tuple[float, float] | None) -> None:
    """Add a defect for each region; for a misprint without regions, one for the sheet as a whole."""
    for place in sheet.places[:MOST_DEFECTS]:
        defect = element(
            inspection,
            "Defect",
            DefectType="ImageDefect",
            DefectTypeDetails=_details(place.kind),
            Face=_face(sheet),
        )
        if sheet_mm is not None:
            defect.set("Box", box_points(place.box, sheet_mm[1]))
        defect.set("Size", _number(place.box.width_mm * place.box.height_mm * POINTS_A_MM**2))
        if place.score is not None:
            defect.set("Severity", str(round(100 * min(abs(place.score) / SURE_SIGMAS, 1.0))))
        box = place.box
        where = f"{box.x_mm:g} mm from the left, {box.y_mm:g} mm from the top, {box.width_mm:g} x {box.height_mm:g} mm"
        element(defect, "Comment").text = where
    if not sheet.places:
        defect = element(inspection, "Defect", DefectType="ImageDefect", Face=_face(sheet))
        defect.set("DefectTypeDetails", _details(sheet.kind or "unknown"))
        defect.set("Severity", str(severity(sheet)))


def _details(kind: str) -> str:
    return DETAILS.get(kind, name(kind))


def _registration(result: _Element, x_mm: float, y_mm: float, *, reference: str) -> None:
    """Add the registration error, to the right and up. [point]"""
    offset = f"{_number(POINTS_A_MM * x_mm)} {_number(-POINTS_A_MM * y_mm)}"
    element(result, "RegistrationQuality", Offset=offset, Reference=reference)


def root_of(device_id: str, time_s: float) -> _Element:
    """Return the root of a new message, with its header."""
    root = etree.Element(tag_of("XJMF"), nsmap={None: NAMESPACE}, Version=VERSION)
    header_of(root, device_id, time_s)
    return root


def header_of(
    above: _Element, device_id: str, time_s: float, *, identifier: str = "", query_id: str | None = None
) -> None:
    """Add a header to an element. time_s: Unix time."""
    header = element(above, "Header", AgentName="Prooflight", AgentVersion=__version__)
    header.set("DeviceID", name(device_id))
    if identifier:
        header.set("ID", identifier)
    if query_id is not None:
        header.set("refID", name(query_id))
    header.set("Time", time_text(time_s))


def element(above: _Element, tag: str, **attributes: str) -> _Element:
    """Add an element below another, and return it."""
    return etree.SubElement(above, tag_of(tag), attributes)


def tag_of(tag: str) -> str:
    """Return a name with CIP4's namespace."""
    return f"{{{NAMESPACE}}}{tag}"


def time_text(time_s: float) -> str:
    """Return a Unix time as XML states it."""
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds")


def _number(value: float) -> str:
    return f"{round(value, 3) + 0.0:.10g}"


def read(data: bytes) -> _Element:
    """Return the root of a received message; ValueError if it is no XJMF.

    Nothing that the message refers to is loaded.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise ValueError(str(error)) from error
    if root.tag != tag_of("XJMF"):
        message = "the root is not XJMF"
        raise ValueError(message)
    return root


def messages(root: _Element) -> list[tuple[str, _Element]]:
    """Return name and element of each message in it."""
    elements = [(etree.QName(one).localname, one) for one in root if isinstance(one.tag, str)]
    return [(kind, one) for kind, one in elements if kind != "Header"]


def part(element: _Element, tag: str) -> _Element | None:
    """Return the first child with that name."""
    return element.find(tag_of(tag))
