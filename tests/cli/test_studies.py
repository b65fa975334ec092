"""``prooflight study`` and ``bench`` where the package of studies is not installed."""

from __future__ import annotations

import subprocess
import sys

import pytest

WITHOUT_STUDIES = """
import importlib.metadata, sys
found = importlib.metadata.entry_points
def entry_points(*, group):
    return found(group="none" if group == "prooflight.commands" else group)
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
