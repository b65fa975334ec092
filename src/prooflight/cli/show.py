"""Output of commands: JSON for programs, tables and progress bars for people."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from prooflight.detectors.disposition import DecidedBy, Disposition, without_gate
from prooflight.errors import visible
from prooflight.reporting import wording
from prooflight.reporting.defect_text import describe
from prooflight.reporting.wording import count

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Verdict

Item = TypeVar("Item")


WIDE: int = 200
"""Width, in columns, of output to a file or a pipe."""


class PlainConsole(Console):
    """Console that prints strings without markup or escape sequences; style comes as ``Text``."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False)
        if not self.is_terminal and "COLUMNS" not in os.environ:
            self.width = WIDE  # nobody reads a file or a pipe in a window of 80 columns

    def render_str(self, text: str, **how: Any) -> Text:
        """Keep line breaks, and show other unprintable characters as escapes."""
        return super().render_str("\n".join(visible(line) for line in text.split("\n")), **how)


people = PlainConsole()
errors = PlainConsole(stderr=True)

WIDER = "tolerances as wide, on pages with more colours than the fit can follow"
VERDICT_STYLE = {"good": "green", "misprint": "bold red", "not-inspected": "yellow"}


def print_json(value: Any) -> None:
    """Print one JSON document on one line of standard output; dataclasses become objects, arrays lists, paths text."""
    sys.stdout.write(json.dumps(value, default=_plain) + "\n")
    sys.stdout.flush()


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return value.tolist() if hasattr(value, "tolist") else str(value)


def progress(items: Iterable[Item], *, total: int, what: str) -> Iterator[Item]:
    """Yield the items, with a progress bar on standard error."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
        task = bar.add_task(what, total=total)
        for item in items:
            yield item
            bar.advance(task)


def logged_progress(items: Iterable[Item], *, total: int, what: str, every_s: float = 2.0) -> Iterator[Item]:
    """Yield the items, with a line of JSON about their number, at first and every ``every_s``."""
    printed_s = -math.inf
    for number, item in enumerate(items):
        now_s = time.monotonic()
        if now_s - printed_s >= every_s:
            printed_s = now_s
            print_json({"phase": "preparing", "detail": f"{what}: {number} of {total}"})
        yield item


def step(text: str) -> None:
    """Print one line on standard error about the current step."""
    errors.print(f"{text} ...", style="dim", highlight=False)


def steps(*, quiet: bool) -> Callable[[str], None]:
    """Return ``step``, or a function that prints nothing, for programs."""
    return (lambda _text: None) if quiet else step


def written(path: Path) -> None:
    """Print the path of a result."""
    people.print("Written:", strong(path))


def strong(what: object) -> Text:
    """Return a path or a number, emphasised."""
    return Text(visible(what), style="bold")


def table_of(title: str, headings: Iterable[str], *, text_columns: Collection[str] = ()) -> Table:
    """Return a table for people; columns hold numbers, except those headed by ``text_columns``."""
    table = Table(title=title, title_justify="left")
    for heading in headings:
        # What is too long for a narrow terminal goes on in the next line: nothing is cut.
        table.add_column(heading, justify="left" if heading in text_columns else "right", overflow="fold")
    return table


def verdict_table(verdicts: Iterable[Verdict], *, title: str) -> Table:
    """Return verdicts as a table for people."""
    text_columns = ("page", "verdict", "disposition", "what")
    table = table_of(title, text_columns, text_columns=text_columns)
    table.add_column("score", justify="right", overflow="fold")
    table.add_column("ms", justify="right", overflow="fold")
    for verdict in verdicts:
        style = VERDICT_STYLE[verdict.verdict]
        table.add_row(
            verdict.page,
            Text(verdict.verdict, style=style),
            disposed(*without_gate(verdict)),
            Text("; ".join(filter(None, (what(verdict), *_marks(verdict))))),
            "" if verdict.score is None else _short(verdict.score),
            f"{verdict.milliseconds:.0f}" if verdict.milliseconds else "",
        )
    return table


def disposed(disposition: Disposition, by: DecidedBy) -> str:
    """Return the disposition of a sheet, with the rule that chose it unless it is the default one."""
    return disposition if by == "default" else f"{disposition}, by {by}"


def verdict_facts(verdict: Verdict) -> dict[str, Any]:
    """Return a verdict without a run for programs, with the sheet's disposition where no gate decides."""
    disposition, by = without_gate(verdict)
    return asdict(verdict) | {"disposition": disposition, "decided_by": by}


def judged(verdicts: Sequence[Verdict], *, title: str, each: str = "page") -> None:
    """Print all verdicts in a table, and their numbers; ``each`` is the unit of a verdict."""
    alarms = sum(verdict.verdict == "misprint" for verdict in verdicts)
    unseen = sum(verdict.verdict == "not-inspected" for verdict in verdicts)
    people.print(verdict_table(verdicts, title=title))
    if any(verdict.widened > 1 for verdict in verdicts):
        people.print(WIDER)
    parts = [count(len(verdicts), each), count(alarms, "misprint")]
    people.print(", ".join(parts + ([f"{unseen:,} not inspected"] if unseen else [])))


def reserved(verdict: Verdict) -> str:
    """Return the reservations about a verdict in words; empty if there are none."""
    suspended = "promise suspended" if verdict.promise_suspended else ""
    return "; ".join(filter(None, (wording.widened(verdict.widened), suspended)))


def _marks(verdict: Verdict) -> Iterator[str]:
    """Yield the reservations in as few words as a table has room for."""
    if verdict.widened > 1:
        yield f"tolerances {verdict.widened:.1f} times as wide"
    if verdict.promise_suspended:
        yield "promise suspended"


def _short(score: float) -> str:
    """Return a score with as many digits as a person needs: 0.64, 75, 18k."""
    if score < 10:
        return f"{score:.2f}"
    return f"{score:.0f}" if score < 10_000 else f"{score / 1000:.0f}k"


def what(verdict: Verdict) -> str:
    """Return in words what is wrong with a page and where, or why it was not inspected; empty if it is good."""
    return describe(verdict).brief
