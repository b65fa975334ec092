"""Packages from the command line: a line for each fault, exit 2, and nothing half-written."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from packages.line.tests.run_package.conftest import Packed, copied
from tests.cli.calls import call


@pytest.fixture(autouse=True)
def _own_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


def test_a_run_is_packaged_and_verified(
    packed: Packed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    archive, journal = tmp_path / "run.zip", packed.journal
    code, _, err = call(capsys, "run", "package", 1, "-o", archive, "--journal", journal)
    assert (code, archive.exists()) == (2, False)
    assert "there is no key; create one with `prooflight run key`" in err
    made = json.loads(call(capsys, "run", "key", "--json")[1])
    again = json.loads(call(capsys, "run", "key", "--json")[1])
    assert (made["new"], again["new"], made["key"]) == (True, False, again["key"])
    result = tmp_path / "run.xjmf"
    options = ("--journal", journal, "--press", packed.press, "--xjmf", result)
    code, out, err = call(capsys, "run", "package", 1, "-o", archive, *options)
    assert (code, err) == (0, "")
    with zipfile.ZipFile(archive) as members:
        assert members.read("result.xjmf") == result.read_bytes()
    assert made["key"] in out
    code, out, err = call(capsys, "verify", archive)
    assert (code, err) == (0, "")
    assert "Verdicts: 2 of 2 with evidence are the same in every digit; 1 sheet without" in out
    changed = bytearray(archive.read_bytes())
    changed[len(changed) // 2] ^= 1
    archive.write_bytes(changed)
    code, _, err = call(capsys, "verify", archive)
    assert code == 2
    assert f"signature: not valid for key {made['key']}" in err
    code, out, _ = call(capsys, "verify", packed.archive, "--key", made["public"], "--json")
    assert code == 2
    assert json.loads(out)["signed_by"] is None


def test_what_is_no_package_is_refused_in_one_line(
    packed: Packed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "no.zip").write_text("no archive")
    for path in (tmp_path / "no.zip", packed.press):
        code, _, err = call(capsys, "verify", path)
        assert code == 2
        assert "Traceback" not in err
    code, _, err = call(capsys, "verify", tmp_path / "none.zip")
    assert code == 2
    assert "none.zip" in err


def test_a_hold_shows_until_it_is_lifted(
    packed: Packed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = copied(packed.journal, tmp_path)
    assert "On legal hold since" in call(capsys, "run", "show", 1, "--journal", journal)[1]
    hold = ("run", "hold", 1, "--by", "Bert", "--journal", journal, "--reason")
    assert call(capsys, *hold, "again")[0] == 2
    assert call(capsys, *hold, "settled", "--lift")[0] == 0
    assert "On legal hold" not in call(capsys, "run", "show", 1, "--journal", journal)[1]
