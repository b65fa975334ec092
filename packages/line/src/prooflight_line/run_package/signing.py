"""Signatures of packages: Ed25519 in the file formats of minisign (decision 63).

minisign signs the BLAKE2b-512 digest of a file, and, in a second signature, the first one with a comment. Its files are
lines of text: comments, and base64 of 2 letters for the algorithm, 8 bytes of key number, and the key or signature.
Source: https://jedisct1.github.io/minisign/, "Signature format" and "Public key format".
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import os
import stat
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles
from prooflight.files.user_folders import user_folder

if TYPE_CHECKING:
    from pathlib import Path

KEY_ALGORITHM: Final = b"Ed"
SIGNATURE_ALGORITHM: Final = b"ED"
"""Ed25519 of a BLAKE2b-512 digest; minisign's older "Ed" signs the file itself."""
NUMBER_BYTES: Final = 8
COMMENT: Final = "untrusted comment: signature by Prooflight"
TRUSTED: Final = "trusted comment: "
MAKE_ONE: Final = "create one with `prooflight run key`"
ANOTHER_KEY: Final = "give a public key of minisign, such as `prooflight run key` writes"
_SECRETS: Final = GivenFiles(error=RequestError, remedy=MAKE_ONE, largest_mb=0.01)
_PUBLIC: Final = GivenFiles(error=RequestError, remedy=ANOTHER_KEY, largest_mb=0.01)


def default_key() -> Path:
    """Return the path of the user's secret key; its public half lies next to it, as ``.pub``."""
    return user_folder("data") / "package-signing.key"


@dataclass(frozen=True, slots=True, kw_only=True)
class PublicKey:
    """Public half of a key."""

    number: bytes
    """Number of the key: 8 bytes."""
    raw: bytes
    """The key: 32 bytes."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a public key of minisign; RequestError: it is none."""
        lines = [line for line in _PUBLIC.read_text(path).splitlines() if line]
        try:
            content = base64.b64decode(lines[-1], validate=True)
        except (IndexError, binascii.Error, ValueError):
            content = b""
        if len(content) != 42 or not content.startswith(KEY_ALGORITHM):
            raise RequestError(path, "is not a public key", remedy=ANOTHER_KEY)
        return cls(number=content[2:10], raw=content[10:])

    @property
    def name(self) -> str:
        """Number of the key as minisign shows it."""
        return self.number[::-1].hex().upper()

    @property
    def text(self) -> str:
        """Content of its file."""
        return f"untrusted comment: minisign public key {self.name}\n{_base64(KEY_ALGORITHM, self.number, self.raw)}\n"

    def verifies(self, signature: Signature, digest: bytes) -> bool:
        """Return whether this key made a signature of a BLAKE2b-512 digest, with its comment."""
        public = Ed25519PublicKey.from_public_bytes(self.raw)
        try:
            public.verify(signature.signature, digest)
            public.verify(signature.of_comment, signature.signature + signature.comment.encode())
        except InvalidSignature:
            return False
        return signature.number == self.number


@dataclass(frozen=True, slots=True, kw_only=True)
class Signature:
    """Signature of a digest and of a comment."""

    number: bytes
    signature: bytes
    comment: str
    of_comment: bytes
    """Signature of the first signature and the comment."""

    @classmethod
    def parse(cls, text: bytes) -> Self:
        """Read a signature; ValueError: the text is not exactly one as ``text`` writes it."""
        lines = text.decode().split("\n")
        content = base64.b64decode(lines[1], validate=True) if len(lines) == 5 else b""
        if len(content) != 74:
            raise ValueError("it is not a signature of minisign")
        parsed = cls(
            number=content[2:10],
            signature=content[10:],
            comment=lines[2].removeprefix(TRUSTED),
            of_comment=base64.b64decode(lines[3], validate=True),
        )
        if parsed.text != text:
            raise ValueError("it is not as Prooflight writes it")
        return parsed

    @property
    def text(self) -> bytes:
        """The signature as minisign writes it."""
        first = _base64(SIGNATURE_ALGORITHM, self.number, self.signature)
        return f"{COMMENT}\n{first}\n{TRUSTED}{self.comment}\n{_base64(self.of_comment)}\n".encode()

    @property
    def key_name(self) -> str:
        """Number of its key as minisign shows it."""
        return self.number[::-1].hex().upper()


@dataclass(frozen=True, slots=True)
class SigningKey:
    """Secret key by which packages are signed."""

    _key: Ed25519PrivateKey

    @classmethod
    def make(cls, path: Path) -> Self:
        """Make a key and write both halves, the secret one for its owner alone; RequestError: there is one.

        The public half is written next to it, as ``.pub``.
        """
        signing = cls(Ed25519PrivateKey.generate())
        content = signing._key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError as error:
            remedy = "move it away; packages that it signed need its public half"
            raise RequestError(path, "exists already", remedy=remedy) from error
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            os.fsync(handle)
        public_path(path).write_text(signing.public.text)
        return signing

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a key; RequestError: there is none, or others may read it."""
        try:
            content = _SECRETS.read(path)
            others_read = path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO)
        except FileNotFoundError as error:
            raise RequestError(path, "there is no key", remedy=MAKE_ONE) from error
        if os.name == "posix" and others_read:
            raise RequestError(
                path, "can be read by others", remedy=f"chmod 600 {path}, or create another key"
            )
        try:
            key = serialization.load_pem_private_key(content, password=None)
        except (ValueError, TypeError) as error:
            raise RequestError(path, "is not a secret key", remedy=MAKE_ONE) from error
        if not isinstance(key, Ed25519PrivateKey):
            raise RequestError(path, "is not an Ed25519 key", remedy=MAKE_ONE)
        return cls(key)

    @property
    def public(self) -> PublicKey:
        """Its public half, numbered by the beginning of its digest."""
        raw = self._key.public_key().public_bytes_raw()
        return PublicKey(number=hashlib.blake2b(raw, digest_size=NUMBER_BYTES).digest(), raw=raw)

    def sign(self, digest: bytes, *, comment: str) -> Signature:
        """Sign a BLAKE2b-512 digest and a comment of one line; the same input gives the same signature."""
        signature = self._key.sign(digest)
        of_comment = self._key.sign(signature + comment.encode())
        return Signature(
            number=self.public.number, signature=signature, comment=comment, of_comment=of_comment
        )


def public_path(path: Path) -> Path:
    """Return the path of the public half of a secret key."""
    return path.with_suffix(".pub")


def _base64(*parts: bytes) -> str:
    return base64.b64encode(b"".join(parts)).decode()
