"""Marks that a press would catch, for ``press show``: on large tints, or on one page of a job with its map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight.reporting.wording import mark_size

if TYPE_CHECKING:
    from prooflight.detectors.visible_marks import PlaceRow
    from prooflight.press.artefact import Press

TINTS: Final = {"bare paper": 0.0, "40 % black": 0.4}


@dataclass(frozen=True, slots=True, kw_only=True)
class OnTint:
    """Smallest marks caught on a large area of one tint; sizes in millimetres, infinite: none."""

    place: str
    spot_mm: float
    hair_mm: float


def on_tints(press: Press) -> list[OnTint]:
    """Return a row for each of ``TINTS``; none if the press's detector does not state what it can detect."""
    from prooflight.detectors.optional import ShowsVisibleMarks
    from prooflight.detectors.registry import detector

    own = detector(None, press)
    if not isinstance(own, ShowsVisibleMarks):
        return []
    rows = []
    for place, black in TINTS.items():
        spot_mm, hair_mm = own.visible_on_tint(black)
        rows.append(OnTint(place=place, spot_mm=spot_mm, hair_mm=hair_mm))
    return rows


def print_tints(rows: Sequence[OnTint]) -> None:
    """Print the rows for people."""
    table = show.table_of(
        "What would be caught", ("on", "black spot [mm]", "hair [mm]"), text_columns=("on",)
    )
    for row in rows:
        table.add_row(row.place, mark_size(row.spot_mm), mark_size(row.hair_mm))
    show.people.print(table)


def on_page(
    press: Press, job: Path, number: int, *, picture: Path | None, profile: Path | None
) -> list[PlaceRow]:
    """Return the marks that would be caught on a page of a job, by class of place; ``picture`` is the file of
    its map.

    RequestError: the press's detector does not state them, or the job has no such page.
    """
    from prooflight.detectors.optional import ShowsVisibleMarks
    from prooflight.inspection.inspector import Inspector
    from prooflight.press.pages import open_job
    from prooflight.reporting.visibility_picture import draw_visibility

    inspector = Inspector.of(press)
    if not isinstance(inspector.detector, ShowsVisibleMarks):
        what = f"{inspector.detector.name!r} of press {press.name} does not state what it can detect"
        raise RequestError(
            "--job", what, remedy="build the press with `prooflight press build --detector quick`"
        )
    with open_job(job, press, profile=profile) as opened:
        page = opened.page(number)
    marks = inspector.detector.visible_marks(inspector.planned(page))
    if picture is not None:
        draw_visibility(picture, marks, page, press)
    return marks.rows()


def print_page(rows: Sequence[PlaceRow], title: str) -> None:
    """Print the rows for people."""
    headings = ("place", "of the page", "black spot [mm]", "at worst", "hair [mm]", "at worst")
    table = show.table_of(title, headings, text_columns=("place",))
    for row in rows:
        sizes = row.spot_mm, row.worst_spot_mm, row.hair_mm, row.worst_hair_mm
        table.add_row(row.place, f"{row.share:.0%}", *map(mark_size, sizes))
    show.people.print(table)


def plain(rows: Sequence[OnTint] | Sequence[PlaceRow]) -> list[dict[str, Any]]:
    """Return rows for programs; null stands for no size."""
    return [
        {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in asdict(row).items()
        }
        for row in rows
    ]


EXPLAINED: Final = (
    "Smallest spot of 90 % black by its diameter, narrowest hair of 70 % black, 6 mm long, by its width, that alarm "
    "by small windows or by the floor about half of the time; other evidence only adds."
)


def page_number(job: Path | None, page: int | None, picture: Path | None) -> int:
    """Return the requested page; RequestError if one is requested without a job."""
    for option, given in (("--page", page), ("--map", picture)):
        if job is None and given is not None:
            raise RequestError(option, "needs the job that contains the page", remedy="give --job JOB")
    return page or 1
