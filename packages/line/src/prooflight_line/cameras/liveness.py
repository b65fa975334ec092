"""Liveness check of a camera in a thread of its own, since it may answer after seconds or never."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.errors import ScanError

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_line.cameras.camera import Camera

ASK_AFTER_S: Final = 0.4
"""Time without a block, after which a camera is queried."""
ASK_AGAIN_S: Final = 0.2
ANSWER_S: Final = 1.0
"""Longest time for an answer; with ``ASK_AFTER_S`` an operator is informed within 2 s."""


@dataclass(slots=True, eq=False)
class Query:
    """One query, and its answer once it has come."""

    requested_s: float
    answered: bool = False
    position: int | None = None
    """Position of the encoder, in steps; None if the camera does not report it."""
    error: str = ""
    """Why the camera cannot answer; empty if it does."""


class Watchdog:
    """Queries one open camera, one query at a time, and decides what its silence means.

    ``silent`` is called by the reading thread whenever no block has come. A stopped press is no dead camera:
    where the camera reports the encoder's position, it must have sent the lines for its movement.
    """

    def __init__(
        self,
        camera: Camera,
        *,
        position: Callable[[Camera], int | None],
        most_steps: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Watch one camera.

        Parameters
        ----------
        position : the query itself; ScanError: the camera does not answer
        most_steps : greatest movement of the encoder without a block, that of two blocks
        """
        self._camera, self._position = camera, position
        self._most_steps, self._clock = most_steps, clock
        self._query: Query | None = None
        self._position_at_first: int | None = None

    def heard(self) -> None:
        """Reset the check, as a block has come."""
        self._query = self._position_at_first = None

    def silent(self, silent_s: float) -> str:
        """Return why a camera that has sent no block for so long is dead; empty if nothing indicates it."""
        query = self._query
        if query is None:
            if silent_s >= ASK_AFTER_S:
                self._ask()
            return ""
        if not query.answered:
            waited_s = self._clock() - query.requested_s
            return f"has not answered for {waited_s:.1f} s" if waited_s > ANSWER_S else ""
        if query.error:
            return query.error
        if query.position is not None:
            if self._position_at_first is None:
                self._position_at_first = query.position
            steps = abs(query.position - self._position_at_first)
            if steps > self._most_steps:
                return f"has sent no line for {silent_s:.1f} s, although its encoder has advanced by {steps} steps"
        if self._clock() - query.requested_s >= ASK_AGAIN_S:
            self._ask()
        return ""

    def _ask(self) -> None:
        query = Query(self._clock())
        self._query = query
        threading.Thread(target=self._answer, args=(query,), name="ask camera", daemon=True).start()

    def _answer(self, query: Query) -> None:
        try:
            query.position = self._position(self._camera)
        except ScanError as failure:
            query.error = failure.what
        except Exception as failure:  # any error of a library means that the camera did not answer
            query.error = f"does not answer ({failure})"
        query.answered = True
