"""``prooflight serve --demo``: a job printed live on the simulated press, watched, and shown in the console."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from prooflight.cli import show
from prooflight.errors import ProoflightError
from prooflight_line.journal.start import Start, StartFile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_console.running import Listening

FOLDER: Final = Path("prooflight-demo")
JOB, PRESS, JOURNAL = "sample-job.pdf", "two-sensors.press", "console.sqlite"
MISPRINTS: Final = "streak:0.9,spots-voids:0.9,missing-content:0.9,ghost-smear:0.9"
EVERY: Final = 7
FAULT_EVERY: Final = 60
PAGES_PER_S: Final = 1.0
SHEETS: Final = 100_000
"""Number of sheets: a day at one a second."""
SEED: Final = 1


def live_demo(listening: Listening) -> None:
    """Serve the console, create job and press if they do not exist yet, and watch the press print until Ctrl-C.

    The console is there from the beginning, and shows how far all that has got.
    """
    from prooflight_console import alongside

    journal, job, press = (FOLDER / name for name in (JOURNAL, JOB, PRESS))
    FOLDER.mkdir(exist_ok=True)
    console = alongside.start(
        journal=journal.absolute(),
        press=press.absolute(),
        job=job.absolute(),
        port=listening.port,
        trays=None,
        announce=None,
    )
    start_file = StartFile(journal=journal)
    try:
        _prepare(job, press, start_file)
        _watch(job, press)
    finally:
        start_file.clear()
        console.terminate()
        console.join()


def _watch(job: Path, press: Path) -> None:
    from prooflight_line.cli.watch.command import watch
    from prooflight_line.cli.watch.options import (
        DrumOptions,
        InspectionOptions,
        PaceOptions,
        RecordOptions,
        SheetOptions,
        WatchOptions,
    )

    watch(
        WatchOptions(
            job=job,
            press=press,
            source=f"drum:{PAGES_PER_S:g}",
            repeats=SheetOptions(sheets=SHEETS),
            inspection=InspectionOptions(deadline_ms=2000.0),
            record=RecordOptions(journal=str(FOLDER / JOURNAL)),
            pace=PaceOptions(start_at_once=True),
            drum=DrumOptions(misprint=MISPRINTS, every=EVERY, fault_every=FAULT_EVERY),
            seed=SEED,
        )
    )


def _prepare(job: Path, press: Path, start_file: StartFile) -> None:
    """Compose the job, and build the press meanwhile, where they do not exist yet."""
    from prooflight.cli.jobs.demonstration import SAMPLE_SIZE_MM, sample_job
    from prooflight.pages.job import JobSource
    from prooflight.pages.parallel import worker_processes
    from prooflight.press.artefact import Press

    with worker_processes(1) as composer:
        composed = None
        if not job.exists():
            show.steps(quiet=False)("composing the sample job")
            start_file.write(Start(stage="job"))
            composed = composer.submit(sample_job, job, seed=SEED)
        try:
            Press.load(press)
        except (OSError, ProoflightError):
            sizes: Sequence[tuple[float, float]] = (SAMPLE_SIZE_MM,)
            if composed is None:
                with JobSource(path=job, dpi=1.0).open() as opened:
                    sizes = opened.page_sizes_mm
            _build(press, sizes, start_file)
        if composed is not None:
            composed.result()


def _build(press: Path, sizes_mm: Sequence[tuple[float, float]], start_file: StartFile) -> None:
    from prooflight.cli.jobs.demonstration import demo_press

    say = show.steps(quiet=False)
    start_file.write(Start(stage="press"))

    def noted(part: str) -> None:
        say(part)
        start_file.write(Start(stage="press", part=part))

    built = demo_press(
        sizes_mm,
        world="press",
        seed=SEED,
        progress=noted,
        shown=lambda days, total, what: start_file.noted(
            show.progress(iter(days), total=total, what=what), total=total, stage="press", part=what
        ),
    )
    built.save(press)


def ended(error: typer.Exit) -> int:
    """Return the exit code of a demonstration, whose misprints are intended."""
    return 0 if error.exit_code in (1, 3) else error.exit_code
