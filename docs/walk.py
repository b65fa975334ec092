"""Trace how a page and its scan pass through the code: rooms, returns, climbs, files, names.

    python docs/walk.py X.press JOB SCANS

The first page of the job is prepared, and its scan is inspected by the press's default detector, while every call
within Prooflight is noted. A room is a folder of the package. A room is entered when one of its functions is called
for the first time from another room. It is a return if the room had been left before (none of its functions was
running), and a climb if one still was: a lower room calls a higher one. Names are those by which functions refer to
the scan's (the page's) own numbers or a part of them. Compiled loops are not traced.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np

from prooflight.inspection.inspector import Inspector
from prooflight.pages.job import open_job
from prooflight.press.artefact import Press
from prooflight.scans.recorded import recorded_scans


@dataclass(kw_only=True)
class Trace:
    """Calls of one operation; its instance is a profiler for ``sys.setprofile``."""

    numbers: np.ndarray
    """Array whose names are counted."""
    modules: set[str] = field(default_factory=set)
    names: set[str] = field(default_factory=set)
    rooms: list[str] = field(default_factory=list)
    """Rooms in the order in which they are entered, returns included."""
    climbs: list[str] = field(default_factory=list)
    _functions: set[CodeType] = field(default_factory=set)
    _stack: list[str] = field(default_factory=list)

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Note the room when a function is first called, and the names when a call ends."""
        module = frame.f_globals.get("__name__", "")
        if not module.startswith("prooflight."):
            return
        room = module.split(".")[1]
        if event == "call":
            self.modules.add(module)
            if frame.f_code not in self._functions and room != (self._stack or [""])[-1]:
                (self.climbs if room in self._stack else self.rooms).append(room)
            self._functions.add(frame.f_code)
            self._stack.append(room)
        elif event == "return" and self._stack:
            self._stack.pop()
            self.names |= {name for name, value in frame.f_locals.items() if self._shares(value)}

    def _shares(self, value: Any) -> bool:
        return isinstance(value, np.ndarray) and value.size > 1 and np.may_share_memory(value, self.numbers)

    def summary(self) -> str:
        """Return the counts in one line."""
        rooms = len(set(self.rooms))
        returns, climbs = len(self.rooms) - rooms, len(self.climbs)
        return (
            f"{rooms} rooms, {returns} returns, {climbs} climbs, {len(self.names)} names; "
            f"{len(self.modules)} files, {len(self._functions)} functions"
        )


def trace(artefact: Path, job_file: Path, scans: Path) -> dict[str, Trace]:
    """Return the traces of preparing the job's first page and of inspecting its scan."""
    press = Press.load(artefact)
    inspector = Inspector.of(press)
    scan = recorded_scans(scans, sensors=len(press.sensors))[0]
    with open_job(job_file, dpi=press.dpi) as job:
        page = press.geometry.lay(job.page(1))
    dn = scan.read(pixels=press.geometry.pixels, lines_max=press.geometry.lines(page.height_mm))
    # What is loaded and compiled once does not belong to the path of a scan.
    inspector.inspect(inspector.prepare(page), dn, scan_name="scan")
    traces = {"page": Trace(numbers=page.cmyk), "scan": Trace(numbers=dn)}
    sys.setprofile(traces["page"])
    prepared = inspector.prepare(page)
    sys.setprofile(traces["scan"])
    inspector.inspect(prepared, dn, scan_name="scan")
    sys.setprofile(None)
    return traces


if __name__ == "__main__":
    for name, result in trace(*map(Path, sys.argv[1:4])).items():
        print(f"{name}: {result.summary()}")
        print("  " + " > ".join(result.rooms))
