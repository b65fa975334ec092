"""Cameras that fail, hang, are unplugged for long, are taken by another program, and return, while a job is watched.

The time until each is reported is measured, and the memory of a run whose camera is away.
"""

from __future__ import annotations

import queue
import signal
import threading
import time
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.scans.camera_settings import CameraSettings
from prooflight_line.cameras.backends import camera_named, ready
from prooflight_line.cameras.source import CameraLines
from prooflight_line.testing.peer import ID, alone, plugged_in
from prooflight_studies.cameras.job import from_file
from prooflight_studies.cameras.rig import next_message, verdict
from prooflight_studies.console.serving import megabytes

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable

    from prooflight_line.testing.peer import Peer
    from prooflight_studies.cameras.rig import Rig

KINDS: Final = ("unplugged", "frozen", "hung")
"""Kinds of failure: the camera is missing; it does not answer; it answers, but sends nothing."""
LINE_HZ: Final = 1000.0
AWAY_S: Final = 1.0
"""Time from the notice to the camera's return."""
BETWEEN_SHEETS: Final = 3
LONGEST_S: Final = 60.0
TAKEN_S: Final = 1.5
"""Time for which another program holds the camera."""


@dataclass(slots=True)
class Turning:
    """Encoder of a running press, which reports its position to the camera."""

    begun_s: float = field(default_factory=time.monotonic)
    peer: Peer | None = None
    guard: threading.Lock = field(default_factory=threading.Lock)
    ended: threading.Event = field(default_factory=threading.Event)

    def line(self) -> int:
        """Return the line that passes now."""
        return round((time.monotonic() - self.begun_s) * LINE_HZ)

    def run(self) -> None:
        """Report the position until ``ended`` is set."""
        while not self.ended.wait(0.1):
            with self.guard:
                if self.peer is not None:
                    self.peer.send("encoder", self.line())


