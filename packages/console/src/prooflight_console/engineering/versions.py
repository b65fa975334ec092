"""Versions of the press: which is in use, which were made, and the way to another one, with a record of each step.

The press that runs use is the file that ``watch --press`` and the console are given. Versions are in a folder beside
it: each an artefact, and a JSON file that states how it was made, by whom, and what it would have done. To use a
version is to replace the one file, whole or not at all. The one before is among the versions first, so that there is
always a way back.
"""

from __future__ import annotations

import json
import shutil
import threading
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, Self

from prooflight.errors import ProoflightError, RequestError
from prooflight.files.atomic import whole_file
from prooflight.files.lock import WriterLock
from prooflight.press.artefact import Press
from prooflight_console.problems import Problem, not_found
from prooflight_console.reading.stations import content_stamp, press_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from prooflight_console.accounts.account_store import Accounts
    from prooflight_console.accounts.roles import Who

Kind = Literal["learn", "recalibrate", "build", "costs", "before"]
MOST_VERSIONS: Final = 30
"""Number of versions that are stored; the oldest that is not in use goes first. A press takes some ten megabytes."""
DIGEST_LETTERS: Final = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Version:
    """One version of the press."""

    digest: str
    kind: Kind
    """How it was made; ``before``: it was in use before the first one was made here."""
    created_s: float
    """Unix time. [s]"""
    by: str
    facts: Mapping[str, Any]
    """What was learned or labelled, and the effect on the last runs, as JSON."""

    @property
    def name(self) -> str:
        """Short name of the version."""
        return self.digest[:DIGEST_LETTERS]

    @classmethod
    def read(cls, path: Path) -> Self | None:
        """Return the version that a JSON file states; None: it states none."""
        try:
            return cls(**json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError):
            return None


class PressVersions:
    """Versions of one press. The methods are thread-safe."""

    def __init__(self, press: Path, accounts: Accounts) -> None:
        self.press = press
        self.folder = press.with_name(press.name + ".versions")
        self._accounts = accounts
        self._guard = threading.Lock()

    def in_use(self) -> tuple[Press, str]:
        """Return the press that is in use, and its digest; raises ``Problem`` 503 if it cannot be read."""
        try:
            return press_of(self.press, content_stamp(self.press))
        except (OSError, ProoflightError) as error:
            raise Problem(503, "no-press", str(error)) from error

    def listed(self) -> list[Version]:
        """Return the versions, the latest first."""
        files = self.folder.glob("*.json") if self.folder.is_dir() else ()
        versions = [one for file in files if (one := Version.read(file)) is not None]
        return sorted(versions, key=lambda one: (one.created_s, one.digest), reverse=True)

    def file_of(self, digest: str) -> Path:
        """Return the artefact of a version, which may not exist."""
        return self.folder / f"{digest[:DIGEST_LETTERS]}.press"

    def files(self) -> list[Path]:
        """Return the artefacts of all versions."""
        return [file for one in self.listed() if (file := self.file_of(one.digest)).exists()]

    def add(self, artefact: Path, version: Version) -> Version:
        """Move an artefact that was made to the versions; an equal version is replaced."""
        with self._guard:
            artefact.replace(self.file_of(version.digest))
            self._state(version)
            self._drop_oldest()
        return version

    def use(self, digest: str, *, seen: str, who: Who) -> Version:
        """Put a version to use; runs that begin from now on use it.

        Raises ``Problem`` 404 if there is no such version, 412 if another one is in use than ``seen``, and 503 if the
        file cannot be written.
        """
        with self._guard:
            version = next((one for one in self.listed() if one.digest == digest), None)
            if version is None or not self.file_of(digest).exists():
                raise not_found(f"there is no version {digest[:DIGEST_LETTERS]!r} of this press")
            with self._alone():
                press, before = self.in_use()
                if before != seen:
                    raise Problem(412, "changed", "another version was put to use meanwhile: reload the page")
                if Press.load(self.file_of(digest)).digest != digest:
                    raise Problem(409, "damaged", f"the file of version {version.name} is another press")
                self._keep(press, before)
                # The audit first, so that nothing is in use without a record.
                after = {"digest": digest, "how": version.kind, "made_by": version.by}
                self._note(who, "press.use", {"digest": before}, after)
                try:
                    with whole_file(self.press) as unfinished:
                        shutil.copyfile(self.file_of(digest), unfinished)
                except OSError as error:
                    self._note(who, "press.unused", {}, {"digest": digest, "why": str(error)})
                    what = f"{self.press.name} cannot be written ({error.strerror})"
                    raise Problem(503, "unsaved", what) from error
        return version

    def _keep(self, press: Press, digest: str) -> None:
        """Store the press in use among the versions, if it is not there."""
        if self.file_of(digest).exists():
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        with whole_file(self.file_of(digest)) as unfinished:
            shutil.copyfile(self.press, unfinished)
        created_s = self.press.stat().st_mtime
        self._state(
            Version(digest=digest, kind="before", created_s=created_s, by="", facts={"press": press.name})
        )

    def _state(self, version: Version) -> None:
        with whole_file(self.folder / f"{version.name}.json") as unfinished:
            unfinished.write_text(json.dumps(asdict(version), indent=1), encoding="utf-8")

    def _drop_oldest(self) -> None:
        _, digest = self.in_use()
        for one in [one for one in self.listed() if one.digest != digest][MOST_VERSIONS - 1 :]:
            self.file_of(one.digest).unlink(missing_ok=True)
            (self.folder / f"{one.name}.json").unlink(missing_ok=True)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Let nobody learn for this press meanwhile."""
        lock = WriterLock.take(
            self.press,
            error=RequestError,
            wait="wait until the other call has ended",
            elsewhere="let the console write next to the press",
        )
        try:
            yield
        finally:
            lock.release()

    def _note(self, who: Who, what: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
        self._accounts.note(who.name, what, self.press.name, before=before, after=after)
