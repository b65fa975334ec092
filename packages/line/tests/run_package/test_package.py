"""A package holds all evidence of a run, in the same bytes each time, and no changed byte passes."""

from __future__ import annotations

import hashlib
import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from packages.line.tests.run_package.conftest import Packed, copied, write_package

from prooflight.errors import PressError, RequestError
from prooflight_line.journal.journal import Journal
from prooflight_line.run_package.archive import Member, write_archive
from prooflight_line.run_package.contents import PAGES, PackageContents, refuse_running
from prooflight_line.run_package.signing import SigningKey
from prooflight_line.run_package.verifying import Verified, verify

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from prooflight.press.artefact import Press


def verified(packed: Packed, archive: Path, **more: Any) -> Verified:
    return verify(archive, [packed.key.public], **more)


def rewritten(packed: Packed, out: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """A package whose members are changed, with a manifest that fits them, signed by the same key."""
    with zipfile.ZipFile(packed.archive) as archive:
        facts = json.loads(archive.read("manifest.json"))
        of_name = {one["path"]: archive.read(one["path"]) for one in facts.pop("members")}
    facts.pop("format")
    changed = {name: change(name, content) for name, content in of_name.items()}
    members = [
        Member(path=name, content=[content]) for name, content in changed.items() if content is not None
    ]
    write_archive(out, members, packed.key, facts=lambda: facts)
    return out


def test_a_package_is_verified_and_every_verdict_comes_again(packed: Packed) -> None:
    result = verified(packed, packed.archive)
    assert result.faults == []
    assert result.signed_by == packed.key.public.name
    assert (result.sheets, result.with_evidence, result.same, result.replay) == (3, 2, 2, "")
    assert result.manifest is not None
    assert result.members == len(result.manifest.members)
    assert result.other_versions == {}


def test_the_same_run_gives_the_same_bytes(packed: Packed, tmp_path: Path) -> None:
    write_package(packed, tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == packed.archive.read_bytes()


def test_a_package_holds_what_its_manifest_says(packed: Packed) -> None:
    with zipfile.ZipFile(packed.archive) as archive:
        manifest = json.loads(archive.read("manifest.json"))
        for one in manifest["members"]:
            content = archive.read(one["path"])
            assert (len(content), hashlib.sha256(content).hexdigest()) == (one["bytes"], one["sha256"])
        rows = [json.loads(line) for line in archive.read(PAGES).splitlines()]
        labels = [json.loads(line) for line in archive.read("labels.jsonl").splitlines()]
        audit = [json.loads(line) for line in archive.read("audit.jsonl").splitlines()]
        run = json.loads(archive.read("run.json"))
        names = archive.namelist()
        assert archive.read("press/rig.press") == packed.press.read_bytes()
        assert archive.read("report.pdf").startswith(b"%PDF")
    assert [row["sheet"] for row in rows] == [0, 1, 2]
    assert [row["evidence"] in names for row in rows[:2]] == [True, True]
    assert rows[2]["evidence"] is None
    assert [(one["word"], one["by"]) for one in labels] == [("misprint", "Jörg"), ("hold", "Anna")]
    assert [one["id"] for one in audit] == [1, 4]  # not those of run 11, nor of users
    assert run["settings"]["seed"] == 3
    assert {"prooflight", "program", "numpy", "python", "journal"} <= manifest["versions"].keys()
    assert any(name.startswith("pictures/sheet0000001") for name in names)


def small(path: Path, key: SigningKey) -> Path:
    """A package of no sheets."""
    named = dict.fromkeys(("key", "job", "press", "press_digest", "detector"), "x")
    facts = {"run": 1, "versions": {}, "missing": [], **named}
    members = [
        Member(path="run.json", content=[b"{}\n" * 9]),
        Member(path="a", content=[b"ab"], packed=False),
    ]
    write_archive(path, members, key, facts=lambda: facts)
    return path


@pytest.fixture(scope="module")
def smallest(packed: Packed, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of a package of no sheets."""
    path = small(tmp_path_factory.mktemp("small") / "small.zip", packed.key)
    assert verified(packed, path).faults == []
    return path.read_bytes()


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_any_changed_byte_is_a_fault(data: st.DataObject, packed: Packed, smallest: bytes) -> None:
    at = data.draw(st.integers(0, len(smallest) - 1))
    changed = bytearray(smallest)
    changed[at] ^= data.draw(st.integers(1, 255))
    path = packed.archive.with_name("changed.zip")
    path.write_bytes(changed)
    assert faults_of(packed, path)


def test_a_package_that_is_cut_or_longer_is_a_fault(packed: Packed, smallest: bytes, tmp_path: Path) -> None:
    for content in (smallest[:-1], smallest[:100], b"", smallest + b"\n", b"x" + smallest):
        (tmp_path / "cut.zip").write_bytes(content)
        assert faults_of(packed, tmp_path / "cut.zip")


def faults_of(packed: Packed, path: Path) -> list[str]:
    try:
        result = verified(packed, path)
    except RequestError as error:
        return [str(error)]
    assert not (result.signed_by and not result.faults)
    return result.faults


def test_a_changed_member_is_named(packed: Packed, tmp_path: Path) -> None:
    """Also if somebody puts another file of the same length in its place, with its check sum."""
    with zipfile.ZipFile(packed.archive) as archive, zipfile.ZipFile(tmp_path / "x.zip", "w") as changed:
        for info in archive.infolist():
            content = archive.read(info)
            changed.writestr(
                info, content.replace(b'"misprint"', b'"good"    ') if info.filename == PAGES else content
            )
        changed.writestr("more.txt", "more")
        changed.comment = archive.comment
    result = verified(packed, tmp_path / "x.zip")
    assert not result.signed_by
    assert any(line.startswith("signature: not valid for key") for line in result.faults)
    assert f"{PAGES}: it differs from the manifest" in result.faults
    assert "more.txt: not in the manifest" in result.faults
    assert any(line.startswith("sheet 1: verdict was recorded as good") for line in result.faults)


def test_a_figure_that_does_not_follow_from_the_evidence_is_seen_though_it_was_signed(
    packed: Packed, tmp_path: Path
) -> None:
    def lower(name: str, content: bytes) -> bytes:
        if name != PAGES:
            return content
        rows = [json.loads(line) for line in content.splitlines()]
        rows[1]["score"] *= 1 - 1e-6
        return "".join(json.dumps(row) + "\n" for row in rows).encode()

    result = verified(packed, rewritten(packed, tmp_path / "lower.zip", lower))
    assert result.signed_by
    assert (result.with_evidence, result.same) == (2, 1)
    assert len(result.faults) == 1
    assert result.faults[0].startswith("sheet 1: score was recorded as")


def test_a_signature_of_an_unknown_key_does_not_count(packed: Packed, tmp_path: Path) -> None:
    other = SigningKey.make(tmp_path / "other.key")
    for keys in ([], [other.public]):
        result = verify(packed.archive, keys)
        assert result.signed_by == ""
        assert result.faults == [
            f"signature: by key {packed.key.public.name}, which was not given; give its public half by --key"
        ]


def test_without_its_press_a_package_says_that_nothing_was_computed_again(
    packed: Packed, tmp_path: Path
) -> None:
    without = rewritten(
        packed, tmp_path / "less.zip", lambda name, content: None if name.startswith("press/") else content
    )
    result = verified(packed, without)
    assert (result.faults, result.same, result.with_evidence) == ([], 0, 2)
    assert "has no press artefact" in result.replay
    assert verified(packed, without, press=packed.press).same == 2


def test_another_press_is_refused(packed: Packed, press: Press, tmp_path: Path) -> None:
    from dataclasses import replace

    replace(press, name="another").save(tmp_path / "another.press")
    with pytest.raises(PressError, match="the run was judged by"):
        verified(packed, packed.archive, press=tmp_path / "another.press")
    other = (tmp_path / "another.press").read_bytes()
    changed = rewritten(
        packed, tmp_path / "p.zip", lambda name, content: other if name.startswith("press/") else content
    )
    assert any("the run was judged by" in line for line in verified(packed, changed).faults)


def test_evidence_that_is_gone_is_stated(packed: Packed, tmp_path: Path) -> None:
    journal = copied(packed.journal, tmp_path)
    gone = next((tmp_path / "j.sqlite.evidence").rglob("*.npz"))
    gone.unlink()
    write_package(packed._replace(journal=journal), tmp_path / "r.zip")
    assert (
        f"evidence/{gone.name}: was missing when the package was created"
        in verified(packed, tmp_path / "r.zip").faults
    )


def test_no_file_is_left_of_a_package_that_fails(packed: Packed, tmp_path: Path) -> None:
    def members() -> Iterator[Member]:
        yield Member(path="a", content=[b"a"])
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        write_archive(tmp_path / "a.zip", members(), packed.key, facts=dict)
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_goes_on_is_refused(journal_of_run: Path) -> None:
    from dataclasses import replace

    with Journal.open(str(journal_of_run), read_only=True) as journal:
        run = journal.run(1)
        refuse_running(run)
        with pytest.raises(RequestError, match="still being printed"):
            refuse_running(replace(run, state="running"))
        assert PackageContents(journal=journal, run=run).facts()["run"] == 1
