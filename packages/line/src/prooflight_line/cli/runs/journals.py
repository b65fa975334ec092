"""The option ``--journal`` and the number of a run, which commands on runs have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from prooflight_line.journal.journal import Journal
    from prooflight_line.journal.records import RunRow

JournalUrl = Annotated[
    str | None,
    typer.Option(
        "--journal", metavar="URL", help="Journal: sqlite:///FILE, or the file; default in the user's data."
    ),
]
RunNumber = Annotated[str, typer.Argument(metavar="ID", help="Number of a run, or `last`.")]


def reading(journal: str | None) -> Journal:
    """Open the journal of ``--journal`` for reading; JournalError if it cannot be read."""
    from prooflight_line.journal.journal import Journal

    return Journal.open(url_of(journal), read_only=True)


def url_of(journal: str | None) -> str:
    """Return the value of ``--journal``, or the path of the user's journal."""
    from prooflight_line.journal.opening import default_journal

    return journal or str(default_journal())


def run_of(journal: Journal, number: str) -> RunRow:
    """Return the run with this number, or the last; JournalError if there is none."""
    if number == "last":
        return journal.last_run()
    try:
        run_id = int(number)
    except ValueError as error:
        what = f"{number!r} is not a number"
        raise RequestError("run", what, remedy="see `prooflight runs`, or use `last`") from error
    return journal.run(run_id)
