"""Options of ``prooflight watch``, in groups of what they are about."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final

import typer

from prooflight.cli.event_log import LogOption
from prooflight.cli.options import (
    Detector,
    JobPath,
    Json,
    LayoutOption,
    OnDevice,
    PressArtefact,
    Profile,
    Seed,
    Zones,
)
from prooflight_line.run.settings import DEADLINE_S, STALL_S

REMEDY: Final = (
    "write drum[:PAGES_PER_S], replay:PATH, raw:PATH (- is standard input), tcp:HOST:PORT or camera:ID[+ID]"
)
MOST_SHEETS: Final = 10_000_000
"""Largest number of sheets: three weeks at 5 sheets a second."""
MOST_LINES: Final = 1_000_000
"""Largest number of lines from trigger to trigger: 100 m of paper."""
MOST_THREADS: Final = 256
HOUR_S: Final = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetOptions:
    """Sheets on which the job is printed."""

    sheets: Annotated[
        int | None,
        typer.Option(
            help="Number of sheets printed, the job repeated as needed; default once.", min=1, max=MOST_SHEETS
        ),
    ] = None
    layout: LayoutOption = None


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionOptions:
    """Detector and times of the inspection."""

    detector: Detector = None
    device: OnDevice = "cpu"
    deadline_ms: Annotated[
        float,
        typer.Option(
            "--deadline",
            metavar="MS",
            help="Longest time from a page's last line to its verdict.",
            min=1,
            max=1e3 * HOUR_S,
        ),
    ] = 1e3 * DEADLINE_S
    stall_s: Annotated[
        float,
        typer.Option(
            "--stall",
            metavar="SECONDS",
            help="Time without a line after which a warning is shown.",
            min=0.1,
            max=24 * HOUR_S,
        ),
    ] = STALL_S


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordOptions:
    """Records of the run."""

    journal: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Journal: sqlite:///FILE, a file, or `none`; default the user's."),
    ] = None
    keep: Annotated[str, typer.Option(help="Evidence stored: all, misprints or none.")] = "misprints"
    sample: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            help="Share of the passing sheets that people are asked to label.",
            min=0,
            max=1,
        ),
    ] = 0.0
    customer: Annotated[
        str, typer.Option(metavar="NAME", help="Customer of the job; the console can search for it.")
    ] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineOptions:
    """Lines of the source, and how sheets are found in them."""

    trigger: Annotated[
        int | None,
        typer.Option(
            metavar="LINES",
            help="Lines from page to page; default: sheets are detected by their edges.",
            min=1,
            max=MOST_LINES,
        ),
    ] = None
    framed: Annotated[bool, typer.Option("--framed", help="Raw lines come in blocks with headers.")] = False
    camera: Annotated[
        Path | None,
        typer.Option(metavar="PRESS.toml", help="Press file whose [camera] sets up the camera of --source."),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PaceOptions:
    """Threads, and what a run does while it prepares and ages."""

    threads: Annotated[
        int | None,
        typer.Option(
            help=(
                "Number of inspecting threads; default one a core. From four on, each two have a process of "
                "their own."
            ),
            min=1,
            max=MOST_THREADS,
        ),
    ] = None
    start_at_once: Annotated[
        bool,
        typer.Option(
            "--start-at-once",
            help=(
                "Read lines before all designs are ready; sheets whose design is not ready are not inspected, but the "
                "simulated drum waits for them."
            ),
        ),
    ] = False
    follow: Annotated[
        bool, typer.Option("--follow/--no-follow", help="Follow slow changes of lamp and paper.")
    ] = True


@dataclass(frozen=True, slots=True, kw_only=True)
class DrumOptions:
    """Prints and faults of the simulated drum."""

    world: Annotated[str, typer.Option(help="World of the drum: ideal, press or measured.")] = "press"
    misprint: Annotated[
        str | None,
        typer.Option(metavar="KIND[:SEVERITY],...", help="Misprints on some of the drum's prints, in turn."),
    ] = None
    every: Annotated[int, typer.Option(help="Period of misprints, in prints.", min=1)] = 10
    fault_every: Annotated[
        int | None,
        typer.Option(help="Period of faults of the drum's paper path or camera, in sheets.", min=4),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """Zones and colour profile of the job's pages."""

    zones: Zones = None
    profile: Profile = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsoleOptions:
    """The console next to the run."""

    serve: Annotated[
        bool,
        typer.Option("--serve", help="Show the run in the console, a process of its own: see `serve`."),
    ] = False
    serve_port: Annotated[
        int, typer.Option("--serve-port", metavar="PORT", help="Port of the console.", min=0, max=65_535)
    ] = 8080
    trays: Annotated[
        Path | None,
        typer.Option("--trays", metavar="FILE", help="The controller's log of its trays, for the console."),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StartOptions:
    """Job that the run begins, or run that it continues."""

    queue: Annotated[
        bool,
        typer.Option("--queue", help="JOB is a hot folder: print the next job of its queue, see `queue`."),
    ] = False
    on_start: Annotated[
        bool,
        typer.Option(
            "--on-start",
            help="With --queue: print each job when an operator starts it in the console, until Ctrl-C.",
        ),
    ] = False
    started: Annotated[
        str,
        typer.Option("--started", metavar="KEY", hidden=True, help="With --queue: print this job alone."),
    ] = ""
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the journal's last run, which was interrupted.")
    ] = False


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchOptions:
    """All options of the command, in the order of ``--help``."""

    job: JobPath
    press: PressArtefact
    source: Annotated[str, typer.Option(metavar="SOURCE", help=REMEDY)]
    repeats: SheetOptions = field(default_factory=SheetOptions)
    inspection: InspectionOptions = field(default_factory=InspectionOptions)
    record: RecordOptions = field(default_factory=RecordOptions)
    false_alarms: Annotated[
        float,
        typer.Option(help="Number of false alarms of the run level per 100,000 pages.", min=1e-6, max=1e4),
    ] = 1.0
    lines: LineOptions = field(default_factory=LineOptions)
    plant: Annotated[
        Path | None,
        typer.Option(metavar="PRESS.toml", help="Press file whose [gate] and [plant] are served."),
    ] = None
    pace: PaceOptions = field(default_factory=PaceOptions)
    drum: DrumOptions = field(default_factory=DrumOptions)
    pages: PageOptions = field(default_factory=PageOptions)
    seed: Seed = 1
    console: ConsoleOptions = field(default_factory=ConsoleOptions)
    start: StartOptions = field(default_factory=StartOptions)
    json: Json = False
    log: LogOption = "text"
