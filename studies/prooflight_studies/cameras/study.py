"""``prooflight study cameras``: effects of cameras on a run, on loopback, measured part by part; writes ``cameras.md``.

Each part's figures are stored as soon as they are measured, so that the page can combine parts measured separately:
those that need an idle machine have a command of their own.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight_studies.cameras.deaths import away_figures, death_figures, taken_figures
from prooflight_studies.cameras.job import job_rows
from prooflight_studies.cameras.losses import loss_figures, unseen_rows
from prooflight_studies.cameras.rig import rig
from prooflight_studies.cameras.speed import PROTOTYPE_MB_S, RATES_MB_S, speed_rows
from prooflight_studies.cameras.step import step_figures
from prooflight_studies.harness.page import measure_parts, write_page

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight_studies.cameras.rig import Rig

PARTS: Final = ("job", "losses", "unseen", "deaths", "away", "step", "speed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Size of each part of the study."""

    designs: int
    """Number of designs on which the press is trained."""
    prints: int
    sheets: int
    losses: int
    loss_sheets: int
    loss_prints: int
    """Number of prints on whose sheets the losses fall, repeatedly."""
    unseen_prints: int
    deaths: int
    taken: int
    away_minutes: float
    step_sheets: int
    rates_mb_s: tuple[float, ...]
    seconds: float
    """Duration of each rate."""

    @classmethod
    def of(cls, *, quick: bool) -> Plan:
        """Return the plan of the whole study, or of a minute's version."""
        if quick:
            return cls(
                designs=24,
                prints=3,
                sheets=6,
                losses=12,
                loss_sheets=8,
                loss_prints=3,
                unseen_prints=2,
                deaths=1,
                taken=1,
                away_minutes=0.2,
                step_sheets=12,
                rates_mb_s=(8.0,),
                seconds=1.0,
            )
        return cls(
            designs=48, prints=10, sheets=200, losses=1000, loss_sheets=500, loss_prints=100, unseen_prints=24,
            deaths=20, taken=3, away_minutes=60.0, step_sheets=2000, rates_mb_s=RATES_MB_S, seconds=12.0,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """Paths and plan of the study."""

    out: Path
    cache: Path
    plan: Plan
    seed: int
    press: Path | None
    """Press trained for all detectors, for the part ``unseen``.

    None: the job's press, trained for the matched filter.
    """
    progress: Callable[[str], None]

    def run(self, parts: tuple[str, ...], *, again: bool = False) -> dict[str, Any]:
        """Measure parts that are not stored yet; again: all parts named."""
        return measure_parts(
            parts,
            lambda part: getattr(self, f"_{part}")(),
            self.cache / "cameras" / f"figures-{self.plan.prints}-{self.plan.sheets}-{self.seed}.json",
            again=again,
            progress=self.progress,
            write=self._write,
        )

    def _job(self) -> list[dict[str, Any]]:
        return job_rows(self._rig(), sheets=self.plan.sheets, progress=self.progress)

    def _losses(self) -> dict[str, Any]:
        return loss_figures(
            self._rig(self.plan.loss_prints),
            losses=self.plan.losses,
            sheets=self.plan.loss_sheets,
            seed=self.seed,
            progress=self.progress,
        )

    def _unseen(self) -> list[dict[str, Any]]:
        press = self.press or self._rig().press
        return unseen_rows(press, prints=self.plan.unseen_prints, seed=self.seed, progress=self.progress)

    def _deaths(self) -> dict[str, Any]:
        figures = death_figures(self._rig(), deaths=self.plan.deaths, progress=self.progress)
        return figures | {"taken": taken_figures(times=self.plan.taken, progress=self.progress)}

    def _away(self) -> dict[str, Any]:
        return away_figures(self._rig(), minutes=self.plan.away_minutes, progress=self.progress)

    def _step(self) -> dict[str, Any]:
        return step_figures(sheets=self.plan.step_sheets, seed=self.seed, progress=self.progress)

    def _speed(self) -> list[dict[str, Any]]:
        plan = self.plan
        return speed_rows(
            seconds=plan.seconds, rates_mb_s=plan.rates_mb_s, seed=self.seed, progress=self.progress
        )

    def _rig(self, prints: int | None = None) -> Rig:
        return rig(
            self.cache / "cameras",
            designs=self.plan.designs,
            prints=prints or self.plan.prints,
            seed=self.seed,
            progress=self.progress,
        )

    def _write(self, measured: dict[str, Any]) -> None:
        results = cameras_results(measured, seed=self.seed, plan=self.plan)
        write_page(self.out / "cameras.md", "cameras", results)


def cameras_results(measured: dict[str, Any], *, seed: int, plan: Plan) -> dict[str, Any]:
    """Return all figures of the page; None for parts that were not measured."""
    parts = {part: measured.get(part) for part in PARTS}
    return parts | {"seed": seed, "plan": asdict(plan), "prototype_mb_s": PROTOTYPE_MB_S}
