"""Verification of a package: signature, digests, versions, and each verdict computed again from its evidence."""

from __future__ import annotations

import hashlib
import io
import json
import tempfile
import zipfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from prooflight.detectors.verdict import NUMBERS, Verdict
from prooflight.errors import ProoflightError, RequestError
from prooflight.inspection.redeciding import replayed
from prooflight_line.journal.arrays import DAMAGED, read_arrays
from prooflight_line.journal.columns import MOST_PACK_BYTES
from prooflight_line.run_package.accounts import press_of_run
from prooflight_line.run_package.archive import FORMAT, MANIFEST, PIECE, REMEDY, SIGNED_COMMENT, signature_of
from prooflight_line.run_package.contents import PAGES, PRESSES, versions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from prooflight.press.artefact import Press
    from prooflight_line.run_package.signing import PublicKey

MOST_MANIFEST_BYTES: Final = 256_000_000
"""Greatest size of a manifest: a million members."""
MOST_ROW_BYTES: Final = 16_000_000
"""Greatest size of a line of the rows, as a journal has it."""
MOST_FAULTS: Final = 200
"""Greatest number of faults that are named; the rest are counted."""


class _Listed(BaseModel):
    model_config = ConfigDict(strict=True)
    path: str
    bytes: int = Field(ge=0)
    sha256: str


class Manifest(BaseModel):
    """Content of a manifest."""

    model_config = ConfigDict(strict=True)
    format: int
    run: int
    key: str
    job: str
    press: str
    press_digest: str
    detector: str
    versions: dict[str, str]
    missing: list[str]
    members: list[_Listed]


@dataclass(slots=True)
class _Evidence:
    """Files of evidence of an archive; the last one stays in memory, as sheets that follow each other share it."""

    archive: zipfile.ZipFile
    _name: str = ""
    _file: IO[bytes] = field(default_factory=io.BytesIO)

    def of(self, name: str) -> IO[bytes]:
        """Return a file; KeyError: there is none, ValueError: it is larger than any of a journal."""
        if name != self._name:
            if self.archive.getinfo(name).file_size > MOST_PACK_BYTES:
                raise ValueError(f"{name} is too large")
            self._file, self._name = io.BytesIO(self.archive.read(name)), name
        return self._file


