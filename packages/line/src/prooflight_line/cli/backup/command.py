"""``prooflight backup`` and ``prooflight restore``: a journal with all that belongs to it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from prooflight.cli import faults, show
from prooflight.cli.options import Json
from prooflight.reporting.wording import count
from prooflight_line.cli.runs.journals import JournalUrl, url_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

Item = TypeVar("Item")
INCOMPLETE = 1
"""Exit code of a backup that lacks evidence."""


def register_backup(program: typer.Typer) -> None:
    """Add ``prooflight backup`` to the program."""
    program.command("backup")(backup)


def register_restore(program: typer.Typer) -> None:
    """Add ``prooflight restore`` to the program."""
    program.command("restore")(restore)


def backup(
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="Folder of the backup; must not exist.")
    ],
    journal: JournalUrl = None,
    data: Annotated[
        Path | None,
        typer.Option("--data", metavar="FILE", help="The console's own file; default next to the journal."),
    ] = None,
    press: Annotated[
        list[Path] | None, typer.Option("--press", metavar="X.press", help="Press artefact to store with it.")
    ] = None,
    json: Json = False,
) -> None:
    """Back up a journal, its evidence, labels, gate logs, the console's users, and presses, also during runs.

    Exits 1 if evidence that the journal names is missing; everything else was backed up.
    """
    from prooflight.press.artefact import Press
    from prooflight_line.journal.backup import back_up
    from prooflight_line.journal.opening import journal_path

    for one in press or ():
        Press.load(one)  # a damaged one is no backup
    done = back_up(
        journal_path(url_of(journal)),
        out,
        console=data,
        presses=tuple(press or ()),
        shown=_shown("backing up", quiet=json),
    )
    if json:
        rows = {"folder": str(done.folder), "files": len(done.files), "bytes": done.bytes}
        show.print_json(rows | {"missing": list(done.missing)})
    else:
        show.people.print(f"{count(len(done.files), 'file')}, {done.bytes / 1e6:,.1f} MB")
        show.written(done.folder)
    if done.missing:
        faults.report(
            f"{count(len(done.missing), 'file')} of evidence that the journal names are missing: {done.missing[0]}, ..."
        )
        raise typer.Exit(INCOMPLETE)


def restore(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Backup.")],
    journal: JournalUrl = None,
    presses: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for press artefacts; default that of the journal."),
    ] = None,
    json: Json = False,
) -> None:
    """Verify a backup by its digests, and restore it; nothing that exists is overwritten."""
    from prooflight_line.journal.backup import restore as restore_files
    from prooflight_line.journal.journal import Journal
    from prooflight_line.journal.opening import journal_path

    path = journal_path(url_of(journal))
    restored = restore_files(
        folder, path, presses=presses or path.parent, shown=_shown("verifying", quiet=json)
    )
    with Journal.open(str(path), read_only=True) as opened:
        runs = len(opened.runs())
    if json:
        show.print_json({"journal": str(path), "runs": runs, "restored": [str(one) for one in restored]})
    else:
        show.people.print(f"{count(len(restored), 'file')} restored, {count(runs, 'run')} in the journal")
        show.written(path)


def _shown(what: str, *, quiet: bool) -> Callable[[Sequence[Item]], Iterable[Item]]:
    return lambda items: items if quiet else show.progress(items, total=len(items), what=what)
