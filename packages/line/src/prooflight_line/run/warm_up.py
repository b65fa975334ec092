"""Rehearsal before the first sheet: whatever inspects has loaded designs and kernels, and has the memory it needs."""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight.inspection.packed_design import PackedDesign
    from prooflight_line.run.sheet_inspector import SheetInspector

_log = logging.getLogger(__name__)

REHEARSALS: Final = 2
"""Number of designs with which inspection is rehearsed."""


def warm_up(
    ready: Sequence[tuple[SheetInspector, PackedDesign]],
    rehearsed: Sequence[tuple[SheetInspector, PackedDesign]],
    *,
    threads: int,
    is_stopping: Callable[[], bool],
    done: Callable[[], None],
) -> None:
    """Load all designs, then inspect made-up sheets of some with every thread or process that inspects.

    ready: designs of the job that are ready. rehearsed: the ``REHEARSALS`` of them. done: called after each of these.
    """
    with ThreadPoolExecutor(threads) as pool:
        loads = [pool.submit(inspector.load, design) for inspector, design in ready if not is_stopping()]
        inspector, design = rehearsed[0]
        inspector.rehearse_preparation(design)
        scans = [inspector.rehearsal_scans(design) for inspector, design in rehearsed]
    try:
        for load in loads:
            load.result()
        # After all designs are loaded: the first inspection after that took three times as long.
        for (inspector, design), seen in zip(rehearsed, scans, strict=True):
            if not is_stopping():
                inspector.rehearse(design, seen, threads=threads)
            done()
    except Exception as error:
        _log.error("a warm-up failed", exc_info=error)  # its sheets will report it
