"""The file of nuisances and misprints for evaluation: its reading, checks, and the objects that simulate them."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, TypeVar

from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles, shortly
from prooflight.files.schema import Block, Misfit, checked
from prooflight_studies.stress.marks import MARKS
from prooflight_studies.stress.nuisances import NUISANCES

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from prooflight_studies.stress.marks import Digit, Mark
    from prooflight_studies.stress.nuisances import Nuisance

    Kind = TypeVar("Kind", bound=Block)

SCHEMA: Final = 1
REMEDY: Final = "give the stress file unchanged (TOML, schema 1)"
STRESS_FILES: Final = GivenFiles(error=RequestError, remedy=REMEDY, largest_mb=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stress:
    """Content of a stress file, by name and in the order of the file's kinds."""

    nuisances: Mapping[str, Nuisance]
    marks: Mapping[str, Mark | Digit]
    """Misprints of the file."""
    digest: str
    """SHA-256 of the file."""

    def nuisance(self, name: str) -> Nuisance:
        """Return a nuisance; RequestError: there is none of that name."""
        return _named("nuisance", self.nuisances, name)

    def mark(self, name: str) -> Mark | Digit:
        """Return a misprint; RequestError: there is none of that name."""
        return _named("misprint", self.marks, name)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle for worker processes: read-only mappings cannot be pickled."""
        return _again, (dict(self.nuisances), dict(self.marks), self.digest)


def load_stress(path: Path) -> Stress:
    """Read a stress file.

    RequestError: the file is no TOML, or a table or an amount is missing, unknown or wrong. OSError: the system cannot
    open it.
    """
    data = STRESS_FILES.read(path)
    text = STRESS_FILES.text(data, where=path)
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise RequestError(path, f"is not TOML: {error}", remedy=REMEDY) from error
    try:
        _check_head(raw)
        nuisances, marks = _tables(raw, "nuisance", NUISANCES), _tables(raw, "misprint", MARKS)
    except Misfit as error:
        raise RequestError(path, str(error), remedy=REMEDY) from error
    return _again(nuisances, marks, hashlib.sha256(data).hexdigest())


def _again(nuisances: dict[str, Nuisance], marks: dict[str, Mark | Digit], digest: str) -> Stress:
    return Stress(nuisances=MappingProxyType(nuisances), marks=MappingProxyType(marks), digest=digest)


def _check_head(raw: dict[str, Any]) -> None:
    if raw.get("schema") != SCHEMA:
        raise Misfit("schema", f"must be {SCHEMA}, not {shortly(repr(raw.get('schema')))}")
    for name in raw:
        if name not in ("schema", "nuisance", "misprint"):
            raise Misfit(shortly(name), "is not known here")


def _tables(raw: dict[str, Any], of: str, kinds: Mapping[str, type[Kind]]) -> dict[str, Kind]:
    """Return every table of a kind; Misfit: one is missing or unknown."""
    given = raw.get(of)
    if not isinstance(given, dict):
        raise Misfit(of, "is missing" if given is None else "must be a table of tables")
    for name in given:
        if name not in kinds:
            raise Misfit(f"{of}.{shortly(name)}", "is not known here")
    parsed = {}
    for name, kind in kinds.items():
        if name not in given:
            raise Misfit(f"{of}.{name}", "is missing")
        parsed[name] = checked(kind, given[name], under=f"{of}.{name}.")
    return parsed


def _named(what: str, entries: Mapping[str, Kind], name: str) -> Kind:
    if name not in entries:
        raise RequestError(what, f"there is no {shortly(name)!r}", remedy=f"choose from {', '.join(entries)}")
    return entries[name]
