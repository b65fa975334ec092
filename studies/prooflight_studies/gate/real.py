"""The real ``watch`` with a real detector beside the simulated controller: misprints, `kill -9`, how long it takes."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from prooflight.press.press_file import PressFile
from prooflight.simulation.corpus.sample_job.sample_job import make_sample_job
from prooflight_line.plant.gate.log import log_path, rows_of
from prooflight_line.plant.simulator.plc import Belt, SimulatedPlc
from prooflight_line.plant.simulator.server import PlcServer

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight_line.plant.simulator.plc import TrayRow

COARSER: Final = 8
"""Fewer and wider pixels than the prototype's 2048, so that two cores keep up with their detector."""
DISTANCE_MM: Final = 3000.0
MISPRINT, EVERY = "missing-content:0.9", 8
"""What so coarse a camera can see."""
DESIGNS: Final = 24
"""Number of designs that the press is trained with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """Files of a press and a job."""

    folder: Path

    @property
    def press(self) -> Path:
        """The artefact."""
        return self.folder / "gate.press"

    @property
    def job(self) -> Path:
        """A PDF of A4 pages."""
        return self.folder / "job.pdf"

    def prepared(self, progress: Callable[[str], None]) -> Rig:
        """Return the rig with its files, made if they are not there."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if not self.job.exists():
            progress("composing the sample job")
            make_sample_job(self.job)
        if not self.press.exists():
            progress("building the press and training its detector")
            file = self.folder / "gate.toml"
            file.write_text(press_text(host="127.0.0.1", port=502), encoding="utf-8")
            command = [sys.executable, "-m", "prooflight", "press", "build", str(file), "-o", str(self.press)]
            subprocess.run(
                [*command, "--designs", str(DESIGNS), "--json"], check=True, stdout=subprocess.DEVNULL
            )
        return self


@dataclass(slots=True, kw_only=True)
class Watched:
    """What runs of ``watch`` left."""

    rows: list[TrayRow]
    written_ms: list[float] = field(default_factory=list)
    """Time from the last line to the register."""
    verdict_ms: list[float] = field(default_factory=list)
    """Time from the last line to the verdict."""
    runs: int = 0
    detector: str = ""
    pixels: int = 0
    seconds: float = 0.0


def press_text(*, host: str, port: int) -> str:
    """Return the prototype's press file with fewer and wider pixels, and a gate."""
    text = PressFile.prototype().text
    for name, kind, factor in (
        ("pixels", int, 1 / COARSER),
        ("pixel_pitch_um", float, COARSER),
        ("luminance_cd_m2", float, 1 / COARSER**2),
    ):
        line = re.search(rf"^{name} = ([\d.]+)", text, re.MULTILINE)
        if line is None:
            raise ValueError(f"the prototype's press file has no {name}")
        value = kind(float(line[1]) * factor)
        text = re.sub(rf"^{name} = [\d.]+", f"{name} = {value}", text, flags=re.MULTILINE)
    text += "\n[transport]\nlead_in_mm = 20.0\nlead_out_mm = 20.0\n"
    return f'{text}\n[gate]\ndistance_mm = {DISTANCE_MM}\n[gate.plc]\nhost = "{host}"\nport = {port}\n'


def run_watch(
    rig: Rig,
    folder: Path,
    *,
    rate: float,
    sheets: int,
    kill_after: int | None,
    log: Path,
    progress: Callable[[str], None],
) -> Watched:
    """Watch so many sheets of the drum. kill_after: at the gate, `kill -9`, and the rest of them by another start."""
    with log.open("w", encoding="utf-8", buffering=1) as file:
        plc = SimulatedPlc(belt=Belt(distance_mm=DISTANCE_MM, counts_per_mm=10.0), log=file)
        with PlcServer(plc) as server:
            plant = folder / "plant.toml"
            plant.write_text(press_text(host="127.0.0.1", port=server.port), encoding="utf-8")
            watched, begun_s = Watched(rows=plc.rows), time.perf_counter()
            left = sheets
            for kill in (True, False) if kill_after is not None else (False,):
                process = _started(rig, folder, plant, rate=rate, sheets=left)
                stop_at = len(plc.rows) + kill_after if kill and kill_after is not None else None
                reported = 0
                while process.poll() is None:
                    if len(plc.rows) >= reported + 100:
                        reported = len(plc.rows)
                        progress(f"{reported} sheets at the gate")
                    if stop_at is not None and len(plc.rows) >= stop_at:
                        process.kill()
                    time.sleep(0.02)
                process.wait()
                if not kill and process.returncode not in (0, 1, 3):
                    raise RuntimeError(f"watch ended with {process.returncode}")
                left = max(sheets - len(plc.rows), 1)
                watched.runs += 1
            watched.seconds = time.perf_counter() - begun_s
    _times(folder, watched)
    return watched


# --- parts ---


def _started(rig: Rig, folder: Path, plant: Path, *, rate: float, sheets: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "prooflight", "watch", str(rig.job), "--press", str(rig.press)]
    command += ["--source", f"drum:{rate}", "--sheets", str(sheets), "--misprint", MISPRINT]
    command += [
        "--every",
        str(EVERY),
        "--plant",
        str(plant),
        "--journal",
        str(folder / "runs.sqlite"),
        "--json",
    ]
    with (folder / "told.jsonl").open("ab") as told, (folder / "said.txt").open("ab") as reported:
        return subprocess.Popen(command, stdout=told, stderr=reported)


def _times(folder: Path, watched: Watched) -> None:
    for line in (folder / "told.jsonl").read_text(encoding="utf-8").splitlines():
        with suppress(ValueError):  # the last one of a process that was killed
            row = json.loads(line)
            if row.get("latency_ms") is not None:
                watched.verdict_ms.append(row["latency_ms"])
                watched.detector = row["detector"]
    for run_id in range(1, watched.runs + 1):
        for row in rows_of(log_path(folder / "runs.sqlite", run_id)):
            if row["kind"] == "written":
                watched.written_ms.append(row["ms"])
    watched.pixels = 2048 // COARSER
