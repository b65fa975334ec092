"""How a run is watched: deadline, queues, threads, memory."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from prooflight.pages.memory import available_bytes

DEADLINE_S: Final = 0.5
"""From a sheet's last line to its verdict: the reject gate is a metre further on at 2 m/s."""
DESIGNS_SHARE: Final = 0.5
"""Share of the free memory that designs may take. Assumed: what inspects, and everything else, needs the rest."""
DESIGNS_BYTES: Final = 4_000_000_000
"""Memory for designs where the system does not say what is free."""
LEAST_DESIGNS_BYTES: Final = 1_000_000_000
"""Memory for designs where little is free: those of a few sheets ahead."""
STALL_S: Final = 10.0
"""assumed: a web that changes its speed needs less, and an operator notices no sooner."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How a run is watched."""

    source_waits: bool
    """Whether the source can be made to wait; if not, sheets have deadlines and may be lost."""
    source_clock: bool = False
    """Whether the source's times are by the watcher's clock; if not, a sheet counts from when it was received."""
    deadline_s: float = DEADLINE_S
    room: int = 6
    """Sheets that may wait."""
    inspectors: int = 2
    """Threads that inspect; kernels let go of the interpreter's lock."""
    start_at_once: bool = False
    """Whether lines are read as soon as one design is ready; sheets of others are not inspected until theirs are."""
    ahead: int = 16
    """Sheets whose designs are made ready ahead; the pager thinks of the next 8."""
    preparers: int = 2
    """Threads that make designs ready, and yield to those that inspect; one does not keep up with 3 designs/s."""
    ahead_bytes: int = DESIGNS_BYTES
    """Memory for designs."""
    stall_s: float = STALL_S
    """Without a line from the source, after which that is announced."""
    sample: float = 0.0
    """Share of the sheets that pass for which a person is asked for a word. [-]"""
    seed: int = 0
    """Of randomised integral transforms, and of ranks that tie."""


def memory_for_designs() -> int:
    """Return how much memory designs may take on this machine as it is now. [bytes]"""
    free = available_bytes()
    return max(int(DESIGNS_SHARE * free), LEAST_DESIGNS_BYTES) if math.isfinite(free) else DESIGNS_BYTES
