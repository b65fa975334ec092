"""``prooflight study`` and ``prooflight bench``, where the studies are installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight_studies.commands import bench, marks, paper, plant, records, rip, running, study, world

if TYPE_CHECKING:
    import typer


def register(app: typer.Typer) -> None:
    """Add the commands to ``prooflight``."""
    for command in (
        *(world.corpus, world.worlds, world.registration, world.calibration),
        *(paper.paper, paper.robustness, paper.design, marks.ranking, marks.stress, marks.golden),
        *(running.running, running.soak),
        *(running.gate, running.cameras, running.console, running.feedback),
        *(rip.content, rip.rip, rip.zones, marks.visible),
        *(marks.real, plant.plant, records.records, records.cluster),
    ):
        study.app.command()(command)
    app.add_typer(study.app, name="study")
    app.command()(bench.bench)
