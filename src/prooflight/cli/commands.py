"""The program's commands by name: a command's module is loaded when it is called, and none to list them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, Final

import typer
from typer.core import TyperGroup

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Callable

GROUP: Final = "prooflight.commands"
"""Entry points of packages that add commands: functions that take the ``typer.Typer``."""
STUDIES: Final = "studies"
"""The entry point of the package that adds ``study`` and ``bench``."""


@dataclass(frozen=True, slots=True)
class Listed:
    """A command as the program lists it."""

    module: str
    """Module of ``prooflight.cli`` whose ``register`` adds the command to a ``typer.Typer``; "": that of a
    package."""
    what: str
    """Description of the command, shorter than a line."""


LISTED: Final = {
    "demo": Listed("jobs.command", "Print a job with some misprints, and inspect it."),
    "rip": Listed("jobs.command", "Write each page as a CMYK TIFF, as the press prints it."),
    "simulate": Listed("jobs.command", "Print and scan a job on the simulated press."),
    "inspect": Listed("jobs.command", "Compare scans with the job, and give one verdict a page."),
    "job": Listed("jobs.zones", "Check and prepare a job before it is printed; make zones from its marks."),
    "zones": Listed("jobs.zones", "Price zones before they are in force; draw them."),
    "codes": Listed("jobs.codes", "List a job's bar codes as this press's camera will read them."),
    "watch": Listed("watch.command", "Inspect a press while it runs."),
    "plant": Listed("plant.command", "Check the plant's gate and outlets; simulate a controller."),
    "runs": Listed("runs.command", "List all runs in the journal."),
    "run": Listed("runs.command", "Show, label, export, replay or reconcile one run; tidy up."),
    "serve": Listed("serve", "Serve the console in a browser; manage its users."),
    "audit": Listed("serve", "Check the record of actions in the console."),
    "press": Listed("press", "Build a press artefact, show its content, train its detectors."),
    "camera": Listed("camera.command", "Compute, measure, set up and record cameras."),
    "calibrate": Listed("calibrate", "Compute a press's tables from scans of a printed chart."),
    "chart": Listed("chart", "Validate ink models on charts, predict spectra, make charts."),
    "study": Listed("", "Regenerate a table or a figure of docs/results."),
    "bench": Listed("", "Measure speed, as ratios to peers in the same run."),
}


class Commands(TyperGroup):
    """The group of all commands."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return names in the order in which they are listed; those that packages add come last."""
        studies = STUDIES in entry_points(group=GROUP).names
        here = [name for name, one in LISTED.items() if one.module or studies]
        return here + [name for name in _of_packages() if name not in LISTED]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command; None if there is none."""
        listed = LISTED.get(cmd_name)
        if listed is None:
            return _of_packages().get(cmd_name)
        if listed.module:
            return commands_of(import_module(f"prooflight.cli.{listed.module}").register)[cmd_name]
        for entry in entry_points(group=GROUP, name=STUDIES):
            return commands_of(entry.load())[cmd_name]
        return _without_studies(cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the descriptions in ``LISTED``; only the commands of packages are loaded."""
        more = _of_packages()
        rows = [
            (name, LISTED[name].what if name in LISTED else more[name].get_short_help_str(60))
            for name in self.list_commands(ctx)
        ]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def commands_of(register: Callable[[typer.Typer], None]) -> dict[str, Any]:
    """Return the commands that a module or package adds to the program, by name."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    register(app)
    return dict(typer.main.get_group(app).commands)


@cache
def _of_packages() -> dict[str, Any]:
    """Return the commands of packages other than the studies."""
    commands: dict[str, Any] = {}
    for entry in entry_points(group=GROUP):
        if entry.name != STUDIES:
            commands |= commands_of(entry.load())
    return commands


def _without_studies(name: str) -> Any:
    def refuse(context: typer.Context) -> None:
        raise RequestError(
            f"prooflight {context.info_name}",
            "the studies are not installed",
            remedy="install the package prooflight-studies, which lies in the repository's folder studies",
        )

    def register(app: typer.Typer) -> None:
        anything = {"allow_extra_args": True, "ignore_unknown_options": True}
        app.command(name, add_help_option=False, context_settings=anything)(refuse)

    return commands_of(register)[name]
