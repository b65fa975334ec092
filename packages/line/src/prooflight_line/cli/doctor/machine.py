"""What a machine has and lacks for Prooflight: libraries, cameras, memory, disk, cores, clock and speed."""

from __future__ import annotations

import ctypes
import math
import os
import platform
import re
import shutil
import sys
import time
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, requires, version
from statistics import median
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from prooflight.cli.commands import REMEDIES
from prooflight.files.lock import writer_lives
from prooflight.inspection.inspector import Inspector
from prooflight.pages.memory import available_bytes
from prooflight.pages.process import settle_process
from prooflight.pages.raster import MM_PER_INCH
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.scans import ideal_scan
from prooflight_line.cameras.backends import BACKENDS
from prooflight_line.run.sheet_inspector import SheetInspector

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

State = Literal["good", "optional", "look", "lacking"]
OWN: Final = "prooflight"
LEAST_MEMORY_GB: Final = 2.0
"""Assumed: the program takes half of it, and the designs of a few sheets at 0.2 GB each the rest."""
GOOD_MEMORY_GB: Final = 8.0
"""Assumed: some twenty designs are ready ahead of their sheets."""
LEAST_DISK_GB: Final = 1.0
"""Below it a day's rows do not fit: 5 sheets a second, 2 kB each."""
GB_A_DAY: Final = 5 * 86_400 * 2e3 / 1e9
"""Rows of the journal at 5 sheets a second, without evidence (how-to *Read and maintain the journal*)."""
GOOD_CORES: Final = 4
"""Assumed: two for inspection, one for preparing designs, one for everything else."""
UNSYNCHRONISED: Final = 5
"""TIME_ERROR of adjtimex(2): nothing has set the clock by others' clocks."""
_TIMEX_BYTES: Final = 512
"""More than struct timex takes on any Linux."""
_NEEDS = re.compile(r"""([\w.-]+)(?:\[[^\]]*\])?[^;]*(?:;.*extra\s*==\s*['"]([\w.-]+)['"])?""")


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that was looked at."""

    what: str
    state: State
    """lacking: it is needed, and missing. look: it works, and something should be done. optional: not installed, and
    not needed by all."""
    detail: str
    remedy: str = ""


def findings(journal: Path) -> Iterator[Finding]:
    """Yield everything that is looked at, for a journal at this path."""
    system = f"{platform.system()} {platform.release()}, Python {platform.python_version()}"
    yield Finding(what="system", state="good", detail=system)
    for package in (OWN, *REMEDIES):
        yield from _of_package(package)
    yield from _of_cameras()
    yield _of_cores()
    yield _of_memory()
    yield _of_disk(journal)
    yield _of_journal(journal)
    yield _of_clock()


def needs(package: str, *, listed: Callable[[str], list[str] | None] = requires) -> dict[str, list[str]]:
    """Return the libraries of a package by extra; "" has those that it always needs.

    >>> needs("x", listed=lambda _: ["numpy>=2", "lxml>=5; extra == 'plant'"])
    {'': ['numpy'], 'plant': ['lxml']}
    """
    of: dict[str, list[str]] = {"": []}
    for line in listed(package) or ():
        named = _NEEDS.match(line)
        if named is not None:
            of.setdefault(named[2] or "", []).append(named[1])
    return of


def _of_package(package: str) -> Iterator[Finding]:
    try:
        detail = version(package)
    except PackageNotFoundError:
        yield Finding(
            what=package, state="optional", detail="not installed", remedy=REMEDIES.get(package, "")
        )
        return
    for extra, libraries in needs(package).items():
        missing = [library for library in libraries if not _installed(library)]
        what = f"{package}[{extra}]" if extra else package
        if not missing:
            yield Finding(what=what, state="good", detail=detail if not extra else ", ".join(libraries))
            continue
        remedy = f'pip install "{what}"'
        yield Finding(
            what=what,
            state="optional" if extra else "lacking",
            detail=f"without {', '.join(missing)}",
            remedy=remedy,
        )


def _installed(library: str) -> bool:
    try:
        version(library)
    except PackageNotFoundError:
        return False
    return True


def _of_cameras() -> Iterator[Finding]:
    """Yield a finding for each camera library; none of them is needed to replay scans or to read from a socket."""
    for backend in BACKENDS:
        why, _, remedy = backend.lacks.partition("; ")
        what = f"cameras by {backend.name}"
        yield Finding(
            what=what, state="optional" if why else "good", detail=why or "can be used", remedy=remedy
        )


def _of_cores() -> Finding:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    few = cores < GOOD_CORES
    remedy = f"{GOOD_CORES} or more, if inspection is too slow" if few else ""
    return Finding(what="cores", state="look" if few else "good", detail=str(cores), remedy=remedy)


def _of_memory() -> Finding:
    free_gb = available_bytes() / 1e9
    if not math.isfinite(free_gb):
        return Finding(what="memory", state="look", detail="this system does not report it")
    detail = f"{free_gb:.1f} GB are free"
    if free_gb < LEAST_MEMORY_GB:
        return Finding(
            what="memory", state="lacking", detail=detail, remedy=f"{LEAST_MEMORY_GB:g} GB at least"
        )
    if free_gb < GOOD_MEMORY_GB:
        return Finding(
            what="memory",
            state="look",
            detail=detail,
            remedy=f"{GOOD_MEMORY_GB:g} GB have room for more designs",
        )
    return Finding(what="memory", state="good", detail=detail)


def _of_disk(journal: Path) -> Finding:
    """Return the finding of the journal's disk, and whether this user may write there."""
    folder = next((one for one in journal.absolute().parents if one.is_dir()), journal.absolute().parent)
    try:
        free_gb = shutil.disk_usage(folder).free / 1e9
    except OSError as error:
        return Finding(
            what="disk", state="lacking", detail=f"{folder}: {error.strerror}", remedy="give --journal"
        )
    detail = f"{free_gb:,.1f} GB are free in {folder}, {free_gb / GB_A_DAY:,.0f} days of rows at 5 sheets/s"
    if not os.access(folder, os.W_OK):
        return Finding(
            what="disk", state="lacking", detail=f"{folder} cannot be written", remedy="give --journal"
        )
    if free_gb < LEAST_DISK_GB:
        return Finding(
            what="disk", state="lacking", detail=detail, remedy="`prooflight run tidy`, or another disk"
        )
    return Finding(what="disk", state="good", detail=detail)


