"""``prooflight study`` and ``prooflight bench``, where the studies are installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight_studies.commands import (
    bench,
    cameras,
    console,
    content,
    feedback,
    gate,
    golden,
    paper,
    plant,
    press,
    real,
    records,
    rip,
    running,
    soak,
    study,
    visible,
    world,
    zones,
)

if TYPE_CHECKING:
    import typer


def register(app: typer.Typer) -> None:
    """Add the commands to ``prooflight``."""
    for command in (
        *(world.misprints, world.corpus, world.worlds, world.registration, world.calibration),
        *(
            paper.paper,
            paper.robustness,
            paper.design,
            press.press,
            press.ranking,
            press.stress,
            golden.golden,
        ),
        *(running.running, soak.soak),
        *(gate.gate, cameras.cameras, console.console, feedback.feedback),
        *(content.content, rip.rip, zones.zones, visible.visible),
        *(real.real, plant.plant, records.records),
    ):
        study.app.command()(command)
    app.add_typer(study.app, name="study")
    app.command()(bench.bench)