def death_figures(rig: Rig, *, deaths: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the figures of each failure, and of the sheets of all."""
    usual = {row[0] % rig.prints: row[1] for row in from_file(rig, rig.prints)}
    rows: list[dict[str, Any]] = []
    turning = Turning()
    with plugged_in(rig.played) as (peer,):
        process, messages = watched(rig)
        encoder = threading.Thread(target=turning.run, daemon=True)
        sheets: list[dict[str, Any]] = []
        until(messages, sheets, sheets_more=BETWEEN_SHEETS)
        turning.begun_s, turning.peer = time.monotonic(), peer
        encoder.start()
        for number in range(deaths):
            kind = KINDS[number % len(KINDS)]
            progress(f"death {number + 1} of {deaths}: {kind}")
            rows.append(_death(kind, peer, turning, messages, sheets))
            until(messages, sheets, sheets_more=BETWEEN_SHEETS)
        turning.ended.set()
        encoder.join()
        process.send_signal(signal.SIGINT)
        process.communicate()
    judged = [verdict(row) for row in sheets]
    wrong = [
        {name: row[name] for name in ("sheet", "job_page", "kind", "score", "faults", "reason")}
        for row in sheets
        if row["verdict"] == "misprint"
        and (row["job_page"] is None or usual[row["job_page"] % rig.prints] == "good")
    ]
    return {
        "deaths": rows,
        "sheets": len(judged),
        "not_inspected": sum(row[1] == "not-inspected" for row in judged),
        "wrongly_judged": len(wrong),
        "wrong": wrong,
        "good": sum(row[1] == "good" for row in judged),
        "line_hz": LINE_HZ,
        "sheets_per_s": LINE_HZ / rig.trigger,
    }


def _death(
    kind: str,
    peer: Peer,
    turning: Turning,
    messages: queue.Queue[tuple[float, dict[str, Any]]],
    sheets: list[dict[str, Any]],
) -> dict[str, Any]:
    before = len(sheets)
    with turning.guard:
        begun_s = time.monotonic()
        if kind == "unplugged":
            turning.peer = None
            peer.unplug()
        elif kind == "frozen":
            turning.peer = None
            peer.freeze()
        else:
            peer.send("lost", 1.0)
    noticed_s, text = until(messages, sheets, notice="camera-away")
    time.sleep(AWAY_S)
    with turning.guard:
        if kind == "unplugged":
            peer.plug_in()
        elif kind == "frozen":
            peer.thaw()
        else:
            peer.send("lost", 0.0)
        peer.send("at", turning.line())
        peer.send("encoder", turning.line())
        turning.peer = peer
    returned_s = time.monotonic()
    back_s, _ = until(messages, sheets, notice="camera-back")
    until(messages, sheets, sheets_more=1)
    own = sheets[before:]
    return {
        "kind": kind,
        "noticed_after_s": noticed_s - begun_s,
        "back_after_s": back_s - returned_s,
        "said": text,
        "away_s": back_s - begun_s,
        "sheets_lost": sum(row["verdict"] == "not-inspected" for row in own),
    }


def watched(rig: Rig) -> tuple[subprocess.Popen[str], queue.Queue[tuple[float, dict[str, Any]]]]:
    """Start a run whose camera waits for its encoder; return it with a queue of its messages and their times."""
    process = rig.watch(
        *("--source", f"camera:{ID}", "--sheets", 100_000),
        *("--camera", rig.settings(rate_hz=LINE_HZ, trigger="encoder")),
    )
    messages: queue.Queue[tuple[float, dict[str, Any]]] = queue.Queue()
    threading.Thread(target=_read, args=(process, messages), daemon=True).start()
    return process, messages


def _read(process: subprocess.Popen[str], messages: queue.Queue[tuple[float, dict[str, Any]]]) -> None:
    while (row := next_message(process)) is not None:
        messages.put((time.monotonic(), row))


def until(
    messages: queue.Queue[tuple[float, dict[str, Any]]],
    sheets: list[dict[str, Any]],
    *,
    notice: str = "",
    sheets_more: int = 0,
) -> tuple[float, str]:
    """Wait for a notice, or for so many more sheets, and return its time; all sheets until then are added."""
    wanted = len(sheets) + sheets_more
    while True:
        at_s, row = messages.get(timeout=LONGEST_S)
        if "verdict" in row:
            sheets.append(row)
            if not notice and len(sheets) >= wanted:
                return at_s, ""
        elif notice and row.get("notice") == notice:
            return at_s, row["text"]


def taken_figures(*, times: int, progress: Callable[[str], None]) -> list[dict[str, Any]]:
    """Let another program take control of viva's simulated camera, hold it for a while and release it."""
    import viva_genicam
    from viva_genicam.testing import FakeGigeCamera

    rows = []
    settings = CameraSettings()
    for number in range(times):
        progress(f"taken by another program, {number + 1} of {times}")
        with alone(), FakeGigeCamera(width=512, height=64, fps=20) as camera:
            messages: queue.Queue[tuple[float, str, str]] = queue.Queue()
            source = CameraLines(
                lambda: ready(camera_named("viva:127.0.0.1"), settings, where="the study"),
                name="camera",
                settings=settings,
                tell=partial(_noted, messages),
            )
            came = threading.Event()
            thread = threading.Thread(target=_heard, args=(source, came), daemon=True)
            thread.start()
            came.wait(LONGEST_S)
            begun_s = time.monotonic()
            camera.revoke_control()
            other = viva_genicam.connect_gige(camera.device_info())
            noticed_s, _, text = messages.get(timeout=LONGEST_S)
            time.sleep(TAKEN_S)
            other.close()
            let_go_s = time.monotonic()
            back_s, _, _ = messages.get(timeout=LONGEST_S)
            source.close()
            thread.join()
        rows.append({"noticed_after_s": noticed_s - begun_s, "back_after_s": back_s - let_go_s, "said": text})
    return rows


def _noted(messages: queue.Queue[tuple[float, str, str]], kind: str, text: str) -> None:
    messages.put((time.monotonic(), kind, text))


def _heard(source: CameraLines, came: threading.Event) -> None:
    for _ in source.blocks():
        came.set()


# --- a camera that is unplugged for long ---

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
