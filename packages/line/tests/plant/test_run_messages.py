"""What is sent of a run: its result as XJMF, and its reprint as XJDF, which Prooflight's own hot folder reads."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from lxml import etree
from packages.line.tests.journal.journals import facts, record

from prooflight.detectors.verdict import Verdict
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan
from prooflight_line.job_queue.tickets.reading import read_ticket
from prooflight_line.journal.records import RunEnd, RunRow
from prooflight_line.plant.reprint_job import ReprintJob, ReprintSheet
from prooflight_line.plant.run_messages import reprint_ticket, run_result

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.detectors.verdict import VerdictName
    from prooflight_line.journal.records import PageRecord

SCHEMA = os.environ.get("PROOFLIGHT_XJMF_SCHEMA", "")
"""CIP4's xjdf.xsd, which is not among our files."""
NS = {"x": "http://www.CIP4.org/JDFSchema_2_0"}
COUNTS = ("pages", "misprints", "not_inspected", "late", "faulty", "dropped_pages", "dropped_evidence")
TICKET = {"job_id": "J 17", "customer": "Söhne & Co", "name": "Menu <of> today"}


def run_row(**settings: Any) -> RunRow:
    told = facts(job="工 Ω <job>.pdf", press="my press", settings=settings, sheets=8)
    end = RunEnd(ended_s=1060.0, ending="stopped")
    counts: dict[str, Any] = dict.fromkeys(COUNTS, 0)
    return RunRow(id=3, facts=told, end=end, state="stopped", promise_suspended_from=None, **counts)


def pages(verdicts: Sequence[tuple[str, VerdictName]], **changes: Any) -> list[PageRecord]:
    return [
        replace(record(at), verdict=Verdict(page=page, verdict=verdict), **changes)
        for at, (page, verdict) in enumerate(verdicts)
    ]


def result(run: RunRow, rows: list[PageRecord]) -> Any:
    root = etree.fromstring(run_result(run, rows))
    of_schema(root)
    return root


def of_schema(root: Any) -> None:
    if Path(SCHEMA).is_file():
        etree.XMLSchema(etree.parse(SCHEMA)).assertValid(root)


def amounts(root: Any) -> dict[str, tuple[str, str, dict[str, str]]]:
    return {
        resource.get("DescriptiveName"): (
            (amount := resource.find(".//x:PartAmount", NS)).get("Amount"),
            amount.get("Waste"),
            {one.get("WasteDetails"): one.get("Waste") for one in amount.findall("x:PartWaste", NS)},
        )
        for resource in root.findall(".//x:Resource", NS)
    }


def test_a_result_counts_each_sheet_once_and_calls_nothing_good_that_was_not_inspected() -> None:
    judged: list[tuple[str, VerdictName]] = [
        ("p1", "good"),
        ("p<2>", "good"),
        ("p1", "misprint"),
        ("p<2>", "not-inspected"),
        ("p1", "good"),
    ]
    rows = pages(judged)
    rows[4] = replace(rows[4], gate="divert")
    absent = replace(rows[3], sheet=9, faults=("missing",))  # it did not come, and is no waste
    root = result(run_row(ticket=TICKET), [*rows, absent])
    assert amounts(root) == {
        "p1": ("1", "2", {"Misprint": "1", "NotAccepted": "1"}),
        "p<2>": ("1", "1", {"NotInspected": "1"}),
    }
    phase = root.find("x:SignalStatus/x:DeviceInfo/x:JobPhase", NS)
    said = {
        name: phase.get(name) for name in ("JobID", "Status", "Amount", "Waste", "TotalAmount", "EndTime")
    }
    assert said == {
        "JobID": "J_17",
        "Status": "Aborted",
        "Amount": "2",
        "Waste": "3",
        "TotalAmount": "8",
        "EndTime": "1970-01-01T00:17:40.000+00:00",
    }
    assert [one.get("SheetName") for one in root.findall(".//x:Part", NS)] == ["p1", "p_2_"]


def test_the_unit_is_the_sheet_and_its_worst_side_counts() -> None:
    plan = SheetPlan(layout=Layout.parse("sides=2"), sides=4, sheets=4)
    sides: list[tuple[str, VerdictName]] = [
        ("a", "good"),
        ("b", "misprint"),
        ("c", "good"),
        ("d", "good"),
        ("a", "good"),
        ("b", "good"),
    ]
    root = result(run_row(layout=plan.facts), pages(sides))
    assert amounts(root) == {"s0001": ("1", "1", {"Misprint": "1"}), "s0002": ("1", "0", {})}
    assert root.find(".//x:JobPhase", NS).get("TotalAmount") == "4"  # sheets, not sides


@pytest.mark.parametrize("layout", ["", "sides=2,pages-a-set=4,gutter=4"])
def test_the_ticket_of_a_reprint_orders_its_file_once_for_the_same_job(layout: str, tmp_path: Path) -> None:
    settings: dict[str, Any] = {"ticket": TICKET}
    if layout:
        settings["layout"] = SheetPlan(layout=Layout.parse(layout), sides=4, sheets=4).facts
    sheet = ReprintSheet(run_sheet=1, copy=1, number=2, page="p2", pages=(3, 4), set_number=1, behind="p1")
    job = ReprintJob(run=3, started_s=1.0, job="job.pdf", job_digest="d" * 64, sheets=(sheet,))
    path = tmp_path / "print again.xjdf"
    path.write_bytes(reprint_ticket(job, run_row(**settings), file="print again.pdf", time_s=1e9))
    of_schema(etree.parse(str(path)))
    read = read_ticket(path)
    assert (read.job_id, read.file, read.copies, read.customer) == (
        "J_17",
        "print again.pdf",
        1,
        "S_hne___Co",
    )
    assert Layout.parse(read.layout) == Layout.parse(layout) if layout else read.layout == ""
    root = etree.parse(str(path)).getroot()
    assert root.get("JobPartID") == "reprint-of-run-3"
    assert root.find(".//x:RunList", NS).get("NPage") == "2"
