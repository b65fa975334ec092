"""`prooflight doctor`: what a machine lacks is in the table, and what is needed makes the exit code."""

from __future__ import annotations

import json
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.cli.calls import call

from prooflight_line.cli.doctor import machine
from prooflight_line.cli.doctor.machine import Finding, needs


def found(capsys: pytest.CaptureFixture[str], journal: Path) -> tuple[int, dict[str, dict[str, Any]]]:
    code, out, err = call(capsys, "doctor", "--journal", journal, "--json")
    assert err == ""
    return code, {one["what"]: one for one in json.loads(out)["findings"]}


@pytest.fixture(autouse=True)
def _enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with memory and disk."""
    monkeypatch.setattr(machine, "available_bytes", lambda: 16e9)
    monkeypatch.setattr(machine.shutil, "disk_usage", lambda _: SimpleNamespace(free=86.4e9, total=100e9))


def test_a_machine_that_has_all_that_is_needed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, of = found(capsys, tmp_path / "new" / "runs.sqlite")
    assert code == 0
    assert of["prooflight-line"]["state"] == of["memory"]["state"] == of["disk"]["state"] == "good"
    assert "100 days of rows at 5 sheets/s" in of["disk"]["detail"]  # 0.864 GB a day
    assert {"cameras by aravis", "cameras by viva", "cameras by pylon", "cores", "clock"} <= set(of)
    assert not (tmp_path / "new").exists()  # looking changes nothing
    code, out, _ = call(capsys, "doctor", "--journal", tmp_path / "runs.sqlite")
    assert code == 0
    assert "give --press" in out


def test_what_is_needed_and_missing_makes_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "available_bytes", lambda: 1e9)
    code, of = found(capsys, tmp_path / "runs.sqlite")
    assert code == 1
    assert of["memory"]["state"] == "lacking"
    monkeypatch.setattr(machine, "available_bytes", lambda: 16e9)
    monkeypatch.setattr(machine.shutil, "disk_usage", lambda _: SimpleNamespace(free=1e8, total=100e9))
    code, of = found(capsys, tmp_path / "runs.sqlite")
    assert (code, of["disk"]["state"]) == (1, "lacking")


def test_libraries_that_are_missing_are_named_with_what_installs_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    own = machine.version

    def without(*names: str) -> None:
        def version(name: str) -> str:
            if name in names:
                raise PackageNotFoundError(name)
            return own(name)

        monkeypatch.setattr(machine, "version", version)

    without("asyncua", "prooflight-studies")
    code, of = found(capsys, tmp_path / "runs.sqlite")
    assert code == 0  # not everybody needs them
    assert of["prooflight-line[plant]"] == {
        "what": "prooflight-line[plant]",
        "state": "optional",
        "detail": "without asyncua",
        "remedy": 'pip install "prooflight-line[plant]"',
    }
    assert of["prooflight-studies"]["remedy"] == "install it from the repository's folder studies"
    without("sqlalchemy")
    code, of = found(capsys, tmp_path / "runs.sqlite")
    assert code == 1
    assert of["prooflight-line"] == {
        "what": "prooflight-line", "state": "lacking", "detail": "without sqlalchemy",
        "remedy": 'pip install "prooflight-line"',
    }  # fmt: skip


def test_requirements_are_read_as_packages_state_them() -> None:
    lines = [
        "numba>=0.61",
        "numba-cuda[cu13]>=0.30; extra == 'gpu'",
        'uvicorn (>=0.34) ; extra == "a-b"',
        "x",
    ]
    assert needs("p", listed=lambda _: lines) == {
        "": ["numba", "x"], "gpu": ["numba-cuda"], "a-b": ["uvicorn"]
    }  # fmt: skip
    assert needs("p", listed=lambda _: None) == {"": []}


@pytest.mark.parametrize(("state", "expected"), [(0, "good"), (5, "look"), (-1, "look")])
def test_the_clock(monkeypatch: pytest.MonkeyPatch, state: int, expected: str) -> None:
    monkeypatch.setattr(machine.sys, "platform", "linux")
    monkeypatch.setattr(machine.ctypes, "CDLL", lambda *_a, **_k: SimpleNamespace(adjtimex=lambda _: state))
    clock: Finding = machine._of_clock()
    assert clock.state == expected


def test_inspections_are_measured_on_this_machine(
    tmp_path: Path, press_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("doctor", "--press", press_file, "--journal", tmp_path / "runs.sqlite")
    _, out, _ = call(capsys, *given, "--json")
    speed = json.loads(out)["speed"]
    assert speed["detector"] == "chi-square"
    assert speed["page_mm"][0] <= 42.2  # as wide as the press sees
    assert speed["inspect_s"] > 0
    assert speed["prepare_s"] > 0
