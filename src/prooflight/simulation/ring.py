"""Scans for the drum: a job printed on the simulated press, in advance or while the first sheets pass."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import RequestError
from prooflight.pages.job import JobSource, opened
from prooflight.pages.parallel import in_order
from prooflight.pages.process import step_back
from prooflight.rng import stream
from prooflight.simulation.scans import MisprintRequest, SimulatedScan, scan_page
from prooflight.simulation.session import session_of

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

OtherSheet = Literal["blank", "unknown"]
OTHER_SHEETS: Final[tuple[OtherSheet, ...]] = get_args(OtherSheet)
"""Sheets that are no page of the job, for faults of the order."""
LEAST_PRINTS: Final = 24
"""Least number of prints: a shorter job is printed several times, so that no two turns of the ring follow closely."""


def ring_size(pages: int, sheets: int) -> int:
    """Return the number of prints in a ring for so many sheets: whole jobs, unless fewer sheets are requested."""
    return min(pages * -(-LEAST_PRINTS // pages), max(sheets, 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class RingPrint:
    """Print of a ring; small and picklable, so that it can be sent to worker processes."""

    job: JobSource
    press: Press
    pages: int
    world: str = "press"
    requests: tuple[MisprintRequest, ...] = ()
    """Misprints to print, one after the other."""
    every: int = 10
    """Interval of misprints in prints, if one is requested and shows on its page."""
    seed: int = 1
    urgent: int | None = None
    """Number of prints that are waited for; those after them take only the time that nothing else wants. None: all."""

    def __call__(self, index: int | OtherSheet) -> SimulatedScan:
        """Return print ``index``, of page index modulo the job's, or a sheet that is no page of the job."""
        if self.urgent is not None and (isinstance(index, str) or index >= self.urgent):
            step_back()
        if isinstance(index, str):
            return self._other_sheet(index)
        session = session_of(self.press, self.seed, self.world)
        turn, last = divmod(index, self.every)
        wanted = (
            self.requests[turn % len(self.requests)] if self.requests and last == self.every - 1 else None
        )
        number = index % self.pages + 1
        others = tuple(other for other in range(1, self.pages + 1) if other != number)
        rng = stream(self.seed, "print", index)
        for request in (wanted, None):
            try:
                return scan_page(
                    self.page(number),
                    press=self.press,
                    request=request,
                    others=others,
                    fetch=self.page,
                    rng=rng,
                    session=session,
                )
            except RequestError:
                if request is None:
                    raise
        raise AssertionError  # the last request is for a good print

    def page(self, number: int) -> Page:
        """Return a page of the job as it lies in the press."""
        return self.press.geometry.lay(opened(self.job).page(number))

    def _other_sheet(self, kind: OtherSheet) -> SimulatedScan:
        """Return a blank sheet, or page 1 upside down and in other inks."""
        first = self.page(1)
        cmyk = np.zeros_like(first.cmyk)
        if kind == "unknown":
            cmyk = np.ascontiguousarray(first.cmyk[::-1, ::-1, [1, 2, 0, 3]])
        rng = stream(self.seed, "strangers", OTHER_SHEETS.index(kind))
        page = replace(first, cmyk=cmyk)
        return scan_page(page, press=self.press, request=None, others=(), fetch=self.page, rng=rng)


class GrowingRing(Sequence["NDArray[np.uint16]"]):
    """Scans of a ring that is still being printed: one that is not there yet is waited for."""

    def __init__(self, first: Sequence[SimulatedScan], rest: Iterator[SimulatedScan], count: int) -> None:
        """Take the first prints, and begin to take the rest in a thread of its own.

        count: number of prints in the ring; what comes after them is no part of it, but is returned by its index.
        """
        self._scans = [one.dn for one in first]
        self._count, self._changed = count, threading.Condition()
        self._error: BaseException | None = None
        threading.Thread(target=self._take, args=(rest,), name="ring", daemon=True).start()

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> NDArray[np.uint16]:  # type: ignore[override]  # no slices
        """Return a scan, or raise the error of the printing."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._scans) > index or self._error is not None)
            if len(self._scans) <= index and self._error is not None:
                raise self._error
            return self._scans[index]

    def _take(self, rest: Iterator[SimulatedScan]) -> None:
        error: BaseException | None = None
        try:
            for one in rest:
                with self._changed:
                    self._scans.append(one.dn)
                    self._changed.notify_all()
        except BaseException as raised:
            error = raised
        with self._changed:
            self._error = error
            self._changed.notify_all()


def rendered(
    prints: RingPrint, count: int, *, first: int = 0, other_sheets: bool = False
) -> Iterator[SimulatedScan]:
    """Yield the prints of a ring from ``first`` on, in order, and after them ``OTHER_SHEETS`` if they are asked for."""
    items: list[int | OtherSheet] = [*range(first, count), *(OTHER_SHEETS if other_sheets else ())]
    return in_order(prints, items)
