"""Journal rows of runs with one known cause, made of what ``inspect`` said of prints with known defects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import NAME_OF_INK
from prooflight.detectors.verdict import Verdict
from prooflight.press.parts import HeadBlock, PartsBlock, RollerBlock
from prooflight.rng import stream
from prooflight_line.journal.records import PageRecord
from prooflight_studies.plant.prints import REGISTER_MM, WEAKER

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.detectors.verdict import Region
    from prooflight.scans.geometry import ScanGeometry
    from prooflight_studies.plant.prints import DefectPrint

CAUSES: Final = ("fuser", "drum", "belt", "nozzle", "spot", "density", "register", "paper")
"""The eight causes of the blind test."""
BEYOND: Final = ("unlisted roller",)
"""A cause without a part in the press file, beyond the eight: it must not be given a name."""
ROLLERS_MM: Final = {
    "fuser": 94.2,
    "pressure roller": 109.9,
    "drum": 942.5,
    "blanket cylinder": 534.1,
    "belt": 2400.0,
    "feed roller": 62.8,
    "pinch roller": 47.1,
}
"""Circumferences of the press of the test, close to each other among the small rollers, as on a press."""
UNLISTED_MM: Final = (70.0, 1500.0)
NOZZLE_UM: Final = 25_400 / 600
HEADS: Final = tuple(
    HeadBlock.model_validate(
        {
            "name": f"{name} bar",
            "ink": letter,
            "first_nozzle_mm": at,
            "nozzle_pitch_um": NOZZLE_UM,
            "nozzles": 5000,
        }
    )
    for at, (letter, name) in zip((-0.9, -1.2, -0.6, -1.0), NAME_OF_INK.items(), strict=True)
)
PARTS: Final = PartsBlock(
    rollers=tuple(RollerBlock(name=name, circumference_mm=mm) for name, mm in ROLLERS_MM.items()),
    heads=HEADS,
)
SHEETS: Final = 100
BEGINS: Final = 30
"""A defect begins at one of the first so many sheets and stays."""
PAGE_MM: Final = (210.0, 297.0)
GAP_MM: Final = 13.0
"""Distance from a page's end to the next page's beginning; sheets come with a standard deviation of ``JITTER_MM``."""
JITTER_MM: Final = 0.5
SHIFT_MM: Final = 0.76
"""Greatest shift of a print in the press world (``worlds.toml``)."""
FALSE_SHARE: Final = 0.01
"""Share of sheets with a mark that has nothing to do with the cause: the rate of false alarms."""
SLIP: Final = 0.001
"""Standard deviation of a roller's circumference from the stated one. assumed: a third of the tolerance."""
DRIFT: Final = (0.10, 0.25)
"""Drift of a density over the run, as a share of the ink; its tolerance is 0.07."""
NEAR_MM: Final = 5.0
"""Distance within which a mark is that of the defect."""
STEP_MM: Final = (0.25, 0.6)
"""Step of a register; its tolerance is 0.2 mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Defect:
    """One run, and the truth of it."""

    cause: str
    records: tuple[PageRecord, ...]
    begins: int
    name: str = ""
    """Name of the roller, or ink of the head or plane."""
    distance_mm: float = 0.0
    nozzle: int = 0


class Runs:
    """Maker of runs from a library of prints; geometry: of the camera that saw them."""

    def __init__(self, library: Sequence[DefectPrint], geometry: ScanGeometry, seed: int) -> None:
        """Sort the library; ValueError: it lacks a kind of print."""
        self._geometry, self._seed = geometry, seed
        self._prints = {
            what: [one for one in library if one.what == what]
            for what in ("spot", "nozzle", "density", "register", "paper", "good")
        }
        self.nozzle_designs = sorted({one.design for one in self._prints["nozzle"] if _seen(one)})
        """Designs on which the failing nozzle was seen as a streak: its cause is asked for on no other."""
        missing = [what for what, prints in self._prints.items() if not prints]
        if missing or not self.nozzle_designs:
            message = f"the library has no prints of {', '.join(missing) or 'a nozzle that is seen'}"
            raise ValueError(message)

        self.response = {
            "density": [_stated(one, "gain-{}") / (WEAKER - 1) for one in self._prints["density"]],
            "register": [_stated(one, "register-{}-x") / REGISTER_MM for one in self._prints["register"]],
        }
        """Share of a change that a run records of the ink that is off, of each print."""

    def run(self, cause: str, number: int) -> Defect:
        """Return run ``number``, which has this cause."""
        rng = stream(self._seed, "plant-defect", number)
        begins = int(rng.integers(BEGINS))
        rows = self._good(rng)
        defect = Defect(cause=cause, records=(), begins=begins)
        if cause in ROLLERS_MM or cause in BEYOND:
            nominal = ROLLERS_MM.get(cause) or float(self._unlisted(rng))
            distance = nominal * (1 + SLIP * rng.standard_normal())
            self._roll(rows, distance, begins, rng)
            defect = replace(defect, name=cause if cause in ROLLERS_MM else "", distance_mm=distance)
        elif cause == "nozzle":
            head, nozzle = self._streak(rows, begins, rng)
            defect = replace(defect, name=head, nozzle=nozzle)
        elif cause == "spot":
            for sheet in rng.choice(SHEETS, int(rng.integers(1, 4)), replace=False).tolist():
                at = float(rng.uniform(5, PAGE_MM[0] - 5)), float(rng.uniform(5, PAGE_MM[1] - 5))
                _mark(rows, sheet, self._draw("spot", rng), at)
        elif cause == "paper":
            for sheet in range(begins, SHEETS):
                # Clouds are anywhere: the few prints of the library must not seem to have them in few places.
                _mark(
                    rows,
                    sheet,
                    self._draw("paper", rng),
                    (0.0, 0.0),
                    turned_mm=float(rng.uniform(0, PAGE_MM[1])),
                )
        else:
            defect = replace(defect, name=self._trend(rows, cause, begins, rng))
        return replace(defect, records=tuple(rows))

    def null(self, number: int, marks: int) -> tuple[PageRecord, ...]:
        """Return a run of which marks lie anywhere, half of them in one column of 3 mm, without a cause."""
        rng = stream(self._seed, "plant-null", number)
        rows = self._good(rng)
        column = float(rng.uniform(20, PAGE_MM[0] - 20))
        for at in range(marks):
            x = column + float(rng.uniform(-1.5, 1.5)) if at % 2 else float(rng.uniform(5, PAGE_MM[0] - 5))
            y = float(rng.uniform(0, PAGE_MM[1]))
            _mark(rows, int(rng.integers(SHEETS)), self._draw("spot", rng), (x, y))
        return tuple(rows)

    def _draw(self, what: str, rng: np.random.Generator) -> DefectPrint:
        prints = self._prints[what]
        return prints[int(rng.integers(len(prints)))]

    def _good(self, rng: np.random.Generator) -> list[PageRecord]:
        """Return good sheets, with what was measured of good prints, and a false mark at times."""
        pitch, rows, place = self._geometry.line_pitch_mm, list[PageRecord](), 0.0
        for sheet in range(SHEETS):
            measured = self._draw("good", rng).amounts
            shift = tuple(float(one) for one in rng.uniform(-SHIFT_MM, SHIFT_MM, 2))
            rows.append(
                PageRecord(
                    sheet=sheet,
                    job_page=sheet,
                    verdict=Verdict(page=f"p{sheet + 1:04}", verdict="good", shift_mm=(shift[0], shift[1])),
                    late=False,
                    first_line=round(place / pitch),
                    time_s=0.2 * sheet,
                    nuisance=measured,
                )
            )
            place += PAGE_MM[1] + GAP_MM + JITTER_MM * float(rng.standard_normal())
        for sheet in np.flatnonzero(rng.random(SHEETS) < FALSE_SHARE).tolist():
            at = float(rng.uniform(5, PAGE_MM[0] - 5)), float(rng.uniform(5, PAGE_MM[1] - 5))
            _mark(rows, sheet, self._draw("spot", rng), at)
        return rows

    def _roll(
        self, rows: list[PageRecord], distance_mm: float, begins: int, rng: np.random.Generator
    ) -> None:
        """Mark the paper at every turn; where a sheet lies is known to the camera by its lines and its shift."""
        across = float(rng.uniform(10, PAGE_MM[0] - 10))
        tops = [self._top(row) for row in rows]
        place = tops[begins] + float(rng.uniform(0, distance_mm))
        for sheet in range(begins, SHEETS):
            shift = rows[sheet].verdict.shift_mm
            assert shift is not None
            while place < tops[sheet] + PAGE_MM[1]:
                if place >= tops[sheet]:
                    at = across - shift[0], place - tops[sheet]
                    _mark(rows, sheet, self._draw("spot", rng), at)
                place += distance_mm

    def _top(self, row: PageRecord) -> float:
        geometry, shift = self._geometry, row.verdict.shift_mm
        assert shift is not None
        return row.first_line * geometry.line_pitch_mm + geometry.lead_in_mm + shift[1]

    def _streak(self, rows: list[PageRecord], begins: int, rng: np.random.Generator) -> tuple[str, int]:
        """Let a nozzle fail: all sheets are of one design, in whose place of the streak the library's prints are."""
        design = int(rng.choice(self.nozzle_designs))
        prints = [one for one in self._prints["nozzle"] if one.design == design]
        head = next((one for one in HEADS if one.ink == prints[0].ink), HEADS[-1])
        nozzle = int(rng.integers(400, 4400))
        x = head.first_nozzle_mm + (nozzle - 1) * head.nozzle_pitch_um / 1000
        for sheet in range(begins, SHEETS):
            _mark(rows, sheet, prints[int(rng.integers(len(prints)))], (x, 0.0))
        return head.name, nozzle

    def _trend(self, rows: list[PageRecord], cause: str, begins: int, rng: np.random.Generator) -> str:
        """Let an ink drift or step, and return it.

        What is recorded of every ink is what a run records of one print of the library, in proportion to the change.
        """
        shown, stated = self._draw(cause, rng), {}
        for name, value in shown.amounts.items():
            of_cause = name.startswith("gain-" if cause == "density" else "register-")
            stated[name] = value if of_cause else 0.0
        sign = 1 if rng.random() < 0.5 else -1
        if cause == "density":
            amount, tolerance, printed = sign * float(rng.uniform(*DRIFT)), 0.07, WEAKER - 1
        else:
            amount, tolerance, printed = sign * float(rng.uniform(*STEP_MM)), 0.2, REGISTER_MM
        for sheet in range(begins, SHEETS):
            row, share = rows[sheet], (sheet - begins) / (SHEETS - 1 - begins)
            change = amount if cause == "register" else amount * share
            nuisance = {
                name: value + change / printed * stated.get(name, 0.0) for name, value in row.nuisance.items()
            }
            rows[sheet] = replace(row, nuisance=nuisance)
            if abs(change) > tolerance:
                _mark(rows, sheet, self._draw_of(cause, shown.design, rng), (0.0, 0.0))
        return NAME_OF_INK[shown.ink]

    def _draw_of(self, what: str, design: int, rng: np.random.Generator) -> DefectPrint:
        prints = [one for one in self._prints[what] if one.design == design]
        return prints[int(rng.integers(len(prints)))]

    def _unlisted(self, rng: np.random.Generator) -> float:
        """Draw a circumference that is further from all of the press file than their tolerances."""
        while True:
            distance = float(np.exp(rng.uniform(*np.log(UNLISTED_MM))))
            if all(abs(distance / one - 1) > 0.02 for one in ROLLERS_MM.values()):
                return distance


