"""``prooflight job prepare``: the designs of a job prepared once, for every later run of it on a press."""

from __future__ import annotations

from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.cli.options import JobPath, PressArtefact, Profile
from prooflight.errors import RequestError

DISK_GB = 10.0


def prepare(
    job: JobPath,
    press: PressArtefact,
    profile: Profile = None,
    disk: Annotated[
        float, typer.Option("--disk", metavar="GB", help="Most that all prepared jobs take.", min=0.1)
    ] = DISK_GB,
) -> None:
    """Prepare the pages of a job for a press, so that `watch` of both begins at once.

    What was prepared is found again by the content of job and press, and by this version of the program. The least
    recently used jobs are removed where all take more than --disk.
    """
    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.prepared_store import PreparedStore, clean
    from prooflight.press.artefact import Press
    from prooflight.press.pages import PressJob, job_source
    from prooflight_line.run.sheet_inspector import SheetInspector

    loaded = Press.load(press)
    inspector = Inspector(loaded)
    source = job_source(job, loaded, profile=profile)
    store = PreparedStore.of(inspector, source)
    if store is None:
        what = f"press {loaded.name} is not trained, or its own RIP draws, and nothing can be stored for it"
        raise RequestError(press, what, remedy="leave `job prepare` out: each run prepares the job")
    sheets = SheetInspector(inspector=inspector)
    with PressJob(source, loaded) as opened:
        numbers = range(1, len(opened) + 1)
        for number in show.progress(numbers, total=len(opened), what="preparing"):
            if store.load(number) is None:
                store.save(number, sheets.prepare(opened.page(number)))
    clean(store.folder.parent, most_bytes=round(disk * 1e9), keep=store.folder)
    show.written(store.folder)
