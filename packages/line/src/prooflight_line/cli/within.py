"""Commands that this package adds to groups of ``prooflight``: ``job prepare``, ``camera record``, ..."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import typer


def of_job(app: typer.Typer) -> None:
    """Add ``prooflight job prepare``."""
    from prooflight_line.cli.prepare import prepare

    app.command("prepare")(prepare)


def of_camera(app: typer.Typer) -> None:
    """Add the commands of ``prooflight camera`` for a connected camera."""
    from prooflight_line.cli.camera import line_cameras, set_up, view

    app.command("list")(line_cameras.list_cameras)
    app.command("features")(line_cameras.features)
    app.command("view")(view.view)
    app.command("record")(line_cameras.record)
    app.command("set-up")(set_up.set_up)
