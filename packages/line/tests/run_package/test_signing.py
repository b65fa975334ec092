"""Keys and signatures are those of minisign, and nothing but a whole signature passes."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.errors import RequestError
from prooflight_line.run_package.signing import PublicKey, Signature, SigningKey, public_path

# Made by minisign 0.11, of the file "A sheet\n".
FOREIGN_KEY = (
    "untrusted comment: minisign public key 2752245EBA36A607\n"
    "RWQHpja6XiRSJ3M0hjiDDlbtxJisLHn2wJJqSt8zkPfdIyEBJ4Nmf2jq\n"
)
FOREIGN = (
    b"untrusted comment: signature by Prooflight\n"
    b"RUQHpja6XiRSJ/cS45/m0BB9pB3GGeiAbEIWE88qSkt0ddDLgSpCmnsAUaERouvceFoznE4ESIl8a+UQwoszLnXt+4UnP8N5xgw=\n"
    b"trusted comment: by another program\n"
    b"yaUMXNCIFzrwiUOysFwZJOWNYjJT3h2Tzp6iO86idxLneG27uX6Vfe5TullRHPNoXGp3g65NTW9fSTAG9LSYAw==\n"
)


def digest(content: bytes) -> bytes:
    return hashlib.blake2b(content).digest()


@pytest.fixture
def key(tmp_path: Path) -> SigningKey:
    return SigningKey.make(tmp_path / "a.key")


def test_a_signature_of_minisigns_own_format_is_verified(tmp_path: Path) -> None:
    path = tmp_path / "foreign.pub"
    path.write_text(FOREIGN_KEY)
    key, signature = PublicKey.read(path), Signature.parse(FOREIGN)
    assert key.text == FOREIGN_KEY
    assert signature.comment == "by another program"
    assert key.verifies(signature, digest(b"A sheet\n"))
    assert not key.verifies(signature, digest(b"A sheet"))


@given(at=st.integers(0, len(FOREIGN) - 1), bits=st.integers(1, 255))
def test_any_changed_byte_of_a_signature_is_seen(
    at: int, bits: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "foreign.pub"
    path.write_text(FOREIGN_KEY)
    changed = bytearray(FOREIGN)
    changed[at] ^= bits
    try:
        signature = Signature.parse(bytes(changed))
    except ValueError:
        return
    assert not PublicKey.read(path).verifies(signature, digest(b"A sheet\n"))


def test_a_key_is_for_its_owner_alone_and_comes_back_from_its_file(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "a.key"
    key = SigningKey.make(path)
    assert path.stat().st_mode & 0o777 == 0o600
    again = SigningKey.load(path)
    signature = again.sign(digest(b"x"), comment="c")
    assert signature == key.sign(digest(b"x"), comment="c")
    assert PublicKey.read(public_path(path)).verifies(Signature.parse(signature.text), digest(b"x"))
    with pytest.raises(RequestError, match="exists already"):
        SigningKey.make(path)
    assert SigningKey.load(path).public == key.public


@pytest.mark.skipif(os.name != "posix", reason="modes of files are POSIX's")
def test_a_key_that_others_can_read_is_refused(key: SigningKey, tmp_path: Path) -> None:
    (tmp_path / "a.key").chmod(0o640)
    with pytest.raises(RequestError, match="can be read by others"):
        SigningKey.load(tmp_path / "a.key")


def test_what_is_no_key_is_refused_in_one_line(tmp_path: Path) -> None:
    bad = tmp_path / "bad.key"
    bad.write_text("no key")
    bad.chmod(0o600)
    with pytest.raises(RequestError, match="is not a secret key"):
        SigningKey.load(bad)
    with pytest.raises(RequestError, match="is not a public key"):
        PublicKey.read(bad)
    with pytest.raises(RequestError, match="there is no key; create one"):
        SigningKey.load(tmp_path / "none.key")
