"""Steps of engineering at the usual priority: a busy machine would let those of the lowest wait for minutes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight_console import child_process
from prooflight_console.engineering import steps

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


def at_usual_priority(request: steps.StepRequest, sender: Connection) -> None:
    child_process.yield_to_all = lambda: None
    steps.step_aside(request, sender)
