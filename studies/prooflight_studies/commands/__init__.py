"""``prooflight study`` and ``prooflight bench``, where the studies are installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight_studies.commands import (
    bench,
    cluster,
    content,
    detector,
    marks,
    paper,
    plant,
    records,
    rip,
    running,
    study,
    world,
)

if TYPE_CHECKING:
    import typer


def register(app: typer.Typer) -> None:
    """Add the commands to ``prooflight``."""
    for command in (
        *(world.corpus, world.worlds, world.registration, world.calibration),
        *(
            paper.paper,
            paper.robustness,
            paper.design,
            detector.ranking,
            detector.stress,
            marks.golden,
        ),
        *(running.running, running.soak),
        *(running.gate, running.cameras, running.console, running.feedback),
        *(content.content, rip.rip, content.zones, marks.visible),
        *(marks.real, plant.plant, records.records, cluster.cluster),
    ):
        study.app.command()(command)
    app.add_typer(study.app, name="study")
    app.command()(bench.bench)
