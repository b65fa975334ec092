"""Slow changes, print after print of the press world: a density that drifts, a streak that grows, a lamp that ages."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.cmyk import INK_NAMES
from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.variation import determined_shares, fitted_amounts
from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.prints import Print
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of
from prooflight_line.run.following import Adapting
from prooflight_line.run.monitor.evidence import columns, columns_mm
from prooflight_line.run.monitor.run import PageEvidence, RunMonitor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight_line.run.monitor.run import Announcement

LEAST_DETERMINED: Final = 0.5
"""Least share of an ink's amount that a page must determine for its drift to be monitored on it."""
DRIFT_A_PAGE: Final = 0.0005
"""Drift a page: 0.05 % of the density."""
TOLERANCE: Final = 0.07
"""Least amount of worlds.toml's misprint `density`."""
GATE_INK: Final = 0.02
"""Least amount of worlds.toml's misprint `streak`, as a share of a whole ink."""
STREAK_A_PAGE: Final = 0.0002
STREAK_MM: Final = 0.5
LAMP_A_PAGE: Final = 0.0001
"""Loss of light a page: a lamp that loses 1 % in 100 pages, much faster than lamps do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Creep:
    """Slow changes, by sheet."""

    gain: float = 0.0
    """Change of one ink's gain, a page."""
    ink: int = 0
    """Index of that ink; C, M, Y, K."""
    streak: float = 0.0
    """Black ink added in a column, a page."""
    lamp: float = 0.0
    """Share of the light lost, a page."""
    good_pages: int = 0
    """Number of pages before the change begins."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CreepRun:
    """Run of one press on one day: print, analyse, accumulate."""

    press: Press
    pages: tuple[Page, ...]
    ready: tuple[PreparedPage, ...]

    @classmethod
    def of(cls, press: Press, pages: Iterable[Page], *, ink: int | None = None, most: int = 6) -> CreepRun:
        """Prepare designs; for an ink, only those on which the press's sensors distinguish it from the others."""
        geometry, sensors = press.geometry, press.sensors
        usable = []
        for page in pages:
            expected = predict(page, sensors=sensors, geometry=geometry)
            ready = prepare_page(page, expected, sensors=sensors, geometry=geometry, fringes=press.fringes)
            scan = np.rint(expected.expected_dn).clip(0).astype(np.uint16)
            if ink is not None:
                analysis = analyse(ready, scan)
                if (
                    not analysis.registration.located
                    or determined_shares(analysis.fit)[ink] < LEAST_DETERMINED
                ):
                    continue
            usable.append((page, ready))
            if len(usable) == most:
                break
        return cls(press=press, pages=tuple(one for one, _ in usable), ready=tuple(one for _, one in usable))

    def run(
        self,
        creep: Creep,
        sheets: int,
        *,
        seed: int,
        stop: Callable[[Announcement], bool],
        follow: bool = True,
    ) -> dict[str, Any]:
        """Run until an announcement for which ``stop`` is true; return the true state at that moment."""
        press, rng = self.press, stream(seed, "drift-prints")
        session = Session.draw(amounts_of(press), press, stream(seed, "drift-session"))
        monitor = RunMonitor.begin(
            sensors=[one.name for one in press.sensors], columns_mm=columns_mm(press), costs=press.costs
        )
        adapting = Adapting.begin(press)
        first_out, other = None, 0
        for sheet in range(sheets):
            since = max(sheet - creep.good_pages, 0)
            page, print_ = self._print(creep, since, sheet, session, rng)
            gain = session.ink_gain[creep.ink] + print_.ink_gain[creep.ink]
            if first_out is None and since and abs(gain) > TOLERANCE:
                first_out = since
            scan = fast_scan(page, press, session, print_, rng=rng)
            evidence = self._evidence(sheet, scan)
            if follow:
                adapting.see(evidence.values)
            for one in monitor.see(sheet, evidence, pages_left=2000):
                if stop(one):
                    return {
                        "announced": since,
                        "first_out": first_out,
                        "level": one.level,
                        "x_mm": one.x_mm,
                        "action": one.action,
                        "text": one.text,
                        "others": other,
                        "light": [round(float(one), 5) for one in adapting.level[: len(press.sensors)]],
                    }
                other += 1
        return {"announced": None, "first_out": first_out, "others": other}

    def _print(
        self, creep: Creep, since: int, sheet: int, session: Session, rng: np.random.Generator
    ) -> tuple[Page, Print]:
        page = self.pages[sheet % len(self.pages)]
        print_ = Print.draw(session, self.press, page, rng)
        gain = print_.ink_gain.copy()
        gain[creep.ink] += creep.gain * since
        print_ = replace(print_, ink_gain=gain, lamp=print_.lamp * (1 - creep.lamp * since))
        if creep.streak * since:
            page = replace(page, cmyk=streaked(page, creep.streak * since, rng))
        return page, print_

    def _evidence(self, sheet: int, scan: NDArray[np.uint16]) -> PageEvidence:
        press, ready = self.press, self.ready[sheet % len(self.ready)]
        analysis = analyse(ready, scan)
        if not analysis.registration.located:
            return PageEvidence()
        left_mm = press.geometry.left_mm(ready.page.width_mm) + analysis.registration.placement.shift_mm[0]
        excess, light = analysis.sums.columns[:2, 0]
        at_mm = (np.arange(excess.shape[1]) + 0.5) * analysis.sums.pixel_mm - left_mm
        return PageEvidence(
            values=fitted_amounts(analysis, press.sensors),
            columns=columns(excess, light, np.asarray(at_mm), columns_mm(press).size),
        )


