"""How far a scan and a page walk through the code: rooms, returns, climbs, files, names.

    python docs/walk.py X.press JOB SCANS

The first page of the job is prepared, and its scan inspected by the press's own detector, while every call within
Prooflight is noted. A room is a folder of the package. A room is entered when one of its functions is called for the
first time from another room; that is a return where the room had been left before (none of its functions was at work),
and a climb where one still was: a room below that calls one above. Names are those by which functions call the scan's
(the page's) own numbers, or a part of them. Compiled loops are not seen.
"""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np


@dataclass
class Walk:
    """What was seen of one call; a profiler."""

    of: np.ndarray
    modules: set[str] = field(default_factory=set)
    names: set[str] = field(default_factory=set)
    rooms: list[str] = field(default_factory=list)
    """As they are entered, with returns."""
    climbs: list[str] = field(default_factory=list)
    _functions: set[CodeType] = field(default_factory=set)
    _at_work: list[str] = field(default_factory=list)

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Notes rooms when functions are first called, and names as calls end."""
        module = frame.f_globals.get("__name__", "")
        if not module.startswith("prooflight."):
            return
        room = module.split(".")[1]
        if event == "call":
            self.modules.add(module)
            if frame.f_code not in self._functions and room != (self._at_work or [""])[-1]:
                entered = self.climbs if room in self._at_work else self.rooms
                entered.append(room)
            self._functions.add(frame.f_code)
            self._at_work.append(room)
        elif event == "return" and self._at_work:
            self._at_work.pop()
            self.names |= {name for name, value in frame.f_locals.items() if self._own(value)}

    def _own(self, value: Any) -> bool:
        return isinstance(value, np.ndarray) and value.size > 1 and np.may_share_memory(value, self.of)

    def said(self) -> str:
        """In one line."""
        rooms = len(set(self.rooms))
        returns, climbs = len(self.rooms) - rooms, len(self.climbs)
        return (
            f"{rooms} rooms, {returns} returns, {climbs} climbs, {len(self.names)} names; "
            f"{len(self.modules)} files, {len(self._functions)} functions"
        )


def imported(*names: str) -> Any:
    """The first module of these that there is: the tree before rooms had other names."""
    for name in names:
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError:
            continue
    raise SystemExit(f"none of {', '.join(names)} is installed")


def walked(artefact: Path, job_file: Path, scans: Path) -> dict[str, Walk]:
    """The walks of the page and of its scan."""
    press = imported("prooflight.press.artefact", "prooflight.press").Press.load(artefact)
    inspector = imported("prooflight.inspection.inspector", "prooflight.inspecting.inspector").Inspector.of(
        press
    )
    recorded = imported("prooflight.scans.recorded", "prooflight.acquiring.replay").recorded_scans
    scan = recorded(scans, sensors=len(press.sensors))[0]
    with imported("prooflight.pages.job").open_job(job_file, dpi=press.dpi) as job:
        page = press.geometry.lay(job.page(1))
    dn = scan.read(pixels=press.geometry.pixels, lines_max=press.geometry.lines(page.height_mm))
    inspector.inspect(
        inspector.prepare(page), dn, scan_name="scan"
    )  # what is loaded and compiled once is no walk
    walks = {"page": Walk(of=page.cmyk), "scan": Walk(of=dn)}
    sys.setprofile(walks["page"])
    prepared = inspector.prepare(page)
    sys.setprofile(walks["scan"])
    inspector.inspect(prepared, dn, scan_name="scan")
    sys.setprofile(None)
    return walks


if __name__ == "__main__":
    for what, walk in walked(*map(Path, sys.argv[1:4])).items():
        print(f"{what}: {walk.said()}")
        print("  " + " > ".join(walk.rooms))
