"""The command line: read, call, show. Exit 0 done, 1 ``inspect`` found a misprint, 2 the input cannot be used."""

from __future__ import annotations

import sys

import click
import typer

from prooflight import __version__
from prooflight.cli import job, press
from prooflight.cli.show import errors
from prooflight.errors import ProoflightError

UNUSABLE_INPUT = 2
INTERRUPTED = 130

app = typer.Typer(
    name="prooflight",
    help="Predicts what a line camera must see of each printed page, compares, and decides: pass or stop.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
job.register(app)
app.add_typer(press.app, name="press")


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
        code = app(arguments, standalone_mode=False)
    except ProoflightError as error:
        errors.print(f"prooflight: {error}", markup=False, highlight=False, soft_wrap=True)
        return UNUSABLE_INPUT
    except click.ClickException as error:
        error.show()
        return UNUSABLE_INPUT
    except OSError as error:
        where = error.filename or "system"
        errors.print(
            f"prooflight: {where}: {error.strerror or error}", markup=False, highlight=False, soft_wrap=True
        )
        return UNUSABLE_INPUT
    except (KeyboardInterrupt, click.Abort):
        errors.print("prooflight: interrupted")
        return INTERRUPTED
    return code if isinstance(code, int) else 0
