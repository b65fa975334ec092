"""The program's commands by name: a command's module is loaded when it is called, and none to list them.

A command is Prooflight's own, or that of another package, which registers it by an entry point of ``GROUP``. The entry
point's name is the command's, ``watch``, or that of a command in one of Prooflight's own groups, ``camera.record``; its
value is a function that takes a ``typer.Typer`` and adds the command.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

import typer
from typer.core import TyperGroup

from prooflight.errors import RequestError

GROUP: Final = "prooflight.commands"
LINE: Final = "prooflight-line"
CONSOLE: Final = "prooflight-console"
STUDIES: Final = "prooflight-studies"
REMEDIES: Final = {
    LINE: f"pip install {LINE}",
    CONSOLE: f"pip install {CONSOLE}",
    STUDIES: "install it from the repository's folder studies",
}
"""How to install the packages whose commands are listed here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Listed:
    """A command as the program lists it."""

    module: str = ""
    """Module of ``prooflight.cli`` whose ``register`` adds the command to a ``typer.Typer``; "": that of another
    package."""
    what: str
    """Description of the command, shorter than a line."""
    package: str = ""
    """Package whose command it is; "": Prooflight itself."""


LISTED: Final = {
    "demo": Listed(module="jobs.command", what="Print a job with some misprints, and inspect it."),
    "rip": Listed(module="jobs.command", what="Write each page as a CMYK TIFF, as the press prints it."),
    "simulate": Listed(module="jobs.command", what="Print and scan a job on the simulated press."),
    "inspect": Listed(module="jobs.command", what="Compare scans with the job, and give one verdict a page."),
    "job": Listed(
        module="jobs.zones", what="Check and prepare a job before it is printed; make zones from its marks."
    ),
    "zones": Listed(module="jobs.zones", what="Price zones before they are in force; draw them."),
    "codes": Listed(
        module="jobs.codes", what="List a job's bar codes as this press's camera will read them."
    ),
    "watch": Listed(package=LINE, what="Inspect a press while it runs."),
    "queue": Listed(package=LINE, what="Take jobs from a hot folder, check and queue them."),
    "plant": Listed(package=LINE, what="Check the plant's gate and outlets; simulate a controller."),
    "runs": Listed(package=LINE, what="List all runs in the journal."),
    "run": Listed(package=LINE, what="Show, label, export, package, replay or reconcile one run; tidy up."),
    "verify": Listed(
        package=LINE, what="Verify the signed package of a run, and compute its verdicts again."
    ),
    "records": Listed(package=LINE, what="Bring journals of many presses into one PostgreSQL database."),
    "doctor": Listed(
        package=LINE, what="Check what this machine lacks, and measure the speed of an inspection."
    ),
    "backup": Listed(package=LINE, what="Back up a journal and all that belongs to it, while runs go on."),
    "restore": Listed(package=LINE, what="Verify a backup, and restore it; nothing is overwritten."),
    "serve": Listed(package=CONSOLE, what="Serve the console in a browser; manage its users."),
    "audit": Listed(package=CONSOLE, what="Check the record of actions in the console."),
    "press": Listed(module="press", what="Build a press artefact, show its content, train its detectors."),
    "camera": Listed(module="camera.command", what="Compute, measure, set up and record cameras."),
    "calibrate": Listed(module="calibrate", what="Compute a press's tables from scans of a printed chart."),
    "chart": Listed(module="chart", what="Validate ink models on charts, predict spectra, make charts."),
    "study": Listed(package=STUDIES, what="Regenerate a table or a figure of docs/results."),
    "bench": Listed(package=STUDIES, what="Measure speed, as ratios to peers in the same run."),
}
WITHIN: Final = {
    "job": {
        "prepare": Listed(package=LINE, what="Prepare the pages of a job for every later run on a press.")
    },
    "press": {
        "recalibrate": Listed(package=LINE, what="Set a press's threshold by labelled sheets."),
        "go-back": Listed(package=LINE, what="Take the last recalibration back."),
    },
    "camera": {
        "list": Listed(package=LINE, what="List the cameras that answer."),
        "features": Listed(package=LINE, what="List a camera's features, and set some of them."),
        "view": Listed(package=LINE, what="Show a camera live."),
        "record": Listed(package=LINE, what="Record a camera's lines."),
        "set-up": Listed(package=LINE, what="Set a line camera up step by step."),
    },
}
"""Commands that other packages add to Prooflight's own groups."""


class Commands(TyperGroup):
    """The group of all commands."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of commands that are there, in the order in which they are listed."""
        here = [name for name, one in LISTED.items() if one.module or name in _entries()]
        return here + [name for name in _entries() if name not in LISTED and "." not in name]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command; if its package is not installed, one that says so; None if there is none."""
        listed, entry = LISTED.get(cmd_name), _entries().get(cmd_name)
        if listed is not None and listed.module:
            command = commands_of(import_module(f"prooflight.cli.{listed.module}").register)[cmd_name]
            for name, one in _added(cmd_name).items():
                command.add_command(one, name)
            return command
        if entry is not None:
            return commands_of(entry.load())[cmd_name]
        return None if listed is None else _not_installed(cmd_name, listed)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the descriptions in ``LISTED``; only the commands of packages that it does not know are loaded."""
        rows = [(name, self._what(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)
        for package in dict.fromkeys(one.package for name, one in LISTED.items() if name not in dict(rows)):
            lacking = [(name, one.what) for name, one in LISTED.items() if one.package == package]
            with formatter.section(f"Commands of {package}, which is not installed"):
                formatter.write_dl(lacking)

    def _what(self, ctx: Any, name: str) -> str:
        return LISTED[name].what if name in LISTED else self.get_command(ctx, name).get_short_help_str(60)


def commands_of(register: Callable[[typer.Typer], None]) -> dict[str, Any]:
    """Return the commands that a module or package adds to the program, by name."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    register(app)
    return dict(typer.main.get_group(app).commands)


@cache
def _entries() -> dict[str, EntryPoint]:
    """Return the entry points of all packages that are installed, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def _added(group: str) -> dict[str, Any]:
    """Return the commands that other packages add to a group, by name."""
    commands = {name: _not_installed(name, one) for name, one in WITHIN.get(group, {}).items()}
    for entry in _entries().values():
        of, dot, name = entry.name.partition(".")
        if dot and of == group:
            commands[name] = commands_of(entry.load())[name]
    return commands


def _not_installed(name: str, listed: Listed) -> Any:
    """Return a command that says which package it needs, whatever it is given."""

    def refuse(context: typer.Context) -> None:
        raise RequestError(
            context.command_path, f"{listed.package} is not installed", remedy=REMEDIES[listed.package]
        )

    def register(app: typer.Typer) -> None:
        anything = {"allow_extra_args": True, "ignore_unknown_options": True}
        what = f"Needs {listed.package}: {listed.what}"
        app.command(name, add_help_option=False, context_settings=anything, short_help=what)(refuse)

    return commands_of(register)[name]