def _stated(shown: DefectPrint, name: str) -> float:
    """Return the amount that a run records of the ink that is off; 0: none."""
    return shown.amounts.get(name.format(NAME_OF_INK[shown.ink]), 0.0)


def _seen(shown: DefectPrint) -> bool:
    """Return whether a failing nozzle was seen as a streak, where it is."""
    regions = shown.verdict.regions if shown.verdict.kind == "streak" else ()
    return any(abs(one.x_mm + one.width_mm / 2 - shown.x_mm) < NEAR_MM for one in regions)


def _mark(
    rows: list[PageRecord],
    sheet: int,
    shown: DefectPrint,
    at_mm: tuple[float, float],
    *,
    turned_mm: float = 0.0,
) -> None:
    """Add what was said of a print to a row, moved from the print's place of the defect to another one.

    turned_mm: distance by which regions go down the page, and over its end to its beginning.
    """
    if shown.verdict.verdict != "misprint":
        return
    row = rows[sheet]
    off = at_mm[0] - shown.x_mm, at_mm[1] - shown.y_mm
    moved = [_moved(_turned(region, turned_mm), off) for region in shown.verdict.regions]
    regions = tuple(region for region in moved if region is not None)
    if regions or not shown.verdict.regions:
        kind = row.verdict.kind or shown.verdict.kind
        verdict = replace(
            row.verdict, verdict="misprint", kind=kind, regions=(*row.verdict.regions, *regions)
        )
        rows[sheet] = replace(row, verdict=verdict)


def _turned(region: Region, down_mm: float) -> Region:
    if not down_mm or region.height_mm > PAGE_MM[1] / 2:
        return region
    return replace(region, y_mm=round((region.y_mm + down_mm) % (PAGE_MM[1] - region.height_mm), 2))


def _moved(region: Region, off_mm: tuple[float, float]) -> Region | None:
    """Return a region at another place, to the journal's hundredths; None: it is off the page."""
    x, y = region.x_mm + off_mm[0], region.y_mm + off_mm[1]
    inside = x + region.width_mm > 0 and y + region.height_mm > 0 and x < PAGE_MM[0] and y < PAGE_MM[1]
    return replace(region, x_mm=round(x, 2), y_mm=round(y, 2)) if inside else None
