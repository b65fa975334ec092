"""Journals and packs of evidence, read as the commands do, and gone on with."""

from __future__ import annotations

from pathlib import Path

from tests.fuzz import journal_mutants as journals
from tests.fuzz.harness import Target


def journal_samples() -> list[bytes]:
    return [journals.journal_sample()]


def pack_samples() -> list[bytes]:
    return [journals.pack_sample()]


def go_on(path: Path) -> None:
    """A run is recorded in it, and it is tidied; nothing beside it is left for the next."""
    folder = path.parent / "journal"
    folder.mkdir()
    try:
        copy = folder / path.name
        copy.write_bytes(path.read_bytes())
        journals.write_journal(copy)
    finally:
        for file in sorted(folder.rglob("*"), reverse=True):
            file.rmdir() if file.is_dir() and not file.is_symlink() else file.unlink()
        folder.rmdir()


TARGETS = (
    Target(
        name="journal-bytes",
        suffix=".sqlite",
        samples=journal_samples,
        mutate=journals.spoil_bytes,
        read=journals.read_journal,
    ),
    Target(
        name="journal-values",
        suffix=".sqlite",
        samples=journal_samples,
        mutate=journals.spoil_values,
        read=journals.read_journal,
    ),
    Target(
        name="journal-going-on",
        suffix=".sqlite",
        samples=journal_samples,
        mutate=journals.spoil_values,
        read=go_on,
    ),
    Target(
        name="evidence-pack",
        suffix=".npz",
        samples=pack_samples,
        mutate=journals.spoil_pack,
        read=journals.read_pack,
    ),
)
