"""Set-up of the study of cameras: a small press, a job of small pages, and the lines of their prints."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.train import trained
from prooflight.pages.files import write_tiff
from prooflight.press.artefact import Press
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.prints import Print
from prooflight_studies.running.rig import DESIGN_SEED, Pieces, day

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

PIXELS: Final = 400
"""Pixels of the press's line, for sheets of 36 x 44 mm: the prototype's camera, a fifth as wide."""
SETTINGS: Final = """
[camera]
pixel_format = "Mono16"
block_lines = {block_lines}
line_rate_hz = {rate_hz:.1f}
trigger = "{trigger}"
encoder_steps = 1
features = {{ Width = 400 }}
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """Files that a run needs, and the lines that its camera plays."""

    folder: Path
    press: Path
    job: Path
    lines: NDArray[np.uint16]
    """Lines of the prints, one after another. (n, pixels) [DN]"""
    prints: int
    trigger: int
    """Lines from sheet to sheet."""

    @property
    def played(self) -> NDArray[np.uint8]:
        """The lines as bytes of Mono16, (n, bytes)."""
        return self.lines.astype("<u2").view(np.uint8)

    def settings(self, *, rate_hz: float, block_lines: int = 64, trigger: str = "free") -> Path:
        """Write a press file whose [camera] plays at that rate, and return its path."""
        path = self.folder / f"{trigger}-{rate_hz:.0f}-{block_lines}.toml"
        text = SETTINGS.format(block_lines=block_lines, rate_hz=rate_hz, trigger=trigger)
        path.write_text(PressFile.prototype().text + text)
        return path

    def watch(self, *arguments: object) -> subprocess.Popen[str]:
        """Start ``prooflight watch`` of the job, reporting in JSON."""
        usual = "--press", self.press, "--journal", "none", "--trigger", self.trigger, "--json"
        command = ["watch", self.job, *usual, "--deadline", 600_000, *arguments]
        return subprocess.Popen(
            [sys.executable, "-m", "prooflight", *map(str, command)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )


def rig(folder: Path, *, designs: int, prints: int, seed: int, progress: Callable[[str], None]) -> Rig:
    """Build a press trained on ``designs`` designs, and a job of pages, each printed once in the press world."""
    folder.mkdir(parents=True, exist_ok=True)
    press_at, job, scans = (
        folder / f"small-{designs}.press",
        folder / f"job-{prints}",
        folder / f"prints-{prints}-{seed}.npy",
    )
    if not press_at.exists():
        progress(f"training a small press on {designs} designs")
        plain = build_press(PressFile.prototype(), seed=1, pixels=PIXELS)
        pieces = Pieces(seed=DESIGN_SEED + 3, dpi=plain.dpi)
        trained(plain, pieces, designs=designs, seed=seed).save(press_at)
    press = Press.load(press_at)
    pages = [
        replace(
            press.geometry.lay(Pieces(seed=DESIGN_SEED + 5, dpi=press.dpi).page(index)),
            name=f"p{index + 1:04}",
        )
        for index in range(prints)
    ]
    if not job.exists():
        job.mkdir()
        for page in pages:
            write_tiff(page, job / f"{page.name}.tif")
    if not scans.exists():
        progress(f"printing {prints} pages")
        session = day(press, seed)
        scanned = []
        for index, page in enumerate(pages):
            rng = stream(seed, "running-print", index)
            scanned.append(fast_scan(page, press, session, Print.draw(session, press, page, rng), rng=rng)[0])
        np.save(scans, np.concatenate(scanned))
    lines = np.load(scans)
    return Rig(
        folder=folder, press=press_at, job=job, lines=lines, prints=prints, trigger=len(lines) // prints
    )


def next_message(process: subprocess.Popen[str]) -> Any:
    """Return the next message of a run after its preparation; None: it has ended."""
    assert process.stdout is not None
    while line := process.stdout.readline():
        row = json.loads(line)
        if "phase" not in row:
            return row
    return None


def verdict(row: dict[str, Any]) -> tuple[Any, ...]:
    """Return the parts of a sheet's row that are compared."""
    return row["job_page"], row["verdict"], row["score"], tuple(row["faults"])
