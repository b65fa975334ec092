"""``prooflight job prepare``: the designs of a job prepared once, for every later run of it on a press."""

from __future__ import annotations

from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.cli.options import ClusterAt, JobPath, PressArtefact, Profile
from prooflight.cli.workers import workers
from prooflight.errors import RequestError

DISK_GB = 10.0


def prepare(
    job: JobPath,
    press: PressArtefact,
    profile: Profile = None,
    disk: Annotated[
        float, typer.Option("--disk", metavar="GB", help="Most that all prepared jobs take.", min=0.1)
    ] = DISK_GB,
    cluster: ClusterAt = None,
) -> None:
    """Prepare the pages of a job for a press, so that `watch` of both starts at once.

    Prepared pages are identified by the content of job and press, and by this version of the program. The least
    recently used jobs are removed where all take more than --disk. Pages that are stored already remain, so that a
    command that was stopped continues where it ended.
    """
    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.prepared_store import PreparedStore, clean
    from prooflight.pages.parallel import Files
    from prooflight.press.artefact import Press
    from prooflight.press.pages import job_source
    from prooflight_line.run.sheet_inspector import PrepareDesign

    loaded = Press.load(press)
    inspector = Inspector(loaded)
    source = job_source(job, loaded, profile=profile)
    store = PreparedStore.of(inspector, source)
    if store is None:
        what = f"press {loaded.name} is not trained, or uses its own RIP, so nothing can be stored for it"
        raise RequestError(press, what, remedy="leave `job prepare` out: each run prepares the job")
    with source.open() as opened:
        lacking = [number for number in range(1, len(opened) + 1) if not store.holds(number)]
    work = PrepareDesign(source=source, store=store)
    files: Files[int] = Files(of_work=source.files)
    with workers(cluster) as on:
        done = enumerate(map(work, lacking)) if on is None else on.as_finished(work, lacking, files=files)
        for place, content in show.progress(done, total=len(lacking), what="preparing"):
            store.put(lacking[place], content)
    clean(store.folder.parent, most_bytes=round(disk * 1e9), keep=store.folder)
    show.written(store.folder)
