"""Which tests are slow, by what was measured; and that nobody is left in doubt of what is left out."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests import durations

TESTS = """
import time, pytest

def busy(seconds):
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass

@pytest.fixture(scope="module")
def common():
    busy(2.6)

def test_slow():
    busy(1.2)

def test_quick():
    time.sleep(1.2)

@pytest.mark.parametrize("number", [1, 2])
def test_shared(common, number):
    assert number
"""


def test_a_test_is_slow_by_its_processor_time_and_its_share_of_common_fixtures(tmp_path: Path) -> None:
    """Not by how long it waits, and not because it is the first that needs a fixture."""
    (tmp_path / "test_some.py").write_text(TESTS, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = slow\n", encoding="utf-8")
    file = tmp_path / "found.json"
    command = [sys.executable, "-m", "pytest", "-p", "tests.durations", "-n", "2", "--record-durations", file]
    ended = subprocess.run(
        [*command, "--rootdir", tmp_path, tmp_path],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout
    found = json.loads(file.read_text(encoding="utf-8"))
    assert set(found["slow"]) == {f"test_some.py::test_{name}" for name in ("slow", "shared[1]", "shared[2]")}
    assert found["quick"] == 1


def recorded(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    file = folder / "durations.json"
    slow = {
        "tests/cli/test_a.py::test_b": 30.0,
        "tests/cli/test_a.py::test_c": 90.0,
        "packages/line/tests/run/test_d.py::test_e": 6.0,
    }
    file.write_text(json.dumps({"quick": 5, "quick_s": 240, "slow": slow}), encoding="utf-8")
    monkeypatch.setattr(durations, "DURATIONS", file)


def config(**options: Any) -> Any:
    return SimpleNamespace(option=SimpleNamespace(**({"markexpr": "", "file_or_dir": []} | options)))


def test_how_long_it_takes_and_what_is_left_out_is_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    recorded(monkeypatch, tmp_path)
    takes, leaves_out, where = durations.pytest_report_header(config(markexpr=durations.QUICK))
    assert "about 2 min on 2 cores" in takes
    assert "3 tests that take more than 1 s" in leaves_out
    assert where == "left out: packages/line 1, tests/cli 2"
    assert durations.pytest_report_header(config()) == ["all tests take about 3 min on 2 cores"]
    assert durations.pytest_report_header(config(file_or_dir=["tests/cli"])) == []


def test_the_slow_are_marked_and_no_other(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    recorded(monkeypatch, tmp_path)
    marked: list[str] = []
    items: list[Any] = [
        SimpleNamespace(nodeid=name, add_marker=lambda mark, name=name: marked.append(f"{name} {mark.name}"))
        for name in ("tests/cli/test_a.py::test_b", "tests/cli/test_a.py::test_f")
    ]
    left_out: list[Any] = []
    config: Any = SimpleNamespace(
        getoption=lambda _: ["tests/cli"],
        hook=SimpleNamespace(pytest_deselected=lambda items: left_out.extend(items)),
    )
    durations.pytest_collection_modifyitems(config, items)
    assert marked == ["tests/cli/test_a.py::test_b slow"]
    assert [one.nodeid for one in items] == ["tests/cli/test_a.py::test_b"]
    assert [one.nodeid for one in left_out] == ["tests/cli/test_a.py::test_f"]
