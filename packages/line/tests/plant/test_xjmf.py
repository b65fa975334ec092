"""XJMF: what stands in a message, that it is of CIP4's schema, and that it is pushed and answered by HTTP."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from lxml import etree
from packages.line.tests.plant.peers import Proxy, Receiver, free_port
from packages.line.tests.plant.runs import FACTS, GOOD, LONGEST_S, MISPRINT, Heard, outcome, random_outcome

from prooflight.detectors.verdict import Region, Verdict
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan
from prooflight_line.plant.events import Event, EventsLost, SheetJudged
from prooflight_line.plant.outlets import xjmf_messages as xjmf
from prooflight_line.plant.outlets.outlet import Outlets, check
from prooflight_line.plant.outlets.xjmf import XjmfAnswers, XjmfPush
from prooflight_line.plant.stream import EventStream

NS = {"x": xjmf.NAMESPACE}
A4 = 210.0, 297.0
SCHEMA = os.environ.get("PROOFLIGHT_XJMF_SCHEMA", "")
"""CIP4's xjdf.xsd, which is not among our files."""
RANDOM_VERDICTS = 1000


def told(*outcomes: Any, plan: SheetPlan | None = None) -> list[Event]:
    heard = Heard()
    stream = EventStream(
        [heard], press="rig", size_mm=A4, plan=plan, stream="s", clock=lambda: 1_800_000_000.25
    )
    stream.started(FACTS)
    for one in outcomes:
        stream.observe(one)
    return list(heard.all)


def tree(data: bytes) -> Any:
    return xjmf.read(data)


def signal(*outcomes: Any, sheet_mm: tuple[float, float] | None = A4, plan: SheetPlan | None = None) -> Any:
    return tree(
        xjmf.signals(told(*outcomes, plan=plan), device_id="rig", job="a brochure.pdf", sheet_mm=sheet_mm)
    )


def test_a_misprint_says_what_where_and_how_bad() -> None:
    root = signal(outcome(7, MISPRINT))
    assert (root.get("Version"), root.find("x:Header", NS).get("DeviceID")) == ("2.1", "rig")
    [message] = root.findall("x:SignalResource", NS)
    assert message.find("x:Header", NS).get("Time") == "2027-01-15T08:00:00.250+00:00"
    assert message.find("x:ResourceInfo", NS).get("JobID") == "a_brochure.pdf"
    sheet, black = message.findall(".//x:Resource", NS)
    assert sheet.find("x:Part", NS).attrib == {"SheetName": "p0002"}
    assert sheet.find("x:Comment", NS).text == MISPRINT.reason
    result = sheet.find("x:QualityControlResult", NS)
    assert {
        name: result.get(name) for name in ("Passed", "Failed", "Sample", "Severity", "Measurements")
    } == {
        "Passed": "0",
        "Failed": "1",
        "Sample": "7 7",
        "Severity": "99",
        "Measurements": "1",
    }
    [defect] = result.findall("x:Inspection/x:Defect", NS)
    assert (defect.get("DefectType"), defect.get("DefectTypeDetails")) == ("ImageDefect", "Streak")
    assert defect.get("Severity") == "45"  # 9 of 20 standard deviations
    box = [float(one) for one in defect.get("Box").split()]
    assert box == pytest.approx([338.74, 0.0, 341.575, 841.89], abs=0.001)
    assert float(defect.get("Size")) == pytest.approx(297 * xjmf.POINTS_A_MM**2, abs=0.01)
    shift = result.find("x:RegistrationQuality", NS)
    assert [float(one) for one in shift.get("Offset").split()] == pytest.approx([0.340, 0.113], abs=0.001)
    assert black.find("x:Part", NS).attrib == {"SheetName": "p0002", "Separation": "Black"}
    register = black.find("x:QualityControlResult/x:RegistrationQuality", NS)
    assert [float(one) for one in register.get("Offset").split()] == pytest.approx([0.085, 0.057], abs=0.001)


