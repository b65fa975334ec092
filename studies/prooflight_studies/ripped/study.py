"""Whether a promise holds on a press that rips PDFs itself, prints dots, and varies as real sheets do.

Good prints that alarm and misprints that are caught, by RIP, world, and what the press file states; as built, and after
the press has learned good prints of other pages.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight import __version__
from prooflight.commissioning.training.real_pages import FEWEST_REAL, recalibrated
from prooflight.detectors.base import StoredArrays
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.variation import AMOUNTS
from prooflight.detectors.optional import ScannedPage
from prooflight.errors import RequestError
from prooflight.press.artefact import Press
from prooflight.simulation.worlds import measured_digest, worlds_digest
from prooflight_studies.harness.operating import share_with_interval
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.result_cache import digest_of, minutes_spent, run_pieces, stored
from prooflight_studies.harness.versions import ALGORITHMS
from prooflight_studies.ripped.printing import (
    COPIES_A_PIECE,
    OUR_RASTER,
    RIPS,
    STATEMENTS,
    PrintPiece,
    PrintWork,
    fits,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight_studies.harness.result_cache import Rows

WORLDS: Final = ("press", "measured")
TEMPLATE: Final = "ripped"
PAGES: Final = {"press": "ripped", "measured": "ripped-measured", "either": "ripped-either"}
"""Names of the page, by the world that the press file states."""
GOOD_A_MISPRINT: Final = COPIES_A_PIECE
"""Good prints of a page for each misprint of it: a piece has one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FalseAlarmPlan:
    """What is printed."""

    seed: int
    prints: int = 320
    """Least number of good prints that are judged in each row, each page equally often."""
    learned: int = 40
    """Good prints of pages of development that a press learns, one of each page; 0: none learns."""
    rips: tuple[str, ...] = tuple(rip.name for rip in RIPS)
    worlds: tuple[str, ...] = WORLDS
    statements: tuple[str, ...] = STATEMENTS

    def __post_init__(self) -> None:
        """Check the numbers; RequestError."""
        if 0 < self.learned < FEWEST_REAL:
            what = f"a press cannot learn from {self.learned} pages"
            raise RequestError("learned", what, remedy=f"give 0, or {FEWEST_REAL} or more")
        for given, choices, of in (
            (self.rips, [rip.name for rip in RIPS], "rip"),
            (self.worlds, WORLDS, "world"),
            (self.statements, STATEMENTS, "statement"),
        ):
            for name in given:
                if name not in choices:
                    raise RequestError(
                        of, f"there is no {name!r}", remedy=f"choose from {', '.join(choices)}"
                    )

    def pieces(self, judged: Sequence[str], learned_from: Sequence[str]) -> list[PrintPiece]:
        """Return the pieces, those that are judged first; what one page shares follows one another."""
        pages = spread(judged, self.prints)
        copies = -(-self.prints // len(pages))
        misprints = range(max(copies // GOOD_A_MISPRINT, 1))
        return [
            PrintPiece(
                page=page,
                number=_number(page),
                rip=rip,
                world=world,
                good=tuple(range(first, min(first + COPIES_A_PIECE, of_page))),
                misprints=tuple(misprints[part : part + 1]) if is_judged else (),
                judged=is_judged,
                # Our own raster is expected whatever is stated, so that its rows are those of every run.
                statements=STATEMENTS if rip == OUR_RASTER else self.statements,
            )
            for is_judged, of_kind, of_page in (
                (True, pages, copies),
                (False, spread(learned_from, self.learned), 1),
            )
            for page in of_kind
            for rip in self.rips
            for world in self.worlds
            for part, first in enumerate(range(0, of_page, COPIES_A_PIECE))
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class FalseAlarmRow:
    """Counts of one RIP in one world under one statement."""

    world: str
    rip: str
    title: str
    statement: str
    learned: int
    """Good pages that were learned; 0: as built."""
    promise: float
    """Share of good pages that may alarm, by the press's own promise. [-]"""
    good: int
    alarms: int
    uninspected: int
    false_alarms: str
    misprints: int
    caught: int
    misprints_caught: str
    pages_with_alarms: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FalseAlarmResults:
    """Figures of the page."""

    build: str
    seed: int
    press: str
    press_digest: str
    varies: str
    """World that the press file states in ``[variation]``."""
    promise: float
    pages: int
    left_out: tuple[str, ...]
    """Pages that no row has, and why."""
    minutes: float
    worlds_sha256: str
    measured_sha256: str
    rows: tuple[FalseAlarmRow, ...]


def run_false_alarm_study(
    press: Path,
    pages: Path,
    out: Path,
    *,
    cache: Path,
    plan: FalseAlarmPlan,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> FalseAlarmResults:
    """Print and judge the pages of a folder, and write ripped.md, or ripped-measured.md of a press that varies so.

    Pages of odd numbers are judged; those of even numbers are of development, and learned. The page also has the rows
    that other runs with this cache, seed and press have made, with as many copies as are made of every page.
    RequestError: the press has no detector of ours, or too few pages fit it.
    """
    loaded = Press.load(press)
    if "matched_filter" not in loaded.detectors:
        raise RequestError(
            "press", "was not trained for the matched filter", remedy="give one of `prooflight press build`"
        )
    folder = cache / "device-cmyk"
    folder.mkdir(parents=True, exist_ok=True)
    usable, left_out = list[str](), list[str]()
    for pdf in sorted(pages.glob("*.pdf")):
        progress(f"analysing {pdf.stem}")
        why = fits(pdf, loaded, folder)
        if why:
            left_out.append(f"{pdf.stem}: {why}")
        else:
            usable.append(pdf.stem)
    judged = [page for page in usable if _number(page) % 2]
    learned_from = [page for page in usable if not _number(page) % 2]
    if not judged or len(learned_from) < plan.learned:
        what = f"holds {len(judged)} pages of odd and {len(learned_from)} of even numbers that fit this press"
        raise RequestError(pages, what, remedy=f"give one or more, and {plan.learned} or more")
    pieces = plan.pieces(judged, learned_from)
    digest = digest_of(
        {
            "seed": plan.seed,
            "press": loaded.digest,
            "worlds": [worlds_digest(), measured_digest()],
            "algorithms": ALGORITHMS,
        }
    )
    work = PrintWork(press=press, pages=pages, folder=folder, seed=plan.seed)
    run_pieces(
        work,
        pieces,
        cache,
        digest=digest,
        processes=processes,
        progress=lambda done, total: progress(f"{done} of {total} parts printed and judged"),
    )
    possible = replace(plan, rips=tuple(rip.name for rip in RIPS), worlds=WORLDS).pieces(judged, learned_from)
    pieces = whole_rows(possible, stored(possible, cache, digest=digest))
    rows = run_pieces(work, pieces, cache, digest=digest, processes=1)
    results = FalseAlarmResults(
        build=__version__,
        seed=plan.seed,
        press=loaded.name,
        press_digest=loaded.digest,
        varies=loaded.variation.get("world", "press"),
        promise=_false_alarm_rate(loaded),
        pages=len({piece.page for piece in pieces if piece.judged}),
        left_out=tuple(left_out),
        minutes=minutes_spent(pieces, cache, digest=digest),
        worlds_sha256=worlds_digest(),
        measured_sha256=measured_digest(),
        rows=tuple(counts(rows, loaded)),
    )
    write_page(out / f"{PAGES[results.varies]}.md", TEMPLATE, results)
    return results


def whole_rows(pieces: Sequence[PrintPiece], made: Sequence[PrintPiece]) -> list[PrintPiece]:
    """Return the pieces whose copies are made of every page of their row; those learned, where others are judged."""
    lacking = {_copies(piece) for piece in set(pieces) - set(made)}
    whole = [piece for piece in pieces if _copies(piece) not in lacking]
    judged = {(piece.rip, piece.world) for piece in whole if piece.judged}
    return [piece for piece in whole if (piece.rip, piece.world) in judged]


def _copies(piece: PrintPiece) -> tuple[object, ...]:
    return piece.rip, piece.world, piece.judged, piece.good


def counts(rows: Rows, press: Press) -> list[FalseAlarmRow]:
    """Return the counts of every RIP, world and statement, as built and after learning."""
    table = []
    for world in WORLDS:
        for rip in RIPS:
            for statement in STATEMENTS:
                of_row = (
                    (rows["world"] == world) & (rows["rip"] == rip.name) & (rows["statement"] == statement)
                )
                judged = of_row & rows["judged"]
                if not judged.any():
                    continue
                facts: dict[str, Any] = {
                    "world": world,
                    "rip": rip.name,
                    "title": rip.title,
                    "statement": statement,
                }
                facts |= {"learned": 0, "promise": _false_alarm_rate(press)}
                table.append(_counted(rows, judged, rows["alarm"][judged], facts=facts))
                if (of_learned := of_row & ~rows["judged"]).any():
                    alarm, learned = _learned(rows, of_learned, judged, press)
                    table.append(_counted(rows, judged, alarm, facts=facts | learned))
    return table


def _false_alarm_rate(press: Press) -> float:
    return model_of(press).guarantee.rate


def _counted(
    rows: Rows, judged: NDArray[np.bool_], alarm: NDArray[np.bool_], *, facts: dict[str, Any]
) -> FalseAlarmRow:
    good = rows["kind"][judged] == ""
    alarms, count = int((alarm & good).sum()), int(good.sum())
    caught, misprints = int((alarm & ~good).sum()), int((~good).sum())
    return FalseAlarmRow(
        **facts,
        good=count,
        alarms=alarms,
        uninspected=int((rows["uninspected"][judged] & good).sum()),
        false_alarms=share_with_interval(alarms, count),
        misprints=misprints,
        caught=caught,
        misprints_caught=share_with_interval(caught, misprints),
        pages_with_alarms=tuple(np.unique(rows["page"][judged][alarm & good]).tolist()),
    )


def _learned(
    rows: Rows, learned_from: NDArray[np.bool_], judged: NDArray[np.bool_], press: Press
) -> tuple[NDArray[np.bool_], dict[str, Any]]:
    """Return whether each judged print alarms once the press has learned others, how many those are and its promise.

    What was not inspected before stays so, and prints of another page are not learned, as `press learn` does.
    """
    places = np.flatnonzero(learned_from & ~rows["another"] & ~rows["uninspected"])
    good = [_scanned(rows, int(place)) for place in places]
    learned = recalibrated(
        press, good, {one.name: one.digest for one in good}, false_alarm_rate=_false_alarm_rate(press)
    )
    detector = model_of(learned)
    alarms = []
    for place in np.flatnonzero(judged):
        scanned = _scanned(rows, int(place))
        score = detector.score_again(StoredArrays(scanned.evidence, detector.name))
        decision = detector.decide(
            score, *(float(scanned.evidence[name]) for name in ("glyphs", "floor_mm2"))
        )
        alarms.append(decision.misprint and not rows["uninspected"][place])
    return np.array(alarms, bool), {"learned": len(good), "promise": _false_alarm_rate(learned)}


def _scanned(rows: Rows, place: int) -> ScannedPage:
    name = str(rows["page"][place])
    evidence = {
        kept: np.asarray(rows[column][place])
        for kept, column in (
            ("wrong_page", "another"),
            ("values", "values"),
            ("page_features", "features"),
            ("glyphs", "glyphs"),
            ("floor_mm2", "floor_mm2"),
        )
    }
    return ScannedPage(
        name=name,
        score=float(rows["score"][place]),
        evidence=evidence,
        digest=name,
        variation=np.zeros((len(AMOUNTS), 2), np.float32),  # of no say in a verdict
        design=name,
    )


def spread(pages: Sequence[str], count: int) -> list[str]:
    """Return at most ``count`` of the pages, spread evenly over them."""
    if count >= len(pages):
        return list(pages)
    return [pages[(2 * place + 1) * len(pages) // (2 * count)] for place in range(count)]


def _number(page: str) -> int:
    digits = "".join(letter for letter in page if letter.isdecimal())
    if not digits:
        raise RequestError(page, "has no number", remedy="name pages like d007.pdf: odd ones are judged")
    return int(digits)
