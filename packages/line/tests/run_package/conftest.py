"""A run with evidence, labels and an audit, and the key that signs its package."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pytest

from prooflight.detectors.verdict import Verdict
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.redeciding import evidence_to_store
from prooflight.rng import stream
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore, run_key
from prooflight_line.journal.records import PageRecord, RunEnd, RunFacts
from prooflight_line.run_package.archive import write_archive
from prooflight_line.run_package.contents import PackageContents
from prooflight_line.run_package.signing import SigningKey

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

AUDIT = (
    "CREATE TABLE audit (id INTEGER PRIMARY KEY, at_s REAL, who TEXT, what TEXT, target TEXT, before TEXT, after TEXT,"
    " previous TEXT, digest TEXT)"
)


class Packed(NamedTuple):
    """A package, and what it was made of."""

    archive: Path
    journal: Path
    press: Path
    key: SigningKey


@pytest.fixture(scope="session")
def journal_of_run(press: Press, page: Page, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run 1: sheet 0 good, 1 a streak, both with evidence; 2 not inspected. Its name is of three alphabets."""
    path = tmp_path_factory.mktemp("journal") / "j.sqlite"
    inspector = Inspector.of(press, "chi-square")
    prepared = inspector.prepare(page)
    run_facts = RunFacts(
        job="工 Ω <job> & Söhne.pdf",
        job_digest="j" * 64,
        press=press.name,
        press_digest=press.digest,
        detector="chi-square",
        source="drum:5",
        started_s=1.7e9,
        sheets=3,
        settings={"seed": 3, "warnings": [{"page": 1, "message": "a font is missing"}]},
    )
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(run_facts)
        for sheet, kind in enumerate(("", "streak")):
            request = MisprintRequest(kind=kind, severity=0.9) if kind else None
            rng = stream(5, "print", sheet)
            scan = scan_page(page, press=press, request=request, others=(), fetch=lambda _: page, rng=rng)
            inspection = inspector.inspect(prepared, scan.dn, scan_name="scan")
            evidence = evidence_to_store(inspection, prepared.page, inspector.press)
            journal.record(run, _record(sheet, inspection.verdict, evidence=evidence))
        lost = Verdict(
            page="p0003", verdict="not-inspected", reason="too many sheets were waiting for inspection"
        )
        journal.record(run, _record(2, lost))
        journal.end_run(run, RunEnd(ended_s=1.7e9 + 60, ending="finished", detail="a remark"))
        key = run_key(journal.run(run))
    labels = LabelStore(path)
    labels.say("misprint", run=key, by="Jörg", at_s=1.7e9 + 90, sheet=1, note="seen on paper")
    labels.hold(run=key, by="Anna", at_s=1.7e9 + 99, reason="claim 17")
    with contextlib.closing(sqlite3.connect(f"{path}.console.sqlite")) as console, console:
        console.execute(AUDIT)
        for number, target in enumerate(
            (f"run {key}, sheet 1", f"run 1{key}, sheet 1", "user Anna", f"run {key}")
        ):
            row = (number + 1, 1.7e9, "Jörg", "words.say", target, None, "{}", "0" * 64, "d" * 64)
            console.execute("INSERT INTO audit VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", row)
    return path


@pytest.fixture(scope="session")
def packed(journal_of_run: Path, press: Press, tmp_path_factory: pytest.TempPathFactory) -> Packed:
    folder = tmp_path_factory.mktemp("package")
    artefact = folder / "rig.press"
    press.save(artefact)
    key = SigningKey.make(folder / "a.key")
    made = Packed(archive=folder / "run.zip", journal=journal_of_run, press=artefact, key=key)
    write_package(made, made.archive)
    return made


def write_package(of: Packed, out: Path) -> None:
    with Journal.open(str(of.journal), read_only=True) as journal:
        contents = PackageContents(journal=journal, run=journal.run(1), press=of.press)
        write_archive(out, contents.members(), of.key, facts=contents.facts)


def copied(journal: Path, folder: Path) -> Path:
    """A journal with all that lies beside it, which a test may change."""
    for file in journal.parent.iterdir():
        (shutil.copytree if file.is_dir() else shutil.copyfile)(file, folder / file.name)
    return folder / journal.name


def _record(sheet: int, verdict: Verdict, **more: object) -> PageRecord:
    told = {"job_page": sheet, "late": False, "first_line": 3000 * sheet, "time_s": 0.2 * sheet} | more
    return PageRecord(sheet=sheet, verdict=verdict, **told)
