"""Contents of a run's package: rows, evidence, pictures, labels, the gate's log, the audit, press and report."""

from __future__ import annotations

import io
import json
import platform
import sqlite3
from contextlib import closing
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from itertools import islice
from typing import TYPE_CHECKING, Any, Final

from PIL import Image

from prooflight import __version__
from prooflight.errors import RequestError
from prooflight.files.program import CALCULATING, program_digest
from prooflight_line.journal.backup import CONSOLE
from prooflight_line.journal.exporting import page_facts, run_facts
from prooflight_line.journal.labels import LabelStore, run_key
from prooflight_line.journal.opening import UNREADABLE, why
from prooflight_line.journal.schema import JournalError, json_text
from prooflight_line.plant.gate.log import log_path
from prooflight_line.plant.run_messages import run_result
from prooflight_line.run_package.archive import Member, pieces_of
from prooflight_line.run_package.pictures import seen_pictures
from prooflight_line.run_package.report import write_report

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from prooflight.reporting.defect_phrases import Code
    from prooflight_line.journal.reading import JournalReader
    from prooflight_line.journal.records import RunRow

RUN, PAGES, REPORT, RESULT = "run.json", "pages.jsonl", "report.pdf", "result.xjmf"
EVIDENCE, PICTURES, PRESSES = "evidence", "pictures", "press"
LIBRARIES: Final = (
    *CALCULATING,
    "cryptography",
    "pillow",
    "pydantic",
    "reportlab",
    "safetensors",
    "sqlalchemy",
)
ROWS_A_PIECE: Final = 200
_AUDIT: Final = (
    "SELECT id, at_s, who, what, target, before, after, previous, digest FROM audit"
    " WHERE target = ? OR substr(target, 1, ?) = ? ORDER BY id"
)
_README: Final = """Evidence of one run of a digital press, recorded by Prooflight.

report.pdf     the run for people
run.json       the run: job, press, times, settings, counts
pages.jsonl    one line a sheet, in order: verdict, score, threshold, places, disposition; and its file of evidence
evidence/      input data of the verdicts, as NumPy archives whose arrays are named SHEET/NAME
pictures/      camera images of misprints
labels.jsonl   labels of sheets and incidents, with the person who gave each
gate.jsonl     decisions and trays of the gate, if the run had one
audit.jsonl    actions of people in the console on this run
press/         the press artefact, if it was available; manifest.json always has its digest
result.xjmf    the result for the plant's management system: sheets good, waste and not inspected (CIP4 XJMF 2.1)
manifest.json  versions of program and libraries, size and SHA-256 of each file

`prooflight verify THIS.zip --key KEY.pub` checks all of it, and computes the verdicts again.
The last bytes of the archive, its comment, are a signature of minisign over all bytes before it.
"""


