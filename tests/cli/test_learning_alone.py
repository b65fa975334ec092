"""Two calls of ``press learn`` for one press at once: the second is refused, so that no page is lost."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

from prooflight.errors import RequestError
from prooflight.files.lock import WriterLock

if TYPE_CHECKING:
    from pathlib import Path


def test_a_second_call_is_refused_in_one_line_while_the_first_learns(tmp_path: Path) -> None:
    press = tmp_path / "x.press"
    press.write_bytes(b"")
    command = [sys.executable, "-m", "prooflight", "press", "learn", str(press), "job.pdf", "scans", "--good"]
    lock = WriterLock.take(press, error=RequestError, wait="", elsewhere="")
    try:
        refused = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    finally:
        lock.release()
    assert refused.returncode == 2
    assert "another process" in refused.stderr
    assert "wait until the other call has ended" in " ".join(refused.stderr.split())
    free = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert free.returncode == 2
    assert "another process" not in free.stderr
