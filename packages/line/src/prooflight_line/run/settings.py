"""Settings by which a run is watched: deadline, queues, threads, memory."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from prooflight.pages.memory import available_bytes

DEADLINE_S: Final = 0.5
"""Time from a sheet's last line to its verdict: the reject gate is a metre further on at 2 m/s."""
DESIGNS_SHARE: Final = 0.4
"""Share of the free memory that packed designs may take. Assumed: the same designs written out
(``shared_designs.WRITTEN_SHARE``) may take as much, and inspection, and everything else, needs the rest."""
DESIGNS_BYTES: Final = 4_000_000_000
"""Memory for designs if the system does not report its free memory."""
LEAST_DESIGNS_BYTES: Final = 1_000_000_000
"""Memory for designs if little is free: enough for a few sheets ahead."""
STALL_S: Final = 10.0
"""Time without a line after which a source counts as silent. assumed: a web that changes its speed needs
less, and an operator notices no sooner."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings by which a run is watched."""

    source_waits: bool
    """Whether the source can be made to wait; if not, sheets have deadlines and may be dropped."""
    source_clock: bool = False
    """Whether the source's times are by the watcher's clock; if not, a sheet's time is when it was
    received."""
    deadline_s: float = DEADLINE_S
    room: int = 6
    """Greatest number of sheets that wait."""
    inspectors: int = 2
    """Number of threads that inspect; kernels release the interpreter's lock."""
    explainers: int = 0
    """Number of threads beside these, so that others inspect while a misprint that is decided is explained."""
    start_at_once: bool = False
    """Whether lines are read as soon as one design is ready; sheets of others are not inspected until theirs
    are."""
    ahead: int = 16
    """Number of sheets whose designs are prepared ahead; the pager considers the next 8."""
    preparers: int = 2
    """Number of threads that prepare designs, yielding to those that inspect; one does not keep up with 3
    designs/s."""
    ahead_bytes: int = DESIGNS_BYTES
    """Memory for designs."""
    stall_s: float = STALL_S
    """Time without a line from the source after which that is announced."""
    sample: float = 0.0
    """Share of the sheets that pass that is sampled for review. [-]"""
    seed: int = 0
    """Seed of randomised integral transforms and of ties between ranks."""


def memory_for_designs() -> int:
    """Return how much memory designs may take on this machine as it is now. [bytes]"""
    free = available_bytes()
    return max(int(DESIGNS_SHARE * free), LEAST_DESIGNS_BYTES) if math.isfinite(free) else DESIGNS_BYTES
