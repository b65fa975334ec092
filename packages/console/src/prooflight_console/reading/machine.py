"""The machine: presses and jobs of the console, and the camera as the last run reports it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from prooflight.detectors.registry import promises
from prooflight.errors import ProoflightError
from prooflight.pages.layout.plan import facts_plan
from prooflight.press.artefact import Press

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight_line.journal.records import PageRecord, RunRow


@dataclass(frozen=True, slots=True, kw_only=True)
class PressFacts:
    """Facts of a press artefact; with ``trouble``, why it cannot be read, all others are empty."""

    file: str
    trouble: str = ""
    name: str = ""
    digest: str = ""
    width_mm: float = 0.0
    """Width that the camera's line covers."""
    pixels: int = 0
    pixel_mm: float = 0.0
    line_mm: float = 0.0
    sensors: tuple[str, ...] = ()
    promises: tuple[tuple[str, str], ...] = ()
    """Name and promised false-alarm rate of each of its detectors, as text."""
    misprint_rate: float = 0.0
    false_alarm_cents: float = 0.0
    missed_cents: float = 0.0
    press_file: str = ""
    """Text of the press file that it was built from; empty if it holds none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFacts:
    """Facts of a job."""

    file: str
    megabytes: float | None
    """Size; None if the job is missing."""
    is_folder: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFacts:
    """Facts of the camera, which is held by the process that watches the press, not by the console."""

    run: RunRow
    going: bool
    sheet: PageRecord | None
    """The last sheet with a stored part of its scan; None if there is none."""


def press_facts(path: Path) -> PressFacts:
    """Return the facts of a press artefact."""
    try:
        press = Press.load(path)
        rates = tuple(promises(press).items())
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
        promises=rates,
        misprint_rate=costs.misprint_rate,
        false_alarm_cents=costs.false_alarm_cents,
        missed_cents=costs.missed_misprint_cents,
        press_file=press.origin.get("press_file", ""),
    )


def job_facts(path: Path) -> JobFacts:
    """Return the facts of a job."""
    try:
        if path.is_dir():
            size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
            return JobFacts(file=path.name, megabytes=size / 1e6, is_folder=True)
        return JobFacts(file=path.name, megabytes=path.stat().st_size / 1e6)
    except OSError:
        return JobFacts(file=path.name, megabytes=None)


def camera_facts(run: RunRow | None, recent: Sequence[PageRecord]) -> CameraFacts | None:
    """Return the camera's facts by the last run; None if there was none. recent: its last sheets in order."""
    if run is None:
        return None
    seen = next((page for page in reversed(recent) if page.verdict.regions), None)
    return CameraFacts(run=run, going=run.state == "running", sheet=seen)


def settings_rows(run: RunRow) -> list[tuple[str, Any]]:
    """Return the settings that a run was started with, as rows."""
    plan = facts_plan(run.facts.settings)
    settings = dict(run.facts.settings) | ({} if plan is None else {"layout": plan.layout.text})
    settings.pop("warnings", None)  # those of the job are shown with the job
    return sorted((name, value) for name, value in settings.items() if value is not None)
