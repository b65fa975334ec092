"""Evidence of sheets as objects that are named by their digest: in a folder, or in a store as S3 offers.

An object never changes, so that shipping it again changes nothing, and a reader can verify what it gets.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from prooflight_line.records.database import INSTALL, RecordsError

if TYPE_CHECKING:
    from pathlib import Path
    from typing import Self


@dataclass(frozen=True, kw_only=True)
class ObjectStore:
    """A store of objects. Methods raise OSError where it cannot be reached."""

    url: str
    store: Any

    @classmethod
    def open(cls, url: str) -> Self:
        """Open a store by URL (file:///FOLDER, s3://BUCKET/PREFIX, ...). RecordsError: it is no such URL."""
        try:
            import obstore
            from obstore.exceptions import BaseError
        except ImportError as error:
            raise RecordsError("pictures", "obstore is not installed", remedy=INSTALL) from error
        try:
            if url.startswith("file:"):
                return cls(url=url, store=obstore.store.from_url(url, mkdir=True))
            return cls(url=url, store=obstore.store.from_url(url))
        except (BaseError, ValueError) as error:
            what = f"is not a store of objects ({str(error).splitlines()[0]})"
            raise RecordsError(url, what, remedy="give file:///FOLDER or s3://BUCKET/PREFIX") from error

    def put(self, file: Path) -> str | None:
        """Store a file unless it is there; return its digest, None if there is no such file."""
        import obstore
        from obstore.exceptions import AlreadyExistsError, BaseError

        try:
            content = file.read_bytes()
        except FileNotFoundError:
            return None  # retention took it
        digest = hashlib.sha256(content).hexdigest()
        try:
            obstore.put(self.store, _name(digest), content, mode="create")
        except AlreadyExistsError:
            pass
        except BaseError as error:
            raise OSError(f"{self.url}: {str(error).splitlines()[0]}") from error
        return digest

    def get(self, digest: str) -> bytes:
        """Return an object's bytes; ValueError: they are not those of its digest; OSError: there is none."""
        import obstore
        from obstore.exceptions import BaseError

        try:
            content = bytes(obstore.get(self.store, _name(digest)).bytes())
        except (
            BaseError,
            FileNotFoundError,
        ) as error:  # the latter of an object that is not there, with a page of text
            raise OSError(f"{self.url}: {str(error).splitlines()[0]}") from error
        if hashlib.sha256(content).hexdigest() != digest:
            raise ValueError(f"{digest}: the object is damaged")
        return content


def _name(digest: str) -> str:
    return f"sha256/{digest[:2]}/{digest}.npz"
