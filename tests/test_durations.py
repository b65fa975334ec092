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
    busy(0.8)

def test_slow():
    busy(0.3)

def test_quick():
    time.sleep(0.3)

@pytest.mark.parametrize("number", [1, 2])
def test_shared(common, number):
    assert number
"""
SOONER = "from tests import durations\ndurations.SLOW_S = durations.LONG_S = 0.2\n"
"""So that the test of this is not slow itself."""


def test_a_test_is_slow_by_its_processor_time_and_its_share_of_common_fixtures(tmp_path: Path) -> None:
    """Not by how long it waits, which is recorded beside, and not because it is the first that needs a fixture."""
    (tmp_path / "conftest.py").write_text(SOONER, encoding="utf-8")
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
    slow = {f"test_some.py::test_{name}" for name in ("slow", "shared[1]", "shared[2]")}
    assert set(found["slow"]) == slow
    assert set(found["long"]) == slow | {"test_some.py::test_quick"}
    assert found["quick"] == 1


WORKS_THEN_WAITS = """
import time
while time.process_time() < 0.3:
    pass
print(flush=True)
input()
"""


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="what living processes used stands in /proc")
def test_a_child_counts_while_it_works_and_not_when_it_ends() -> None:
    """Or the time of a server that one test leaves running would be that of the test during which it ends."""
    began, _ = durations.spent_s()
    command = [sys.executable, "-c", WORKS_THEN_WAITS]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        child.stdout.readline()
        worked, _ = durations.spent_s()
        child.communicate("\n")
    ended, _ = durations.spent_s()
    assert worked - began > 0.25  # the clock of processes ticks every hundredth of a second
    assert ended - worked < 0.15


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
