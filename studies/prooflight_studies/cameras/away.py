"""A camera that is unplugged for long while a job is watched: memory of the run, and how it resumes."""

from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight_line.testing.peer import plugged_in
from prooflight_studies.cameras.deaths import Turning, until, watched
from prooflight_studies.cameras.job import from_file
from prooflight_studies.console.serving import megabytes

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_studies.cameras.rig import Rig

SHEETS_BEFORE: Final = 40
"""Sheets before the camera is unplugged, so that the run has allocated the memory it needs."""
SHEETS_AFTER: Final = 20
SAMPLES: Final = 60
"""Number of samples of memory while the camera is away."""


def away_figures(rig: Rig, *, minutes: float, progress: Callable[[str], None]) -> dict[str, Any]:
    """Measure one absence of ``minutes``, while the press, and so its encoder, stands still."""
    usual = {row[0] % rig.prints: row[1] for row in from_file(rig, rig.prints)}
    turning = Turning()
    with plugged_in(rig.played) as (peer,):
        process, messages = watched(rig)
        sheets: list[dict[str, Any]] = []
        progress("a run before its camera is unplugged")
        until(messages, sheets, sheets_more=SHEETS_BEFORE)
        peer.unplug()
        begun_s, line = time.monotonic(), turning.line()
        noticed_s, _ = until(messages, sheets, notice="camera-away")
        samples = []
        for number in range(SAMPLES):
            progress(f"unplugged: {minutes * (1 - number / SAMPLES):.0f} minutes left")
            time.sleep(60 * minutes / SAMPLES)
            samples.append(megabytes(process.pid))
        peer.plug_in()
        peer.send("at", line)
        peer.send("encoder", line)
        returned_s = time.monotonic()
        back_s, _ = until(messages, sheets, notice="camera-back")
        before = len(sheets)
        until(messages, sheets, sheets_more=SHEETS_AFTER)
        process.send_signal(signal.SIGINT)
        process.communicate()
    after = sheets[before:]
    memory_mb = [one for one in samples if one is not None]
    at = np.arange(len(memory_mb)) * minutes / SAMPLES / 60
    return {
        "minutes": minutes,
        "noticed_after_s": noticed_s - begun_s,
        "back_after_s": back_s - returned_s,
        "first_mb": memory_mb[0] if memory_mb else None,
        "last_mb": memory_mb[-1] if memory_mb else None,
        "most_mb": max(memory_mb, default=None),
        "mb_an_hour": float(np.polyfit(at, memory_mb, 1)[0]) if len(memory_mb) > 1 else None,
        "sheets": len(after),
        "not_inspected": sum(row["verdict"] == "not-inspected" for row in after),
        "as_usual": sum(
            row["job_page"] is not None and row["verdict"] == usual[row["job_page"] % rig.prints]
            for row in after
        ),
    }
