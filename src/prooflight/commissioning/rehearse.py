"""Prints of a press that has not printed yet: designs on simulated press days, looked at as its scans will be."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from prooflight.comparing.nuisance import Spread
from prooflight.comparing.windows import window_statistics
from prooflight.deciding.calibrated import shows_another
from prooflight.deciding.families import all_said, samples
from prooflight.deciding.said import stated
from prooflight.deciding.tolerance import look, prepare_page
from prooflight.predicting.predict import predict
from prooflight.simulating.fast import fast_scan
from prooflight.simulating.misprints import KINDS, draw_misprint
from prooflight.simulating.prints import Print, together
from prooflight.simulating.scans import TRIES, passes_gate
from prooflight.simulating.session import Session
from prooflight.simulating.worlds import amounts_of, gate

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.acquiring.geometry import ScanGeometry
    from prooflight.acquiring.placement import Placement
    from prooflight.comparing.evidence import Evidence
    from prooflight.comparing.local_evidence import Scatter
    from prooflight.deciding.tolerance import Looked, PreparedPage
    from prooflight.pages.raster import Page
    from prooflight.predicting.predict import Prediction
    from prooflight.press import Press

    Rows = dict[str, NDArray[Any]]

DESIGNS_A_DAY: Final = 4
"""assumed: few, since days differ by more than prints of a day do."""
LONGEST: Final = 1.45
"""Height over width at which a page that is cut to the field is cut off: A4's and a little."""
SESSION, PRINT = 11, 12
"""What tells random numbers of days from those of designs."""


def good_spread(press: Press) -> Spread:
    """What good prints of a press scatter by: nothing where its ``[variation]`` says that nothing varies."""
    return Spread.none() if amounts_of(press).exact else Spread()


class Designs(Protocol):
    """Where page designs come from, as many as are asked for; small, and may be sent to worker processes."""

    def page(self, index: int) -> Page:
        """Design ``index``, from 0."""


def fitted(page: Page, geometry: ScanGeometry) -> Page:
    """A design as it enters the press; of one that is wider than the field, the middle."""
    if geometry.sees(page.width_mm):
        return page
    rows, columns = page.cmyk.shape[:2]
    width = int(geometry.field_mm / page.pixel_mm)
    height = min(rows, int(LONGEST * width))
    left, top = (columns - width) // 2, (rows - height) // 2
    return replace(page, cmyk=np.ascontiguousarray(page.cmyk[top : top + height, left : left + width]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressDay:
    """A press on one day."""

    press: Press
    pages: Designs
    session: Session

    @classmethod
    def of(cls, press: Press, pages: Designs, *, seed: int, first: int) -> PressDay:
        """The day on which design ``first`` is printed first."""
        rng = np.random.default_rng([seed, first, SESSION])
        return cls(press=press, pages=pages, session=Session.draw(amounts_of(press), press, rng))

    def page(self, index: int) -> Page:
        """A design as it enters the press."""
        return fitted(self.pages.page(index), self.press.geometry)

    def known(self, page: Page) -> tuple[PreparedPage, Prediction]:
        """What is known of a page ahead of its scans, and its prediction in its place."""
        expected = self.predicted(page)
        known = prepare_page(page, expected, sensors=self.press.sensors, geometry=self.press.geometry)
        return known, expected

    def predicted(self, page: Page, placement: Placement | None = None) -> Prediction:
        """By the press's tables."""
        where = {} if placement is None else {"placement": placement}
        return predict(page, sensors=self.press.sensors, geometry=self.press.geometry, threads=1, **where)

    def scan(
        self, page: Page, rng: np.random.Generator, *, moved: Placement | None = None
    ) -> NDArray[np.uint16]:
        """One more print of a page, as the camera records it; moved: by a misprint."""
        print_ = Print.draw(self.session, self.press, page, rng)
        if moved is not None:
            print_ = replace(print_, placement=together(print_.placement, moved))
        return fast_scan(page, self.press, self.session, print_, rng=rng)

    def looked(self, known: PreparedPage, scan: NDArray[np.uint16]) -> Looked:
        """A scan looked at as this press's are."""
        press = self.press
        return look(known, scan, sensors=press.sensors, geometry=press.geometry, spread=good_spread(press))

    def misprint(
        self, page: Page, expected: Prediction, kind: str, others: list[int], rng: np.random.Generator
    ) -> tuple[Page, Placement] | None:
        """What is printed instead, and where; None: no draw changes this page enough."""
        for _ in range(TRIES):
            drawn = draw_misprint(page, kind, float(rng.random()), others=others, fetch=self.page, rng=rng)
            if passes_gate(expected, self.predicted(drawn.page, drawn.placement), self.press, gate()):
                return drawn.page, drawn.placement
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterWork:
    """Good prints of a day's designs -> draws that ``learn_scatter`` learns from; travels to worker processes."""

    press: Press
    pages: Designs
    seed: int

    def __call__(self, designs: tuple[int, ...]) -> Rows:
        """Draws by name, (designs, ...)."""
        day = PressDay.of(self.press, self.pages, seed=self.seed, first=designs[0])
        drawn: dict[str, list[Any]] = defaultdict(list)
        for index in designs:
            rng = np.random.default_rng([self.seed, index, PRINT])
            page = day.page(index)
            known, _ = day.known(page)
            looked = day.looked(known, day.scan(page, rng))
            for name, values in samples(looked.sums, rng).items():
                drawn[name].append(values)
        return {name: np.stack(values) for name, values in drawn.items()}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SaidWork:
    """A good print of each of a day's designs, and a misprint if asked for -> what each scan says, a row each.

    Columns: design, kind ("" where good), values (statistics,), portrait, another (the scan shows another page);
    with ``compare`` also windows (3 sensors,), the paper's statistics.
    """

    press: Press
    pages: Designs
    seed: int
    scatter: Scatter
    misprints: bool
    compare: Callable[[Page, NDArray[np.uint16], Press], Evidence] | None = None

    def __call__(self, designs: tuple[int, ...]) -> Rows:
        """Rows in the order of designs; ``names`` of the statistics beside them."""
        day = PressDay.of(self.press, self.pages, seed=self.seed, first=designs[0])
        columns: dict[str, list[Any]] = defaultdict(list)
        names: list[str] = []
        for index in designs:
            rng = np.random.default_rng([self.seed, index, PRINT])
            page = day.page(index)
            known, expected = day.known(page)
            kind = KINDS[index % len(KINDS)]
            scans = {"": day.scan(page, rng)}
            if self.misprints:
                others = [other for other in designs if other != index]
                made = day.misprint(page, expected, kind, others, rng)
                if made is not None:
                    scans[kind] = day.scan(made[0], rng, moved=made[1])
            for of_kind, scan in scans.items():
                row = self._row(day, page, known, scan)
                names = row.pop("names")
                for name, value in (row | {"design": index, "kind": of_kind}).items():
                    columns[name].append(value)
        rows = {name: np.array(values) for name, values in columns.items()}
        return rows | {"kind": rows["kind"].astype("U16"), "names": np.array(names, "U48")}

    def _row(
        self, day: PressDay, page: Page, known: PreparedPage, scan: NDArray[np.uint16]
    ) -> dict[str, Any]:
        looked = day.looked(known, scan)
        said = all_said(looked.sums, looked.fit, looked.found, self.scatter)
        row: dict[str, Any] = {
            "values": stated(said),
            "portrait": known.portrait,
            "another": shows_another(looked.found),
            "names": [one.name for one in said],
        }
        if self.compare is not None:
            evidence = self.compare(page, scan, self.press)
            row["windows"] = window_statistics(evidence.block_z).ravel()
        return row
