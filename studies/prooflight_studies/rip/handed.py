"""A folder of small PDFs whose ink once came out wrong: what is right, and what is printed of them now.

Each case is named by the number that its file begins with. What is right, and what was drawn before (of commit
93115bc), is what the README of the folder says.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.errors import InputError, RequestError
from prooflight.pages.pdf.rip import PdfJob

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

Ink = tuple[int, int, int, int]
TOLERANCE: Final = 2
"""Greatest difference, of 255: opacity has eight bits."""
DPI: Final = 72
REFUSED: Final = "page-refused"


@dataclass(frozen=True, slots=True, kw_only=True)
class Handed:
    """One such file, of 100 x 100 points."""

    number: str
    what: str
    clause: str
    before: str
    right: Ink | None = None
    """None: the case is not about an ink."""
    at: tuple[int, int] = (50, 50)
    """Column and row of a pixel that shows it."""
    warning: str = ""
    """Kind of the warning that it must give; ``REFUSED``: its page must be refused."""


HALF_MAGENTA: Final = (0, 128, 0, 0)
GOLD: Final = (0, 51, 204, 26)
CYAN: Final = (255, 0, 0, 0)
BLACK: Final = (0, 0, 0, 255)
OLIVE: Final = (128, 128, 0, 128)
HANDED: Final = (
    Handed(number="01a", what="opacity in a group", clause="11.4.5", before="M 254", right=HALF_MAGENTA),
    Handed(number="01b", what="the same, B", clause="11.7.4.4", before="M 254", right=HALF_MAGENTA),
    Handed(
        number="01c", what="B on a page with a group", clause="11.7.4.4", before="M 254", right=HALF_MAGENTA
    ),
    Handed(number="01d", what="B, blend mode unused", clause="11.7.4.4", before="M 254", right=HALF_MAGENTA),
    Handed(number="01e", what="B over a tint", clause="11.7.4.4", before="254 0 241 0", right=(77, 0, 71, 0)),
    Handed(
        number="01g",
        what="soft mask, Alpha",
        clause="11.5.2",
        before="C 255",
        right=(128, 0, 0, 0),
        at=(25, 50),
    ),
    Handed(
        number="02a", what="resources inherited", clause="7.7.3.4", before="refused as damaged", right=GOLD
    ),
    Handed(number="02b", what="a space named P", clause="7.8.3", before="refused as damaged", right=GOLD),
    Handed(number="03a", what="no JPEG", clause="7.4.8", before="K 255, no warning", warning=REFUSED),
    Handed(number="03b", what="JPEG cut off", clause="7.4.8", before="K 255, no warning", warning=REFUSED),
    Handed(
        number="03d",
        what="font not embedded",
        clause="9.9",
        before="no warning",
        warning="font-substituted",
    ),
    Handed(number="04a", what="Separation None", clause="8.6.6.4", before="erased to paper", right=CYAN),
    Handed(number="04c", what="None, image", clause="8.6.6.4", before="0 255 255 0", right=CYAN),
    Handed(
        number="05a", what="DeviceN by its transform", clause="8.6.6.5", before="255 255 0 0", right=OLIVE
    ),
    Handed(number="05b", what="the same, image", clause="8.6.6.5", before="255 255 0 0", right=OLIVE),
    Handed(
        number="05d",
        what="additive DeviceN",
        clause="8.6.6.5",
        before="K 255",
        right=(0, 0, 0, 0),
        at=(25, 50),
    ),
    Handed(
        number="06",
        what="two output intents",
        clause="14.11.5",
        before="by a built-in profile",
        right=(182, 14, 232, 0),
    ),
    Handed(
        number="07",
        what="mesh in RGB",
        clause="8.7.4.5.5",
        before="111 225 127 0",
        right=(153, 255, 36, 9),
        at=(50, 75),
    ),
    Handed(number="08a", what="Cyan, image", clause="8.6.6.4", before="114 13 3 0", right=(128, 0, 0, 0)),
    Handed(number="08c", what="All, image", clause="8.6.6.4", before="K alone", right=(255, 255, 255, 255)),
    Handed(number="09a", what="layer's usage, no AS", clause="8.11.4.4", before="hidden", right=CYAN),
    Handed(number="10", what="JPEG 2000, alpha unasked", clause="8.9.5.1", before="K 128", right=BLACK),
    Handed(number="13a", what="40 spots, one used", clause="8.6.6.4", before="refused", right=(128, 0, 0, 0)),
    Handed(number="13b", what="30 spots used", clause="8.6.6.4", before="refused", right=(136, 0, 0, 0)),
    Handed(
        number="14", what="bytes after the end", clause="7.5.5", before="refused as truncated", right=CYAN
    ),
    Handed(number="15", what="list of blend modes", clause="11.3.5", before="Normal", right=(255, 0, 255, 0)),
    Handed(
        number="16", what="text knockout", clause="9.3.8", before="C 189", right=(128, 0, 0, 0), at=(17, 43)
    ),
    Handed(
        number="18",
        what="spot under overprint, RGB group",
        clause="8.6.7",
        before="the spot erased",
        right=(255, 51, 204, 26),
    ),
    Handed(
        number="19", what="transfer function", clause="8.4.5", before="ignored", warning="transfer-function"
    ),
    Handed(number="20", what="alternate for printing", clause="8.9.5.4", before="base image", right=CYAN),
    Handed(number="21", what="link's appearance", clause="12.5.5", before="not printed", right=CYAN),
    Handed(
        number="22a",
        what="CMYK, RGB intent, blend mode",
        clause="8.6.4.4",
        before="173 172 168 190",
        right=BLACK,
    ),
    Handed(number="22b", what="the same, a group", clause="8.6.4.4", before="173 172 168 190", right=BLACK),
    Handed(
        number="22c", what="CMYK, another intent", clause="8.6.4.4", before="181 173 176 178", right=BLACK
    ),
    Handed(
        number="90", what="opaque page, RGB group", clause="11.4.7", before="173 172 168 190", right=BLACK
    ),
    Handed(number="91", what="TrimBox without area", clause="14.11.2", before="refused", warning="box"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class HandedRow:
    """A case as it is printed now; texts for the table."""

    number: str
    what: str
    clause: str
    before: str
    right: str
    after: str
    is_right: bool


def handed_rows(
    folder: Path, profile: Path | None, progress: Callable[[str], None] = lambda _: None
) -> tuple[HandedRow, ...]:
    """Draw every case that a folder has a file of. profile: by which colours that are no ink become ink.

    RequestError: it has no file of any. The two output intents of 06 are to decide themselves: no profile there.
    """
    rows = []
    for case in HANDED:
        for path in sorted(folder.glob(f"{case.number}_*.pdf")):
            progress(path.stem)
            rows.append(_row(case, path, None if case.number == "06" else profile))
    if not rows:
        raise RequestError(
            folder, "there is no PDF of a known case", remedy="give the folder of handed cases"
        )
    return tuple(rows)


def _row(case: Handed, path: Path, profile: Path | None) -> HandedRow:
    inks: tuple[int, ...] = ()
    try:
        with PdfJob(path, profile=profile) as job:
            page = job.page(1, DPI)
        column, row = case.at
        inks = tuple(page.cmyk[row, column].tolist())
        kinds = {warning.kind for warning in page.warnings}
    except InputError:
        kinds = {REFUSED}
    as_stated = case.warning in kinds if case.warning else REFUSED not in kinds
    painted = case.right is None or (
        bool(inks) and max(abs(a - b) for a, b in zip(inks, case.right, strict=True)) <= TOLERANCE
    )
    return HandedRow(
        number=case.number,
        what=case.what,
        clause=case.clause,
        before=case.before,
        right=_shown(case.right or (), case.warning),
        after=_shown(inks if case.right or not kinds else (), " ".join(sorted(kinds))),
        is_right=as_stated and painted,
    )


def _shown(inks: tuple[int, ...], kinds: str) -> str:
    return ", ".join(filter(None, (" ".join(map(str, inks)), kinds)))
