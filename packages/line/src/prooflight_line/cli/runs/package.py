"""``prooflight run package``, ``run key`` and ``run report``; and ``prooflight verify``, which needs no journal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from prooflight.cli import faults, show
from prooflight.cli.exit_codes import UNUSABLE_INPUT
from prooflight.cli.options import Json
from prooflight.reporting.wording import count
from prooflight_line.cli.runs.journals import JournalUrl, RunNumber, reading, run_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from prooflight_line.run_package.verifying import Verified

KeyFile = Annotated[
    Path | None,
    typer.Option("--key", metavar="FILE", help="Secret key; default in the user's data."),
]
Language = Annotated[Literal["en", "de"], typer.Option(help="Language of the report.")]


def register_of_runs(app: typer.Typer) -> None:
    """Add the commands on one run to their group."""
    app.command()(package)
    app.command()(report)
    app.command()(key)


def register_verify(program: typer.Typer) -> None:
    """Add ``prooflight verify`` to the program."""
    program.command()(verify)


def package(
    run: RunNumber = "last",
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="RUN.zip", help="Archive to write; default run-ID.zip."),
    ] = None,
    press: Annotated[
        Path | None,
        typer.Option(
            "--press",
            metavar="X.press",
            help="Press artefact of the run, to be included; default its digest.",
        ),
    ] = None,
    xjmf: Annotated[
        Path | None,
        typer.Option("--xjmf", metavar="FILE", help="Write the run's result as an XJMF message next to it."),
    ] = None,
    key: KeyFile = None,
    language: Language = "en",
    journal: JournalUrl = None,
    json: Json = False,
) -> None:
    """Write all evidence of a run into one signed archive, which `prooflight verify` checks years later.

    Exits 1 if evidence that the journal names is missing; everything else was packaged.
    """
    from prooflight.files.atomic import whole_file
    from prooflight_line.run_package.accounts import press_of_run
    from prooflight_line.run_package.archive import write_archive
    from prooflight_line.run_package.contents import PackageContents, refuse_running
    from prooflight_line.run_package.signing import SigningKey, default_key

    signing = SigningKey.load(key or default_key())
    with reading(journal) as opened:
        run_row = run_of(opened, run)
        refuse_running(run_row)
        if press is not None:
            press_of_run(press, name=run_row.facts.press, digest=run_row.facts.press_digest)
        contents = PackageContents(
            journal=opened,
            run=run_row,
            press=press,
            language=language,
            shown=_shown(quiet=json),
        )
        path = out or Path(f"run-{run_row.id}.zip")
        members = write_archive(path, contents.members(), signing, facts=contents.facts)
        if xjmf is not None:
            with whole_file(xjmf) as unfinished:
                unfinished.write_bytes(contents.result())
    size, name = path.stat().st_size, signing.public.name
    if json:
        facts = {"archive": str(path), "bytes": size, "members": len(members), "key": name}
        show.print_json(facts | {"missing": contents.missing})
    else:
        show.people.print(f"{count(len(members), 'member')}, {size / 1e6:,.1f} MB, signed by key {name}")
        show.written(path)
        if xjmf is not None:
            show.written(xjmf)
    for file in contents.missing[:5]:
        faults.report(f"{file}: the journal refers to it, but it is missing")
    if contents.missing:
        raise typer.Exit(1)


def report(
    run: RunNumber = "last",
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="RUN.pdf", help="PDF to write; default run-ID.pdf."),
    ] = None,
    language: Language = "en",
    journal: JournalUrl = None,
) -> None:
    """Write the report of a run as a PDF: figures, gate, misprints with pictures, labels, a line to sign."""
    from prooflight.files.atomic import whole_file
    from prooflight_line.run_package.report import write_report

    with reading(journal) as opened:
        run_row = run_of(opened, run)
        path = out or Path(f"run-{run_row.id}.pdf")
        with whole_file(path) as unfinished, unfinished.open("wb") as file:
            write_report(file, opened, run_row, language=language)
    show.written(path)


def key(
    file: KeyFile = None,
    json: Json = False,
) -> None:
    """Show the public key of packages; create the key, readable by its owner alone, if there is none."""
    from prooflight_line.run_package.signing import SigningKey, default_key, public_path

    path = file or default_key()
    new = not path.exists()
    signing = SigningKey.make(path) if new else SigningKey.load(path)
    public = public_path(path)
    if not public.exists():
        public.write_text(signing.public.text)
    if json:
        facts = {"key": signing.public.name, "public": str(public), "secret": str(path), "new": new}
        show.print_json(facts)
        return
    show.people.print(signing.public.text.rstrip())
    if new:
        show.people.print("Give the public key to those who verify packages; keep a copy of the secret one.")
        show.written(path)
        show.written(public)
    else:
        show.people.print(f"Public key: {public}")


def verify(
    archive: Annotated[Path, typer.Argument(metavar="RUN.zip", help="Package of a run.")],
    key: Annotated[
        list[Path] | None,
        typer.Option(
            "--key", metavar="PUB", help="Public key of the trusted signer; default the user's own."
        ),
    ] = None,
    press: Annotated[
        Path | None,
        typer.Option(
            "--press", metavar="X.press", help="Press artefact of the run, if the package lacks it."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Verify a package of a run: signature, digests, versions, and each verdict from its evidence.

    Exits 2 if anything is wrong, with a line for each fault.
    """
    from prooflight_line.run_package.signing import PublicKey, default_key, public_path
    from prooflight_line.run_package.verifying import verify as verify_package

    own = public_path(default_key())
    files = key or ([own] if own.exists() else [])

    result = verify_package(
        archive, [PublicKey.read(file) for file in files], press=press, shown=_shown(quiet=json)
    )
    if json:
        _print_facts(result)
    else:
        _print(result)
    for line in result.faults:
        faults.report(line)
    if result.more_faults:
        faults.report(f"{count(result.more_faults, 'more fault')}")
    if result.faults:
        raise typer.Exit(UNUSABLE_INPUT)


def _shown(*, quiet: bool) -> Callable[[Iterable[Any], int, str], Iterable[Any]]:
    return lambda items, total, what: items if quiet else show.progress(items, total=total, what=what)


def _print_facts(result: Verified) -> None:
    manifest = result.manifest
    show.print_json(
        {
            "run": None if manifest is None else manifest.run,
            "signed_by": result.signed_by or None,
            "members": result.members,
            "sheets": result.sheets,
            "with_evidence": result.with_evidence,
            "same": None if result.replay else result.same,
            "replay": result.replay,
            "other_versions": result.other_versions,
            "faults": result.faults,
        }
    )


def _print(result: Verified) -> None:
    say, manifest = show.people.print, result.manifest
    if manifest is None:
        return
    say(f"Run {manifest.run} of {manifest.job} on press {manifest.press}")
    if result.signed_by:
        say(f"Signature: of key {result.signed_by}, over all bytes of the archive")
    say(f"Digests: {result.members} of {count(len(manifest.members), 'member')} as signed")
    say(
        f"Recorded by Prooflight {manifest.versions.get('journal')}, packaged by {manifest.versions['prooflight']}"
    )
    if result.other_versions:
        names = (
            f"{name} {there[:16]}, here {here[:16]}" for name, (there, here) in result.other_versions.items()
        )
        say(f"Other versions: {'; '.join(names)}")
    if result.replay:
        say(f"Verdicts: not computed again: {result.replay}")
    else:
        say(
            f"Verdicts: {result.same} of {result.with_evidence} with evidence are the same in every digit; "
            f"{count(result.sheets - result.with_evidence, 'sheet')} without"
        )
