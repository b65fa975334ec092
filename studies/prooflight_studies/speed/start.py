"""Time from the start of the process to the first verdict of a warm installation."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

STARTS: Final = 3
FIRST_VERDICT: Final = """
import sys
import numpy as np
from pathlib import Path
from prooflight.inspection.inspector import Inspector
from prooflight.pages.raster import Page
from prooflight.press.artefact import Press

folder = Path(sys.argv[1])
press = Press.load(folder / "bench.press")
inspector = Inspector.of(press, "chi-square")
page = Page(cmyk=np.load(folder / "page.npy"), dpi=press.dpi, name="p0001", number=1)
done = inspector.inspect(inspector.prepare(page), np.load(folder / "scan.npy"), scan_name="bench")
print(done.verdict.verdict)
"""


def start_seconds(press: Press, page: Page) -> list[float]:
    """Return wall-clock times from starting Python to the first verdict on ``page``. [s]

    They are of starts after one that warms the caches. The press is loaded from its file, the page and its scan from
    arrays. RuntimeError: no verdict came.
    """
    seconds = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        press.save(folder / "bench.press")
        expected = predict(page, sensors=press.sensors, geometry=press.geometry)
        np.save(folder / "page.npy", page.cmyk)
        np.save(folder / "scan.npy", ideal_scan(expected, press, stream(None, "bench-scan")))
        for start in range(STARTS + 1):
            begun = time.perf_counter()
            command = [sys.executable, "-c", FIRST_VERDICT, name]
            completed = subprocess.run(command, capture_output=True, text=True, check=False)
            if completed.stdout.strip() not in ("good", "misprint"):
                raise RuntimeError(completed.stderr)
            if start:
                seconds.append(time.perf_counter() - begun)
    return seconds