def test_a_back_says_so_and_which_sheet_it_is_of() -> None:
    sides = SheetPlan(layout=Layout.parse("sides=2,pages-a-set=4"), sides=4, sheets=4)
    back = outcome(5, MISPRINT)
    part, defect = (signal(back, plan=sides).find(f".//x:{one}", NS) for one in ("Part", "Defect"))
    assert part.attrib == {"SheetName": "p0002", "Side": "Back"}
    assert defect.get("Face") == "Back"
    named = signal(back, plan=sides).find(".//x:Resource", NS).get("DescriptiveName")
    assert named == "p0002, back of sheet 2 (s0001, copy 2, set 1)"
    front = signal(outcome(4, MISPRINT), plan=sides)
    assert (front.find(".//x:Part", NS).get("Side"), front.find(".//x:Defect", NS).get("Face")) == (
        "Front",
        "Front",
    )


def test_a_box_is_measured_from_the_lower_left() -> None:
    place = Region(x_mm=10, y_mm=20, width_mm=30, height_mm=40, score=99, kind="scum")
    defect = signal(outcome(0, replace(MISPRINT, regions=(place,)))).find(".//x:Defect", NS)
    box_mm = [float(one) / xjmf.POINTS_A_MM for one in defect.get("Box").split()]
    assert box_mm == pytest.approx([10, 297 - 60, 40, 297 - 20], abs=0.001)
    assert defect.get("Severity") == "100"
    unknown = signal(outcome(0, MISPRINT), sheet_mm=None).find(".//x:Defect", NS)
    assert unknown.get("Box") is None
    assert "119.5 mm from the left" in unknown.find("x:Comment", NS).text


@pytest.mark.parametrize(
    ("verdict", "passed", "defects"),
    [
        (GOOD, "1", 0),
        (replace(MISPRINT, regions=()), "0", 1),
        (Verdict.skipped("p0003", "too many sheets were waiting for inspection"), None, None),
    ],
)
def test_what_passed_what_failed_and_what_nobody_looked_at(
    verdict: Verdict, passed: str | None, defects: int | None
) -> None:
    result = signal(outcome(3, verdict)).find(".//x:QualityControlResult", NS)
    assert result.get("Passed") == passed
    inspection = result.find("x:Inspection", NS)
    assert (None if inspection is None else len(inspection)) == defects
    assert result.get("Measurements") == ("0" if defects is None else "1")


def test_text_of_whatever_kind_stays_text() -> None:
    nasty = replace(MISPRINT, reason="<Comment>&\x00\ud800 ]]>", page="a page/é", kind="<kind>", regions=())
    root = signal(outcome(0, nasty))
    assert root.find(".//x:Resource/x:Comment", NS).text == "<Comment>&\ufffd\ufffd ]]>"
    assert root.find(".//x:Part", NS).get("SheetName") == "a_page__"
    assert root.find(".//x:Defect", NS).get("DefectTypeDetails") == "_kind_"


def messages() -> list[bytes]:
    """Signals of random verdicts, one a message and many a message, what was lost, and answers of every kind."""
    rng = np.random.default_rng(25)
    events = told(*(random_outcome(n, rng) for n in range(RANDOM_VERDICTS)))
    sheets = [event for event in events if isinstance(event.body, SheetJudged)]
    assert len(sheets) == RANDOM_VERDICTS
    sizes = (A4, None)
    found = [
        xjmf.signals([one], device_id="rig", job="a job", sheet_mm=sizes[at % 2])
        for at, one in enumerate(sheets)
    ]
    lost = replace(events[0], body=EventsLost(count=3, first=1, last=3))
    how: dict[str, Any] = {"device_id": "rig", "query_id": "Q 1", "time_s": 1e9}
    return [
        *found,
        xjmf.signals(sheets[:50], device_id="rig", job="", sheet_mm=A4),
        xjmf.lost(lost, device_id="rig"),
        xjmf.response(sheets[:50], job="j", sheet_mm=A4, **how),
        xjmf.response([], job="j", **how),
        *(xjmf.refusal(kind, "no <way>", 6, **how) for kind in ("Resource", "Status", "Notification")),
    ]


