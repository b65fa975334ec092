"""Calls of commands within the process of a test, and the words that start one of its own."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from prooflight.__main__ import main
from prooflight.cli import run

if TYPE_CHECKING:
    import pytest

PROOFLIGHT = (
    sys.executable,
    "-c",
    "import os; os.cpu_count = lambda: 1; from prooflight.__main__ import main; main()",
)
"""``prooflight`` as a process that starts no others, each of which would load all kernels again."""


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = run([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def prooflight(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["prooflight", *map(str, arguments)])
    try:
        return int(main() or 0)
    except SystemExit as left:
        return int(left.code or 0)
