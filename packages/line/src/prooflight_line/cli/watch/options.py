"""Options of ``prooflight watch``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from prooflight_line.cli.watch.sources import REMEDY

MOST_SHEETS: Final = 10_000_000
"""Largest number of sheets: three weeks at 5 sheets a second."""
MOST_LINES: Final = 1_000_000
"""Largest number of lines from trigger to trigger: 100 m of paper."""
MOST_THREADS: Final = 256
HOUR_S: Final = 3600.0

SourceOption = Annotated[str, typer.Option(metavar="SOURCE", help=REMEDY)]
SheetsOption = Annotated[
    int | None,
    typer.Option(
        help="Number of sheets printed, the job repeated as needed; default once.", min=1, max=MOST_SHEETS
    ),
]
DeadlineMsOption = Annotated[
    float,
    typer.Option(
        "--deadline",
        metavar="MS",
        help="Longest time from a page's last line to its verdict.",
        min=1,
        max=1e3 * HOUR_S,
    ),
]
StallSOption = Annotated[
    float,
    typer.Option(
        "--stall",
        metavar="SECONDS",
        help="Time without a line after which that is announced.",
        min=0.1,
        max=24 * HOUR_S,
    ),
]
JournalOption = Annotated[
    str | None,
    typer.Option(metavar="URL", help="Journal: sqlite:///FILE, a file, or `none`; default the user's."),
]
KeepOption = Annotated[str, typer.Option(help="Evidence stored: all, misprints or none.")]
SampleOption = Annotated[
    float,
    typer.Option(
        metavar="SHARE", help="Share of the passing sheets that people are asked to label.", min=0, max=1
    ),
]
CustomerOption = Annotated[
    str, typer.Option(metavar="NAME", help="For whom the job is; the console searches by it.")
]
FalseAlarmsOption = Annotated[
    float,
    typer.Option(help="Number of false alarms of the run level per 100,000 pages.", min=1e-6, max=1e4),
]
TriggerOption = Annotated[
    int | None,
    typer.Option(
        metavar="LINES",
        help="Lines from page to page; default sheets are found by their edges.",
        min=1,
        max=MOST_LINES,
    ),
]
FramedOption = Annotated[bool, typer.Option("--framed", help="Raw lines come in blocks with headers.")]
CameraOption = Annotated[
    Path | None,
    typer.Option(metavar="PRESS.toml", help="Press file whose [camera] sets up the camera of --source."),
]
PlantOption = Annotated[
    Path | None,
    typer.Option(metavar="PRESS.toml", help="Press file whose [gate] and [plant] are served."),
]
ThreadsOption = Annotated[
    int | None,
    typer.Option(
        help="Number of inspecting threads; default one a core. From four on, each two have a process of their own.",
        min=1,
        max=MOST_THREADS,
    ),
]
StartAtOnceOption = Annotated[
    bool,
    typer.Option(
        "--start-at-once",
        help=(
            "Read lines before all designs are ready; sheets whose design is not ready are not inspected, but the "
            "simulated drum waits for them."
        ),
    ),
]
FollowOption = Annotated[
    bool, typer.Option("--follow/--no-follow", help="Follow slow changes of lamp and paper.")
]
WorldOption = Annotated[str, typer.Option(help="World of the drum: ideal, press or measured.")]
MisprintOption = Annotated[
    str | None,
    typer.Option(metavar="KIND[:SEVERITY],...", help="Misprints on some of the drum's prints, in turn."),
]
EveryOption = Annotated[int, typer.Option(help="Period of misprints, in prints.", min=1)]
FaultEveryOption = Annotated[
    int | None,
    typer.Option(help="Period of faults of the drum's paper path or camera, in sheets.", min=4),
]
ServeOption = Annotated[
    bool, typer.Option("--serve", help="Show the run in the console, a process of its own: see `serve`.")
]
ServePortOption = Annotated[
    int, typer.Option("--serve-port", metavar="PORT", help="Port of the console.", min=0, max=65_535)
]
TraysOption = Annotated[
    Path | None,
    typer.Option("--trays", metavar="FILE", help="The controller's log of its trays, for the console."),
]
ResumeOption = Annotated[
    bool, typer.Option("--resume", help="Continue the journal's last run, which broke off.")
]
QueueOption = Annotated[
    bool, typer.Option("--queue", help="JOB is a hot folder: print the next job of its queue, see `queue`.")
]
OnStartOption = Annotated[
    bool,
    typer.Option(
        "--on-start",
        help="With --queue: print each job when an operator starts it in the console, until Ctrl-C.",
    ),
]
StartedOption = Annotated[
    str, typer.Option("--started", metavar="KEY", hidden=True, help="With --queue: print this job alone.")
]
