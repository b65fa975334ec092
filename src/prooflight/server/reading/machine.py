"""The machine as it stands: presses and jobs that the console was given, and the camera as the last run tells of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from prooflight.errors import ProoflightError
from prooflight.inspection.registry import promises
from prooflight.pages.layout.plan import facts_plan
from prooflight.press.artefact import Press

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight.journal.records import PageRecord, RunRow


@dataclass(frozen=True, slots=True, kw_only=True)
class PressFacts:
    """One press artefact; trouble: why it cannot be read, and then nothing else is known of it."""

    file: str
    trouble: str = ""
    name: str = ""
    digest: str = ""
    width_mm: float = 0.0
    """That its line sees."""
    pixels: int = 0
    pixel_mm: float = 0.0
    line_mm: float = 0.0
    sensors: tuple[str, ...] = ()
    promises: tuple[tuple[str, str], ...] = ()
    """Of each detector that it has: name and promise."""
    misprint_rate: float = 0.0
    false_alarm_cents: float = 0.0
    missed_cents: float = 0.0
    press_file: str = ""
    """Text that it was built from; empty: it does not hold it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFacts:
    """One job."""

    file: str
    megabytes: float | None
    """None: it is gone."""
    is_folder: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFacts:
    """What is known of a camera: the console itself holds none, whoever watches the press does."""

    run: RunRow
    going: bool
    sheet: PageRecord | None
    """The last sheet of which some of the scan is kept; None: of none."""


def press_facts(path: Path) -> PressFacts:
    """Of one artefact."""
    try:
        press = Press.load(path)
        promised = tuple(promises(press).items())
    except (OSError, ProoflightError) as error:
        return PressFacts(file=path.name, trouble=str(error))
    geometry, costs = press.geometry, press.costs
    return PressFacts(
        file=path.name,
        name=press.name,
        digest=press.digest,
        width_mm=geometry.pixels * geometry.pixel_pitch_mm,
        pixels=geometry.pixels,
        pixel_mm=geometry.pixel_pitch_mm,
        line_mm=geometry.line_pitch_mm,
        sensors=tuple(sensor.name for sensor in press.sensors),
        promises=promised,
        misprint_rate=costs.misprint_rate,
        false_alarm_cents=costs.false_alarm_cents,
        missed_cents=costs.missed_misprint_cents,
        press_file=press.origin.get("press_file", ""),
    )


def job_facts(path: Path) -> JobFacts:
    """Of one job."""
    try:
        if path.is_dir():
            held = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
            return JobFacts(file=path.name, megabytes=held / 1e6, is_folder=True)
        return JobFacts(file=path.name, megabytes=path.stat().st_size / 1e6)
    except OSError:
        return JobFacts(file=path.name, megabytes=None)


def camera_facts(run: RunRow | None, recent: Sequence[PageRecord]) -> CameraFacts | None:
    """By the last run; None: there was none. recent: its last sheets, in order."""
    if run is None:
        return None
    seen = next((page for page in reversed(recent) if page.verdict.regions), None)
    return CameraFacts(run=run, going=run.state == "running", sheet=seen)


def settings_rows(run: RunRow) -> list[tuple[str, Any]]:
    """What a run was started with."""
    plan = facts_plan(run.facts.settings)
    told = dict(run.facts.settings) | ({} if plan is None else {"layout": plan.layout.words})
    told.pop("warnings", None)  # of the job, and shown with it
    return sorted((name, value) for name, value in told.items() if value is not None)