def test_every_message_is_built_as_the_schema_says() -> None:
    """Order of children, attributes and their types, by our own reading of it; the next test asks the schema itself."""
    after = {
        "Resource": ["Comment", "Part", "QualityControlResult"],
        "QualityControlResult": ["Inspection", "RegistrationQuality"],
        "Inspection": ["Defect"],
        "Defect": ["Comment"],
        "ResourceInfo": ["ResourceSet"],
        "ResourceSet": ["Resource"],
        "SignalResource": ["Header", "ResourceInfo"],
    }
    names = {
        "DeviceID",
        "JobID",
        "ExternalID",
        "SheetName",
        "Separation",
        "DefectTypeDetails",
        "Reference",
        "ID",
    }
    lists = {"Box": 4, "Offset": 2, "Sample": 2}
    for data in messages():
        for element in tree(data).iter():
            children = [etree.QName(one).localname for one in element]
            order = after.get(etree.QName(element).localname)
            if order is not None:
                assert children == sorted(children, key=order.index)
            for name, value in element.attrib.items():
                if name in names:
                    assert value
                    assert xjmf.name(value) == value
                if name in lists:
                    assert len([float(one) for one in value.split()]) == lists[name]
                if name == "Severity":
                    assert 0 <= int(value) <= 100
        headers = list(tree(data).iter(f"{{{xjmf.NAMESPACE}}}Header"))
        identifiers = [one.get("ID") for one in headers if one.get("ID")]
        assert len(identifiers) == len(set(identifiers))
        assert all(one.get("Time") and one.get("DeviceID") for one in headers)


@pytest.mark.skipif(
    not Path(SCHEMA).is_file(), reason="PROOFLIGHT_XJMF_SCHEMA names no file: CIP4's xjdf.xsd is not here"
)
def test_a_thousand_random_verdicts_are_of_cip4_s_schema() -> None:
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    for data in messages():
        schema.assertValid(etree.fromstring(data))


# --- by HTTP ---


def push(port: int, **how: Any) -> XjmfPush:
    return XjmfPush(url=f"http://127.0.0.1:{port}/xjmf", device_id="rig", **how)


def sheets_of(taken: list[Any]) -> list[int]:
    found = [tree(body).find(".//x:QualityControlResult", NS) for _, _, body in taken]
    return [int(one.get("Sample").split()[0]) for one in found]


def test_every_sheet_is_pushed_in_order_and_through_a_cut() -> None:
    with Receiver() as receiver, Proxy(receiver.port) as proxy:
        with Outlets([push(proxy.port)], pauses_s=(0.01, 0.02)) as outlets:
            stream = EventStream([outlets.put], press="rig", size_mm=A4)
            stream.started(FACTS)
            stream.observe(outcome(0))
            receiver.heard.count(1)
            proxy.cut(refusing=True)
            for n in range(1, 10):
                stream.observe(outcome(n, MISPRINT if n % 2 else GOOD))
            proxy.repair()
            receiver.heard.until(lambda all_: sheets_of(all_)[-1] == 9)
        taken = receiver.taken
    # A sheet whose answer the cut took comes again.
    assert sorted(set(sheets_of(taken))) == list(range(10))
    assert sheets_of(taken) == sorted(sheets_of(taken))
    assert {headers["Content-Type"] for _, headers, _ in taken} == {xjmf.MIME}
    assert tree(taken[-1][2]).find(".//x:Defect", NS).get("Box")


def test_alarms_alone_are_pushed_where_that_was_asked_for() -> None:
    with Receiver() as receiver:
        with Outlets([push(receiver.port, alarms_only=True)], close_s=LONGEST_S) as outlets:
            stream = EventStream([outlets.put], press="rig")
            for n in range(9):
                stream.observe(outcome(n, MISPRINT if n % 3 == 0 else GOOD, late=n == 4))
        assert sheets_of(receiver.taken) == [0, 3, 4, 6]


def test_a_receiver_that_refuses_is_told_what_was_lost() -> None:
    with Receiver() as receiver:
        receiver.answers = [400]
        with Outlets([push(receiver.port)]) as outlets:
            stream = EventStream([outlets.put], press="rig")
            stream.observe(outcome(0))
            stream.observe(outcome(1))
            receiver.heard.count(3)
        text = tree(receiver.taken[0][2]).find("x:SignalNotification/x:Notification/x:Comment", NS).text
        assert text == "1 message was lost, 1 to 1"
        assert sheets_of(receiver.taken[1:]) == [1]
    assert outlets.health[0].lost == 1


