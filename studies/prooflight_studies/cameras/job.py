"""A job watched over the wire by each library, and the same lines from a file: lines to the byte, and verdicts."""

from __future__ import annotations

import os
import signal
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np

from prooflight.scans.camera_settings import CameraSettings
from prooflight_line.cameras.backends import BACKENDS, camera_named, ready
from prooflight_line.cameras.source import CameraLines
from prooflight_line.cli.watch.sources import camera_lines
from prooflight_line.testing.peer import plugged_in
from prooflight_studies.cameras.rig import PIXELS, next_message, verdict

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable

    from prooflight_line.cameras.several import SeveralCameras
    from prooflight_studies.cameras.rig import Rig

WATCHED_HZ: Final = 1000.0
"""Line rate while sheets are judged: two sheets a second, which any machine keeps up with."""
RECORDED_HZ: Final = 8000.0
EMULATED_LINES: Final = 64
EMULATED_HZ: Final = 50.0
"""Blocks a second of pylon's emulator."""
OVER_THE_WIRE: Final = {"aravis": "aravis:PL01", "viva": "viva:127.0.0.1"}
"""Libraries that read Aravis' simulated camera, and the name by which they find it."""


def job_rows(rig: Rig, *, sheets: int, progress: Callable[[str], None]) -> list[dict[str, Any]]:
    """Return a row for each library."""
    os.environ["PYLON_CAMEMU"] = "1"  # pylon looks at it once, when it is first asked for cameras
    lacks = {one.name: one.lacks for one in BACKENDS}
    progress("the job from a file")
    wanted = from_file(rig, sheets)
    rows = []
    for name, camera in OVER_THE_WIRE.items():
        if lacks[name] or lacks["aravis"]:
            rows.append({"backend": name, "lacks": lacks[name] or lacks["aravis"]})
            continue
        progress(f"the job through {name}")
        rows.append({"backend": name, "lacks": "", **_row(rig, camera, sheets, wanted)})
    if lacks["pylon"]:
        rows.append({"backend": "pylon", "lacks": lacks["pylon"]})
    else:
        progress("lines through pylon's emulator")
        rows.append({"backend": "pylon", "lacks": "", **_emulated(rig, sheets)})
    return rows


def from_file(rig: Rig, sheets: int, *watch: object) -> list[tuple[Any, ...]]:
    """Return the verdicts on so many sheets, the prints repeated."""
    return [verdict(row) for row in rows_from_file(rig, sheets, *watch)]


def rows_from_file(rig: Rig, sheets: int, *watch: object) -> list[dict[str, Any]]:
    """Return all messages on these sheets."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "lines.raw")
        with path.open("wb") as file:
            for sheet in range(sheets):
                first = sheet % rig.prints * rig.trigger
                file.write(rig.lines[first : first + rig.trigger].astype("<u2").tobytes())
        process = rig.watch("--source", f"raw:{path}", "--sheets", sheets, *watch)
        return _rows(process, sheets)


def _row(rig: Rig, camera: str, sheets: int, wanted: list[tuple[Any, ...]]) -> dict[str, Any]:
    with plugged_in(rig.played):
        source = camera_lines(camera, rig.settings(rate_hz=RECORDED_HZ))
        exact = _exact(source, rig.lines, sheets * rig.trigger)
    with plugged_in(rig.played):
        settings = rig.settings(rate_hz=WATCHED_HZ)
        process = rig.watch("--source", f"camera:{camera}", "--camera", settings, "--sheets", sheets)
        came = [verdict(row) for row in _rows(process, sheets)]
        process.send_signal(signal.SIGINT)
        process.communicate()
    pairs = list(zip(came, wanted, strict=False))
    return exact | {
        "sheets": len(came),
        "same_verdicts": sum(a[:2] == b[:2] and a[3] == b[3] for a, b in pairs),
        "same_scores": sum(a == b for a, b in pairs),
        "good": sum(row[1] == "good" for row in came),
        "misprints": sum(row[1] == "misprint" for row in came),
        "lines_hz": RECORDED_HZ,
        "watched_hz": WATCHED_HZ,
    }


def _exact(source: CameraLines | SeveralCameras, played: np.ndarray, count: int) -> dict[str, Any]:
    """Return the numbers of lines that came, of those that differ from the played ones, and of reported faults."""
    lines = other = faults = 0
    first = None
    for block in source.blocks():
        if first is None:  # pylon's emulator begins with any of its files
            matches = np.flatnonzero((played == block.lines[0, 0]).all(axis=1))
            first = int(matches[0]) - block.first_line if matches.size else 0
        at = (np.arange(block.first_line, block.next_line) + first) % len(played)
        other += int((block.lines[0] != played[at]).any(axis=1).sum())
        lines += block.lines.shape[1]
        faults += len(block.faults)
        if block.next_line >= count:
            source.close()
    return {"lines": lines, "other_lines": other, "faults": faults}


def _emulated(rig: Rig, sheets: int) -> dict[str, Any]:
    """Play lines through pylon's emulator: a file a block, 8 bits a pixel, the upper bits of each number."""
    lines = (rig.lines >> 4).astype(np.uint8)
    lines = lines[: len(lines) // EMULATED_LINES * EMULATED_LINES]
    with tempfile.TemporaryDirectory() as folder:
        for at in range(0, len(lines), EMULATED_LINES):
            cv2.imwrite(str(Path(folder, f"{at:06}.png")), lines[at : at + EMULATED_LINES])
        settings = CameraSettings(
            pixel_format="Mono8",
            block_lines=EMULATED_LINES,
            features={
                "Width": PIXELS,
                "ImageFilename": folder,
                "ImageFileMode": "On",
                "TestImageSelector": "Off",
                "AcquisitionFrameRateEnable": True,
                "AcquisitionFrameRateAbs": EMULATED_HZ,
            },
        )
        camera = camera_named("pylon:0815-0000")
        source = CameraLines(
            lambda: ready(camera, settings, where="the study"), name=camera.id, settings=settings
        )
        count = min(sheets * rig.trigger, 40_000)
        exact = _exact(source, lines.astype(np.uint16), count)
    return exact | {
        "sheets": 0,
        "same_verdicts": 0,
        "same_scores": 0,
        "good": 0,
        "misprints": 0,
        "lines_hz": EMULATED_HZ * EMULATED_LINES,
        "watched_hz": None,
    }


def _rows(process: subprocess.Popen[str], sheets: int) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    while len(rows) < sheets and (row := next_message(process)) is not None:
        if "verdict" in row:
            rows.append(row)
    return rows