def streaked(page: Page, share: float, rng: np.random.Generator) -> Any:
    """Return the page's raster with this share of black added in a column, a third of the way across, dithered."""
    cmyk = page.cmyk.copy()
    middle, half = cmyk.shape[1] // 3, max(round(STREAK_MM / page.pixel_mm / 2), 1)
    column = cmyk[:, middle - half : middle + half, 3]
    more = np.floor(255 * share + rng.random(column.shape)).astype(np.int64)
    column[:] = np.minimum(column + more, 255).astype(np.uint8)
    return cmyk


def drift_row(
    run: CreepRun, *, ink: int, seeds: range, good_pages: int, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Return how soon a drift of one ink is announced, and the first print that is out of tolerance."""
    rows, name = [], INK_NAMES[ink]
    for seed in seeds:
        creep = Creep(gain=DRIFT_A_PAGE, ink=ink, good_pages=good_pages)
        row = run.run(creep, good_pages + 160, seed=seed, stop=lambda one: one.channel == f"gain-{name}")
        rows.append(row)
        progress(f"{name} after {good_pages} good pages, day {seed}: {row['announced']} ({row['first_out']})")
    announced = [row["announced"] for row in rows]
    before = [
        row["announced"] is not None and (row["first_out"] is None or row["announced"] < row["first_out"])
        for row in rows
    ]
    detected = [page for page in announced if page is not None]
    return {
        "ink": name,
        "fringes": run.press.fringes,
        "sensors": len(run.press.sensors),
        "designs": len(run.pages),
        "good_pages": good_pages,
        "runs": len(rows),
        "announced": len(detected),
        "before_first_out": int(sum(before)),
        "median_page": float(np.median(detected)) if detected else None,
        "pages": announced,
        "first_out": [row["first_out"] for row in rows],
        "others": int(sum(row["others"] for row in rows)),
        "example": next((row["text"] for row in rows if row.get("text")), ""),
    }


def streak_row(run: CreepRun, *, seeds: range, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the ink at which a growing streak is announced, while an ageing lamp is tracked."""
    rows = []
    for seed in seeds:
        creep = Creep(streak=STREAK_A_PAGE, lamp=LAMP_A_PAGE, good_pages=40)
        row = run.run(creep, 40 + 400, seed=seed, stop=lambda one: one.kind == "streak")
        rows.append(row)
        progress(f"streak, day {seed}: {row['announced']}")
    width_mm = run.pages[0].width_mm
    detected = [row for row in rows if row["announced"] is not None]
    return {
        "runs": len(rows),
        "fringes": run.press.fringes,
        "announced": len(detected),
        "ink_percent": [round(100 * STREAK_A_PAGE * row["announced"], 2) for row in detected],
        "gate_ink_percent": 100 * GATE_INK,
        "off_mm": [round(abs(row["x_mm"] - width_mm / 3), 2) for row in detected],
        "followed_percent": [round(100 * row["light"][0], 2) for row in detected],
        "lamp_percent": [round(-100 * LAMP_A_PAGE * row["announced"], 2) for row in detected],
        "example": next((row["text"] for row in detected), ""),
    }