def _of_journal(journal: Path) -> Finding:
    if not journal.exists():
        return Finding(what="journal", state="good", detail=f"{journal} will be created by the first run")
    detail = "a run is being written" if writer_lives(journal) else f"{journal.stat().st_size / 1e6:,.1f} MB"
    return Finding(what="journal", state="good", detail=detail)


def _of_clock() -> Finding:
    """Return whether the system's clock is set by others' clocks; journals and the plant state times."""
    if sys.platform != "linux":
        return Finding(
            what="clock", state="look", detail="this system does not say whether it is synchronised"
        )
    timex = ctypes.create_string_buffer(_TIMEX_BYTES)  # its field modes is 0: nothing is set
    try:
        state = int(ctypes.CDLL(None, use_errno=True).adjtimex(timex))
    except (OSError, AttributeError):
        state = -1
    if state < 0:
        return Finding(
            what="clock", state="look", detail="this system does not say whether it is synchronised"
        )
    if state == UNSYNCHRONISED:
        remedy = "start systemd-timesyncd, chrony or another NTP client"
        return Finding(what="clock", state="look", detail="is not synchronised", remedy=remedy)
    return Finding(what="clock", state="good", detail="is synchronised")


# --- speed: how fast a press's sheets are inspected here ---

SEED: Final = 1
SHEETS: Final = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Speed:
    """Times of one thread, in seconds of a processor: what else this machine does now does not count."""

    detector: str
    page_mm: tuple[float, float]
    prepare_s: float
    inspect_s: float
    """Median of ``SHEETS`` sheets."""

    def sheets_per_s(self, cores: int) -> float:
        """Return the greatest rate if all these cores inspected and nothing else."""
        return cores / self.inspect_s


def measure_speed(press: Press, *, steps: Iterable[int] = range(SHEETS)) -> Speed:
    """Prepare a page for a press and inspect good prints of it; steps: one is taken a sheet, to show progress."""
    settle_process()
    sheets = SheetInspector(inspector=Inspector(press).with_threads(1))
    page = press.geometry.lay(_page(press))
    ready = sheets.prepare(page)
    sheets.rehearse(ready, sheets.rehearsal_scans(ready))  # compiles kernels, and fills caches
    began_s = time.process_time()
    ready = sheets.prepare(page)
    prepare_s = time.process_time() - began_s
    expected = sheets.inspector.planned(page, threads=1).expected
    rng, times = stream(None, "bench-scan"), []
    for number in steps:
        scan = ideal_scan(expected, press, rng)
        began_s = time.process_time()
        sheets.inspect(ready, scan, name="print", seed=number)
        times.append(time.process_time() - began_s)
    return Speed(
        detector=sheets.inspector.detector.name,
        page_mm=(page.width_mm, page.height_mm),
        prepare_s=prepare_s,
        inspect_s=median(times),
    )


def _page(press: Press) -> Page:
    """Return a composed page, cut to the width that the press sees."""
    page = Corpus(seed=SEED, dpi=press.dpi).page(0)
    columns = int(press.geometry.field_mm / MM_PER_INCH * page.dpi)
    return replace(page, cmyk=np.ascontiguousarray(page.cmyk[:, :columns]))
