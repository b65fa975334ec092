"""Scans for the drum: a job printed on the simulated press in advance, so that playing does not slow the inspection."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import RequestError
from prooflight.pages.job import opened
from prooflight.pages.parallel import in_order
from prooflight.rng import stream
from prooflight.simulation.scans import scan_page
from prooflight.simulation.session import session_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight.pages.job import JobSource
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.scans import MisprintRequest, SimulatedScan

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

    def __call__(self, index: int) -> SimulatedScan:
        """Return print ``index``, of page index modulo the job's."""
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

    def strangers(self) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
        """Return scans of a blank sheet, and of one that is no page of the job.

        The latter is page 1 upside down and in other inks.
        """
        first = self.page(1)
        blank = replace(first, cmyk=np.zeros_like(first.cmyk))
        foreign = replace(first, cmyk=np.ascontiguousarray(first.cmyk[::-1, ::-1, [1, 2, 0, 3]]))
        rng = stream(self.seed, "strangers")
        scans = [
            scan_page(page, press=self.press, request=None, others=(), fetch=self.page, rng=rng).dn
            for page in (blank, foreign)
        ]
        return scans[0], scans[1]


def rendered(prints: RingPrint, count: int) -> Iterator[SimulatedScan]:
    """Yield the prints of a ring, in order."""
    return in_order(prints, range(count))
