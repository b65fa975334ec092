"""What commands there are and what each takes, and that saying so loads nothing; also without the studies."""

from __future__ import annotations

import subprocess
import sys

import pytest

WITHOUT_STUDIES = """
import importlib.metadata, sys
found = importlib.metadata.entry_points
def entry_points(*, group, **more):
    return found(group="none" if group == "prooflight.commands" else group, **more)
importlib.metadata.entry_points = entry_points
from prooflight.cli import run
sys.exit(run(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    "words", [("study",), ("study", "--help"), ("study", "ink", "--chart", "x"), ("bench", "--json")]
)
def test_without_the_studies_their_commands_end_in_one_clear_line(words: tuple[str, ...]) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", WITHOUT_STUDIES, *words], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 2
    assert ended.stdout == ""
    (line,) = ended.stderr.splitlines()
    assert line.startswith(f"prooflight: prooflight {words[0]}: the studies are not installed; install ")


def test_what_is_listed_is_there_and_listing_it_loads_nothing() -> None:
    listed = """
import sys
from prooflight.cli import run
assert run(["--help"]) == 0
assert not {"numpy", "numba", "cv2", "sqlalchemy", "prooflight_studies"} & set(sys.modules)
from prooflight.cli.commands import LISTED, Commands
group = Commands()
assert set(LISTED) == set(group.list_commands(None))
for name in LISTED:
    assert group.get_command(None, name).name == name
"""
    ended = subprocess.run([sys.executable, "-c", listed], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert all(f"\n  {name} " in ended.stdout for name in ("demo", "inspect", "run", "press", "study"))


def test_a_commands_options_are_shown_without_what_it_needs() -> None:
    shown = """
import sys
from prooflight.cli import run
from prooflight.cli.commands import Commands

def shows(path, command):
    assert run([*path, "--help"]) == 0
    loaded = {"numpy", "numba", "scipy", "cv2", "sqlalchemy", "matplotlib"} & set(sys.modules)
    assert not loaded, f"{' '.join(path)} --help loads {', '.join(sorted(loaded))}"
    for name, one in getattr(command, "commands", {}).items():
        shows([*path, name], one)

group = Commands()
for name in group.list_commands(None):
    shows([name], group.get_command(None, name))
"""
    ended = subprocess.run([sys.executable, "-c", shown], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    words = (
        "demo",
        "inspect",
        "watch",
        "runs",
        "run tidy",
        "press build",
        "camera mtf",
        "study paper",
        "bench",
    )
    assert all(f"Usage: prooflight {word} " in ended.stdout for word in words)