QUERY = (
    f'<XJMF xmlns="{xjmf.NAMESPACE}"><Header DeviceID="office" Time="2026-01-01T00:00:00Z"/>'
    '<QueryResource><Header DeviceID="office" ID="Q1" Time="2026-01-01T00:00:00Z"/>'
    '<ResourceQuParams ResourceName="{}" Scope="Job"/>{}</QueryResource></XJMF>'
)


def asked(text: str, answers: XjmfAnswers | None = None) -> Any:
    found = answers or XjmfAnswers(device_id="rig", host="127.0.0.1", port=0, clock=lambda: 1e9)
    return tree(found.answer(text.encode()))


def test_queries_are_answered_by_the_last_sheets() -> None:
    said, noted = Heard(), Heard()

    class Noting(XjmfAnswers):
        def note(self, event: Event) -> None:
            XjmfAnswers.note(self, event)
            noted(event)

    outlet = Noting(device_id="rig", host="127.0.0.1", port=0)
    with Outlets([outlet], changed=said) as outlets:
        where = said.count(1)[0].detail
        stream = EventStream([outlets.put], press="rig", size_mm=A4)
        stream.started(FACTS)
        for n in range(150):
            stream.observe(outcome(n, MISPRINT))
        stream.state("press", "draining")
        noted.until(lambda events: events[-1].kind == "state-changed")  # it is past the sheets before it
        text = QUERY.format("QualityControlResult", "")

        def answered() -> Any:
            reply = httpx.post(f"http://{where}/", content=text, trust_env=False)
            assert (reply.status_code, reply.headers["content-type"]) == (200, xjmf.MIME)
            return tree(reply.content).find("x:ResponseResource", NS)

        answer = answered()
        assert answer.get("ReturnCode") == "0"
        assert answer.find("x:Header", NS).get("refID") == "Q1"
        assert [one.get("Sample") for one in answer.findall(".//x:Inspection/..", NS)] == [
            f"{n} {n}" for n in range(50, 150)
        ]
        assert httpx.get(f"http://{where}/", trust_env=False).status_code == 405
        assert httpx.post(f"http://{where}/", content=b"x" * 1_000_001, trust_env=False).status_code == 413


@pytest.mark.parametrize(
    ("text", "message", "code", "said"),
    [
        ("<XJMF", "ResponseNotification", "3", "this is not XJMF"),
        ("<JMF/>", "ResponseNotification", "3", "the root is not XJMF"),
        (f'<XJMF xmlns="{xjmf.NAMESPACE}"/>', "ResponseNotification", "5", "one query at a time"),
        (QUERY.format("Media", ""), "ResponseResource", "6", "Media is unknown here"),
        (
            QUERY.format("QualityControlResult", '<Subscription URL="http://127.0.0.1/"/>'),
            "ResponseResource",
            "5",
            "subscriptions are in the press file",
        ),
        (
            QUERY.format("", "").replace("QueryResource", "QueryStatus"),
            "ResponseStatus",
            "5",
            "only QueryResource",
        ),
        (
            QUERY.format("", "").replace("QueryResource", "CommandFly"),
            "ResponseNotification",
            "5",
            "CommandFly",
        ),
        (
            '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + QUERY.format("M&a;", ""),
            "ResponseNotification",
            "3",
            "this is not XJMF",
        ),
    ],
)
def test_what_cannot_be_answered_is_refused_in_a_line(text: str, message: str, code: str, said: str) -> None:
    answer = asked(text).find(f"x:{message}", NS)
    assert answer.get("ReturnCode") == code
    assert said in answer.find("x:Notification/x:Comment", NS).text


def test_checking_disturbs_nobody() -> None:
    with Receiver() as receiver:
        assert check(push(receiver.port)).ok
        assert receiver.heard.all == []
        taken = check(XjmfAnswers(device_id="rig", host="127.0.0.1", port=receiver.port))
    assert (taken.ok, taken.answer) == (False, "Address already in use")
    assert check(XjmfAnswers(device_id="rig", host="127.0.0.1", port=free_port())).ok
    assert not check(push(free_port())).ok
