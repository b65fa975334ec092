"""Roll map: the defects of a run by metre of the web, for a rewinder and for people."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

from prooflight.detectors.disposition import NOT_WHOLE
from prooflight_line.causes.marks import sheet_distance_mm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from prooflight.scans.geometry import ScanGeometry
    from prooflight_line.journal.records import PageRecord, RunRow

MM_PER_M: Final = 1000.0
DECIMALS: Final = 4
"""Number of decimals of metres: a tenth of a millimetre is the pitch of lines."""
COLOURS: Final = {"misprint": "#c9302c", "not-inspected": "#f0ad4e"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """A part of the web that must not be delivered unseen: a defect, or a sheet that was not seen."""

    from_m: float
    """Place on the web, from the first line of the run's first sheet."""
    to_m: float
    left_mm: float
    """Distance from the page's left edge; a place that is not known is the whole width, from 0 to 0."""
    right_mm: float
    sheet: int
    verdict: str
    kind: str
    disposition: str
    reason: str


def roll_map(records: Sequence[PageRecord], geometry: ScanGeometry) -> list[Stretch]:
    """Return the stretches of a run in the order of the web.

    A misprint has a stretch for each of its regions; one without regions, a sheet that was not inspected, and a
    sheet that was not wholly seen, are stretches as long as the distance to the next sheet. Pages that did not
    come are on no web.
    """
    came = [record for record in records if record.faults != ("missing",)]
    if not came:
        return []
    origin = min(record.first_line for record in came) * geometry.line_pitch_mm
    length = sheet_distance_mm(came, geometry) or 0.0
    stretches = []
    for record in came:
        verdict = record.verdict
        if verdict.verdict == "good" and not NOT_WHOLE & set(record.faults):
            continue
        begin = record.first_line * geometry.line_pitch_mm - origin
        shift = verdict.shift_mm or (0.0, 0.0)
        top = begin + geometry.lead_in_mm + shift[1]
        boxes = [
            (top + one.y_mm, top + one.y_mm + one.height_mm, one.x_mm, one.x_mm + one.width_mm, one.kind)
            for one in verdict.regions
            if verdict.verdict == "misprint"
        ]
        whole = "" if verdict.kind is None else verdict.kind
        for start, end, left, right, kind in boxes or [(begin, begin + length, 0.0, 0.0, whole)]:
            stretch = Stretch(
                from_m=round(start / MM_PER_M, DECIMALS),
                to_m=round(end / MM_PER_M, DECIMALS),
                left_mm=round(left, 2),
                right_mm=round(right, 2),
                sheet=record.sheet,
                verdict=verdict.verdict,
                kind=kind,
                disposition=record.disposition,
                reason=verdict.reason or ", ".join(record.faults),
            )
            stretches.append(stretch)
    return sorted(stretches, key=lambda one: (one.from_m, one.left_mm))


def as_csv(stretches: Sequence[Stretch]) -> str:
    """Return one row a stretch, with a header of ``Stretch``'s fields."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(Stretch)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(map(asdict, stretches))
    return text.getvalue()


def as_xml(stretches: Sequence[Stretch], run: RunRow) -> bytes:
    """Return a ``RollMap`` with one ``Stretch`` each, whose attributes are the CSV's columns."""
    root = ElementTree.Element(
        "RollMap", run=str(run.id), job=_xml(run.facts.job), press=_xml(run.facts.press)
    )
    for one in stretches:
        cells = {
            name: _xml(f"{value:g}" if isinstance(value, float) else str(value))
            for name, value in asdict(one).items()
        }
        ElementTree.SubElement(root, "Stretch", cells)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _xml(text: str) -> str:
    """Return the text without characters that XML does not allow."""
    return "".join(one if one.isprintable() else " " for one in text)


def picture(stretches: Sequence[Stretch], *, title: str) -> Figure:
    """Draw the web from left to right, with each stretch at its place across."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.2), layout="constrained")
    axes = figure.add_subplot()
    right = max((one.right_mm for one in stretches), default=0.0) or 1.0
    for verdict, colour in COLOURS.items():
        own = [one for one in stretches if one.verdict == verdict]
        placed = [one for one in own if one.right_mm > one.left_mm]
        axes.scatter(
            [(one.from_m + one.to_m) / 2 for one in placed],
            [(one.left_mm + one.right_mm) / 2 for one in placed],
            s=9,
            color=colour,
            label=verdict,
        )
        for one in own:
            whole = one.right_mm <= one.left_mm
            if whole or one.to_m - one.from_m > right / MM_PER_M / 10:
                low, high = (0.0, right) if whole else (one.left_mm, one.right_mm)
                axes.fill_between([one.from_m, one.to_m], low, high, color=colour, alpha=0.3, linewidth=0)
    axes.set(title=title, xlabel="along the web [m]", ylabel="across [mm]", ylim=(right * 1.02, 0))
    axes.legend(loc="upper right")
    return figure