@dataclass(slots=True)
class PackageContents:
    """Contents of the package of one run; members are read one by one, in the order in which they are written."""

    journal: JournalReader
    run: RunRow
    press: Path | None = None
    """Press artefact of the run, to be included; None: it is not at hand."""
    language: Code = "en"
    shown: Callable[[Iterable[Any], int, str], Iterable[Any]] = lambda items, _total, _what: items
    """Shows progress over items, given their number and what is done."""
    missing: list[str] = field(default_factory=list)
    """Files of evidence that the journal names and that do not exist."""

    def members(self) -> Iterator[Member]:
        """Yield all members; JournalError, OSError and the errors of ``write_report``."""
        run, path = self.run, self.journal.path
        yield Member(path="README.txt", content=[_README.encode()])
        yield _json(RUN, run_facts(run) | {"key": run_key(run)})
        files = self._files()
        yield Member(path=PAGES, content=_pieces(self._rows(files)))
        for file in sorted(set(files.values())):
            yield Member(path=_evidence_path(file), content=pieces_of(file), packed=False)
        yield from self._pictures(files)
        labels = LabelStore(path).of_run(run_key(run))
        yield Member(path="labels.jsonl", content=_pieces(map(asdict, labels)))
        if (log := log_path(path, run.id)).is_file():
            yield Member(path="gate.jsonl", content=pieces_of(log))
        yield Member(path="audit.jsonl", content=_pieces(audit_of(path, run_key(run))))
        if self.press is not None:
            yield Member(path=f"{PRESSES}/{self.press.name}", content=pieces_of(self.press), packed=False)
        yield Member(path=RESULT, content=[self.result()])
        yield Member(path=REPORT, content=self._report(), packed=False)

    def facts(self) -> dict[str, Any]:
        """Return what the manifest states beside the members; complete when all were read."""
        run = self.run.facts
        return {
            "run": self.run.id,
            "key": run_key(self.run),
            "job": run.job,
            "job_digest": run.job_digest,
            "press": run.press,
            "press_digest": run.press_digest,
            "detector": run.detector,
            "versions": versions() | {"journal": self.journal.version},
            "missing": self.missing,
        }

    def result(self) -> bytes:
        """Return the result of the run as an XJMF message; JournalError."""
        return run_result(self.run, self.journal.pages(self.run.id))

    def _files(self) -> dict[int, Path]:
        """Return the files of evidence by sheet; those that do not exist are noted."""
        files = self.journal.evidence_of_run(self.run.id)
        there = {file for file in set(files.values()) if file.is_file()}
        self.missing += sorted(_evidence_path(file) for file in set(files.values()) - there)
        return {sheet: file for sheet, file in files.items() if file in there}

    def _rows(self, files: dict[int, Path]) -> Iterator[dict[str, Any]]:
        for page in self.shown(self.journal.pages(self.run.id), self.run.pages, "rows"):
            file = files.get(page.sheet)
            yield page_facts(page) | {"evidence": None if file is None else _evidence_path(file)}

    def _pictures(self, files: dict[int, Path]) -> Iterator[Member]:
        misprints = (
            page.sheet
            for page in self.journal.pages(self.run.id, passed=False)
            if page.verdict.verdict == "misprint" and page.sheet in files
        )
        for sheet in self.shown(misprints, self.run.misprints, "pictures"):
            page = self.journal.page(self.run.id, sheet)
            for index, picture in enumerate(seen_pictures(page)):
                file = io.BytesIO()
                Image.fromarray(picture.grey).save(file, "PNG")
                name = f"{PICTURES}/sheet{sheet:07}-{index + 1}.png"
                yield Member(path=name, content=[file.getvalue()], packed=False)

    def _report(self) -> Iterator[bytes]:
        file = io.BytesIO()
        write_report(file, self.journal, self.run, language=self.language)
        yield file.getvalue()


def versions() -> dict[str, str]:
    """Return the versions of program and libraries, and the digest of the program."""
    libraries = {name: version(name) for name in LIBRARIES}
    python = {"python": platform.python_version(), "machine": platform.machine()}
    return {"prooflight": __version__, "program": program_digest(), **python, **libraries}


def audit_of(journal: Path, key: str) -> Iterator[dict[str, Any]]:
    """Yield the console's audit entries about a run, with the digests of its chain; none without a console.

    JournalError: the console's file cannot be read.
    """
    path = journal.with_name(journal.name + CONSOLE)
    if not path.is_file():
        return
    target = f"run {key}"
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
            connection.row_factory = sqlite3.Row
            for row in connection.execute(_AUDIT, (target, len(target) + 1, f"{target},")):
                yield dict(row)
    except UNREADABLE as error:
        what = f"the audit cannot be read ({why(error)})"
        raise JournalError(path, what, remedy="move it away to do without the audit") from error


def refuse_running(run: RunRow) -> None:
    """Raise RequestError if a run has not ended: its package would be of a part of it."""
    if run.state == "running":
        raise RequestError(f"run {run.id}", "is still being printed", remedy="wait for its end")


def _evidence_path(file: Path) -> str:
    return f"{EVIDENCE}/{file.name}"


def _json(path: str, value: Any) -> Member:
    return Member(path=path, content=[(json.dumps(value, indent=1) + "\n").encode()])


def _pieces(rows: Iterable[dict[str, Any]]) -> Iterator[bytes]:
    """Yield objects as lines of JSON."""
    rows = iter(rows)
    while lines := [json_text(row) + "\n" for row in islice(rows, ROWS_A_PIECE)]:
        yield "".join(lines).encode()
