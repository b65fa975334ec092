"""The command line: read, call, show. Exit 0 done, 1 ``inspect`` found a misprint, 2 the input cannot be used."""

from __future__ import annotations

import sys

import typer

from prooflight import __version__
from prooflight.cli import (
    bench,
    calibrate,
    camera,
    chart,
    job,
    press,
    runs,
    study,
    study_detectability,
    study_golden,
    study_paper,
    study_press,
    study_running,
    study_soak,
    study_world,
    watch,
)
from prooflight.cli.exit_codes import UNUSABLE_INPUT
from prooflight.cli.show import errors
from prooflight.errors import ProoflightError

app = typer.Typer(
    name="prooflight",
    help="Predicts what a line camera must see of each printed page, compares, and decides: pass or stop.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
job.register(app)
app.command()(bench.bench)
app.add_typer(press.app, name="press")
app.add_typer(chart.app, name="chart")
app.add_typer(camera.app, name="camera")
study_world.register(study.app)
study_paper.register(study.app)
study_press.register(study.app)
study_golden.register(study.app)
study_detectability.register(study.app)
study_running.register(study.app)
study_soak.register(study.app)
app.add_typer(study.app, name="study")
app.command()(calibrate.calibrate)
runs.register(app)
app.command()(watch.watch)


def _version(asked: bool) -> None:
    if asked:
        sys.stdout.write(f"prooflight {__version__}\n")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Show the version."
    ),
) -> None:
    pass


def main(arguments: list[str] | None = None) -> None:
    """Run a command and leave with its exit code; errors are one line on stderr."""
    sys.exit(run(arguments))


def run(arguments: list[str] | None = None) -> int:
    """Run a command; returns its exit code."""
    try:
        app(arguments)
    except SystemExit as exit_:
        return exit_.code if isinstance(exit_.code, int) else 0
    except ProoflightError as error:
        return _unusable(str(error))
    except OSError as error:
        return _unusable(f"{error.filename or 'system'}: {error.strerror or error}")
    return 0


def _unusable(why: str) -> int:
    errors.print(f"prooflight: {why}", markup=False, highlight=False, soft_wrap=True)
    return UNUSABLE_INPUT
