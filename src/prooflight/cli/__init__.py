"""The command line, which parses, calls and prints. Exit codes are documented in ``exit_codes``."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from typing import Final

import typer
from typer.exceptions import TyperException

from prooflight import __version__
from prooflight.cli import faults
from prooflight.cli.commands import Commands
from prooflight.cli.exit_codes import INTERRUPTED, OWN_FAULT, UNUSABLE_INPUT
from prooflight.cli.show import errors
from prooflight.errors import ProoflightError, plain

LOADED_OBJECTS: Final = 300_000
"""More objects than the modules of a command have: `inspect` loads 220,000."""

app = typer.Typer(
    cls=Commands,
    name="prooflight",
    help="Predicts what a line camera must see of each printed page, compares, and decides: pass or stop.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(requested: bool) -> None:
    if requested:
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
    """Run a command and leave with its exit code (``exit_codes``); errors are one line on stderr."""
    # Threads of linear algebra wait busily, which costs each process 0.3 s at its start; processes share work here.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _collect_late()
    code = run(arguments)
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
        sys.exit(code)
    # Nobody reads any more: what is left must not be tried again while Python ends.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(code)


def _collect_late() -> None:
    """Put off the first cyclic garbage collection until a command has loaded its modules, of which nothing is garbage.

    Python collects after each 700 new objects, which takes a tenth of the time of loading.
    """
    usual = gc.get_threshold()

    def collected(phase: str, _counts: dict[str, int]) -> None:
        if phase == "start":
            gc.set_threshold(*usual)
            gc.callbacks.remove(collected)

    gc.set_threshold(LOADED_OBJECTS, *usual[1:])
    gc.callbacks.append(collected)


def run(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    with faults.logged(given) as log:
        try:
            return _called(given)
        except TyperException as error:
            return _misused(error)
        except ProoflightError as error:
            return _unusable(str(error))
        except KeyboardInterrupt:
            faults.report("stopped")
            return INTERRUPTED
        except OSError as error:
            return _unusable(f"{plain(error.filename or 'system')}: {error.strerror or error}")
        except MemoryError as error:
            return _unusable(
                f"memory ran out ({error or 'nothing is left'}); lower the resolution, or close other programs"
            )
        except Exception:
            log.exception("this is a fault of Prooflight itself")
            return OWN_FAULT


def _called(given: list[str]) -> int:
    """Call the command, not by the program's own method, which exits with 1, a misprint, in many other cases."""
    try:
        with typer.main.get_command(app).make_context("prooflight", list(given), obj=tuple(given)) as context:
            context.command.invoke(context)
        sys.stdout.flush()
    except typer.Exit as exit_:
        return exit_.exit_code
    except SystemExit as exit_:
        return exit_.code if isinstance(exit_.code, int) else 0
    return 0


def _misused(error: TyperException) -> int:
    """Report a command that was called incorrectly; a call without arguments shows the help."""
    context = getattr(error, "ctx", None)
    message = error.format_message()
    if context is not None and message == context.get_help():
        errors.print(message, highlight=False, soft_wrap=True)
    else:
        path = "prooflight" if context is None else context.command_path
        faults.report(f"{message.removesuffix('.')}; see `{path} --help`")
    return UNUSABLE_INPUT


def _unusable(why: str) -> int:
    faults.report(why)
    return UNUSABLE_INPUT
