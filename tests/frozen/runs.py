"""The frozen cases on several processors: this one with parts of it switched off, with one thread and with two.

``python -m tests.frozen.runs FILE --threads N --shaken SEED`` measures the cases once, in the process's own
environment; ``measured`` starts it in those of ``RUNS``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
from numpy._core import _multiarray_umath as numpy_core
from tests.frozen.cases import CASES, PRESSES, figures_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

ROOT = Path(__file__).parents[2]
HAS_AVX512 = bool(numpy_core.__cpu_features__.get("AVX512F"))
NUMPY_AVX512 = [
    name
    for name in numpy_core.__cpu_dispatch__
    if (name == "X86_V4" or name.startswith("AVX512")) and numpy_core.__cpu_features__.get(name)
]
NUMBA = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""}
NUMPY = {"NPY_DISABLE_CPU_FEATURES": " ".join(NUMPY_AVX512)}
BLAS = {"OPENBLAS_CORETYPE": "Haswell"}
OPENCV = {"OPENCV_CPU_DISABLE": "AVX512-SKX", "OPENCV_IPP": "avx2"}
ENVIRONMENTS: dict[str, dict[str, str]] = {
    "free": {},
    "Numba for Haswell": NUMBA,
    "NumPy without AVX-512": NUMPY,
    "OpenBLAS for Haswell": BLAS,
    "OpenCV without AVX-512": OPENCV,
    "everything for Haswell": NUMBA | NUMPY | BLAS | OPENCV,
    "Numba and OpenBLAS for Skylake with AVX-512": {
        "NUMBA_CPU_NAME": "skylake-avx512",
        "NUMBA_CPU_FEATURES": "",
        "OPENBLAS_CORETYPE": "SkylakeX",
    },
}
"""Numba keeps what it compiles for each processor apart."""
SHAKES = 3


@dataclass(frozen=True, kw_only=True)
class Run:
    """One measurement of all cases."""

    environment: str
    threads: int
    shaken: int = 0
    """Seed by which the press's columns are moved; 0: they are not."""

    def __str__(self) -> str:
        threads = "one thread" if self.threads == 1 else f"{self.threads} threads"
        return f"{self.environment}, {threads}" + (f", shaken by {self.shaken}" if self.shaken else "")

    def figures(self) -> dict[str, Any]:
        """Of all cases, measured in a process of its own; CalledProcessError: it ended in an error."""
        threads = str(self.threads)
        limits = {"NUMBA_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "figures.json"
            subprocess.run(
                [sys.executable, "-m", "tests.frozen.runs", str(file), threads, str(self.shaken)],
                env=os.environ | limits | ENVIRONMENTS[self.environment],
                cwd=ROOT,
                check=True,
            )
            return json.loads(file.read_text(encoding="utf-8"))


FROZEN = Run(environment="free", threads=2)
"""Whose figures are the frozen ones."""


def runs() -> list[Run]:
    """All that this processor can do, ``FROZEN`` first."""
    environments = list(ENVIRONMENTS) if HAS_AVX512 else ["free"]
    others = [Run(environment=name, threads=threads) for name in environments for threads in (2, 1)]
    return others + [Run(environment="free", threads=2, shaken=seed) for seed in range(1, SHAKES + 1)]


def measured(every: Sequence[Run], *, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """Figures of runs, two of which are measured at a time; say: is given each run that has ended."""

    def one(run: Run) -> dict[str, Any]:
        found = run.figures()
        say(str(run))
        return found

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(one, every))


def main() -> None:
    """Measure all cases here and now."""
    parser = argparse.ArgumentParser(prog="python -m tests.frozen.runs", description=__doc__)
    parser.add_argument("file", type=Path, help="for the figures, as JSON")
    parser.add_argument("threads", type=int)
    parser.add_argument(
        "shaken", type=int, help="seed by which the press's columns are moved; 0: they are not"
    )
    given = parser.parse_args()
    os.cpu_count = lambda: given.threads  # pages are inspected by as many threads
    cv2.setNumThreads(given.threads)
    PRESSES.shaken = given.shaken
    found = {}
    for case in CASES:
        with tempfile.TemporaryDirectory() as folder:
            found[case.__name__] = figures_of(case, Path(folder))
    given.file.write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main()