@dataclass(slots=True)
class Verified:
    """Result of a verification."""

    faults: list[str] = field(default_factory=list)
    more_faults: int = 0
    """Number of faults beyond those."""
    signed_by: str = ""
    """Number of the key whose signature fits; empty: none does."""
    manifest: Manifest | None = None
    members: int = 0
    """Number of members whose digest is right."""
    other_versions: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Versions that differ: in the package, and here."""
    sheets: int = 0
    with_evidence: int = 0
    """Number of sheets with a score whose evidence is in the package."""
    same: int = 0
    """Number of sheets of which every figure is computed again as it was recorded."""
    replay: str = ""
    """Why no verdict was computed again; empty: they were."""

    def fault(self, line: str) -> None:
        """Add a fault."""
        if len(self.faults) < MOST_FAULTS:
            self.faults.append(line)
        else:
            self.more_faults += 1


def verify(
    path: Path,
    keys: Sequence[PublicKey],
    *,
    press: Path | None = None,
    shown: Callable[[Iterable[Any], int, str], Iterable[Any]] = lambda items, _total, _what: items,
) -> Verified:
    """Verify a package.

    Parameters
    ----------
    keys : public keys whose signature counts
    press : press artefact of its run; None: the one in the package, if there is one
    shown : shows progress over items, given their number and what is done

    Raises
    ------
    RequestError
        The file is no package, so that nothing in it can be verified.
    PressError
        ``press`` is not that of its run.
    """
    result = Verified()
    _check_signature(path, keys, result)
    try:
        with zipfile.ZipFile(path) as archive:
            manifest = _manifest(archive, path, result)
            if manifest is not None:
                result.manifest = manifest
                _check_members(archive, manifest, result, shown)
                here = versions()
                result.other_versions = {
                    name: (there, here[name])
                    for name, there in manifest.versions.items()
                    if name in here and here[name] != there
                }
                _replay(archive, manifest, press, result, shown)
    except ProoflightError:
        raise
    except DAMAGED as error:
        result.fault(f"the archive cannot be read ({error})")
    return result


def _check_signature(path: Path, keys: Sequence[PublicKey], result: Verified) -> None:
    try:
        signature, digest = signature_of(path)
    except RequestError as error:
        result.fault(f"signature: {error.what}")
        return
    key = next((key for key in keys if key.number == signature.number), None)
    if key is None:
        result.fault(
            f"signature: by key {signature.key_name}, which was not given; give its public half by --key"
        )
    elif signature.comment != SIGNED_COMMENT or not key.verifies(signature, digest):
        result.fault(f"signature: not valid for key {key.name}: bytes were changed after it was signed")
    else:
        result.signed_by = key.name


def _manifest(archive: zipfile.ZipFile, path: Path, result: Verified) -> Manifest | None:
    try:
        with archive.open(MANIFEST) as file:
            content = file.read(MOST_MANIFEST_BYTES + 1)
    except KeyError as error:
        raise RequestError(path, f"contains no {MANIFEST}", remedy=REMEDY) from error
    if len(content) > MOST_MANIFEST_BYTES:
        raise RequestError(path, f"its {MANIFEST} is too large", remedy=REMEDY)
    try:
        stated = json.loads(content)
        if isinstance(stated, dict) and stated.get("format") != FORMAT:
            what = f"has format {stated.get('format')!r:.20}, this version reads format {FORMAT}"
            raise RequestError(path, what, remedy="verify it with the version that wrote it")
        return Manifest.model_validate(stated)
    except (ValidationError, ValueError, RecursionError) as error:
        if isinstance(error, RequestError):
            raise
        result.fault(f"{MANIFEST}: damaged")
        return None


def _check_members(
    archive: zipfile.ZipFile,
    manifest: Manifest,
    result: Verified,
    shown: Callable[[Iterable[Any], int, str], Iterable[Any]],
) -> None:
    there = Counter(info.filename for info in archive.infolist())
    stated = {one.path: one for one in manifest.members}
    for name in sorted(there.keys() - stated.keys() - {MANIFEST}):
        result.fault(f"{name}: not in the manifest")
    for name in sorted(name for name, count in there.items() if count > 1):
        result.fault(f"{name}: {there[name]} members have this name")
    for one in shown(manifest.members, len(manifest.members), "digests"):
        if one.path not in there:
            result.fault(f"{one.path}: missing")
            continue
        try:
            size, digest = _digest(archive, one.path, most=one.bytes)
        except DAMAGED as error:
            result.fault(f"{one.path}: damaged ({error})")
            continue
        if size != one.bytes or digest != one.sha256:
            result.fault(f"{one.path}: it differs from the manifest")
        else:
            result.members += 1
    for name in manifest.missing:
        result.fault(f"{name}: was missing when the package was created")


def _digest(archive: zipfile.ZipFile, name: str, *, most: int) -> tuple[int, str]:
    """Return size and SHA-256 of a member, read up to one byte more than it should have."""
    sha, size = hashlib.sha256(), 0
    with archive.open(name) as file:
        while size <= most and (piece := file.read(min(PIECE, most + 1 - size))):
            sha.update(piece)
            size += len(piece)
    return size, sha.hexdigest()


def _replay(
    archive: zipfile.ZipFile,
    manifest: Manifest,
    given: Path | None,
    result: Verified,
    shown: Callable[[Iterable[Any], int, str], Iterable[Any]],
) -> None:
    """Compute each verdict again of which the evidence is there, and count."""
    with tempfile.TemporaryDirectory(prefix="prooflight-") as folder:
        press = _press(archive, manifest, given, Path(folder), result)
        evidence = _Evidence(archive)
        rows = enumerate(_rows(archive), start=1)
        for number, row in shown(rows, sum(1 for _ in _rows(archive)), "verdicts"):
            try:
                result.sheets += 1
                if row.get("evidence") is None or row["score"] is None:
                    continue
                result.with_evidence += 1
                if press is not None:
                    _replay_sheet(evidence, row, press, result)
            except (KeyError, TypeError, ValueError, *DAMAGED) as error:
                what = error.what if isinstance(error, RequestError) else str(error)
                result.fault(f"{PAGES}, line {number}: cannot be recalculated ({what})")


def _replay_sheet(evidence: _Evidence, row: dict[str, Any], press: Press, result: Verified) -> None:
    arrays = read_arrays(evidence.of(row["evidence"]), row["sheet"])
    numbers = {name: row[name] for name in NUMBERS}
    verdict = Verdict(page=row["page"], verdict=row["verdict"], detector=row["detector"], **numbers)
    differing = [figure for figure in replayed(verdict, arrays, press) if not figure.same]
    result.same += not differing
    for figure in differing:
        what = f"{figure.name} was recorded as {figure.recorded}, and is {figure.again} now"
        result.fault(f"sheet {row['sheet']}: {what}")


def _press(
    archive: zipfile.ZipFile, manifest: Manifest, given: Path | None, folder: Path, result: Verified
) -> Press | None:
    """Return the press of the run; None: it is not at hand, or not usable, as ``result`` states then."""
    if given is not None:
        return press_of_run(given, name=manifest.press, digest=manifest.press_digest)
    name = next((one.path for one in manifest.members if one.path.startswith(f"{PRESSES}/")), None)
    if name is None:
        result.replay = f"the package has no press artefact; give that of press {manifest.press} by --press"
        return None
    file = folder / "a.press"
    try:
        with archive.open(name) as read, file.open("wb") as written:
            while piece := read.read(PIECE):
                written.write(piece)
        return press_of_run(file, name=manifest.press, digest=manifest.press_digest)
    except (KeyError, ProoflightError, *DAMAGED) as error:
        result.replay = f"{name} cannot be used"
        result.fault(f"{name}: cannot be used ({getattr(error, 'what', error)})")
        return None


def _rows(archive: zipfile.ZipFile) -> Iterator[dict[str, Any]]:
    """Yield the rows of sheets."""
    try:
        with archive.open(PAGES) as file:
            while line := file.readline(MOST_ROW_BYTES):
                row = json.loads(line)
                if not isinstance(row, dict):
                    raise ValueError("not an object")  # noqa: TRY004 (of the same kind as all that is wrong with a line)
                yield row
    except KeyError:
        return
