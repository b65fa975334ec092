"""A camera asked whether it still answers, beside the reading of its lines: it may take seconds to, or never do."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.errors import ScanError

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.scans.cameras.camera import Camera

ASK_AFTER_S: Final = 0.4
"""Without a block, after which a camera is asked."""
ASK_AGAIN_S: Final = 0.2
ANSWER_S: Final = 1.0
"""How long it may take to answer; with ``ASK_AFTER_S`` an operator is told within 2 s."""


@dataclass(slots=True, eq=False)
class Question:
    """One question, and the answer once it is there."""

    asked_s: float
    answered: bool = False
    position: int | None = None
    """How far the encoder has gone, in steps; None: the camera does not say."""
    gone: str = ""
    """Why the camera cannot answer; empty: it does."""


class Asking:
    """Asks one open camera, one question at a time, and says what its silence means.

    ``silent`` is asked by the reading thread whenever no block has come. A press that stands is no dead camera: where
    the camera says how far the encoder has gone, it must have sent the lines for that.
    """

    def __init__(
        self,
        camera: Camera,
        *,
        position: Callable[[Camera], int | None],
        most_steps: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """position: the question itself; ScanError: the camera does not answer. most_steps: that the encoder may have
        gone since a block came without another coming: of two blocks.
        """
        self._camera, self._position = camera, position
        self._most_steps, self._clock = most_steps, clock
        self._asked: Question | None = None
        self._position_at_first: int | None = None

    def heard(self) -> None:
        """A block has come."""
        self._asked = self._position_at_first = None

    def silent(self, silent_s: float) -> str:
        """Why a camera that has sent no block for so long is dead; empty: nothing says so."""
        asked = self._asked
        if asked is None:
            if silent_s >= ASK_AFTER_S:
                self._ask()
            return ""
        if not asked.answered:
            waited_s = self._clock() - asked.asked_s
            return f"does not answer, for {waited_s:.1f} s" if waited_s > ANSWER_S else ""
        if asked.gone:
            return asked.gone
        if asked.position is not None:
            if self._position_at_first is None:
                self._position_at_first = asked.position
            steps = abs(asked.position - self._position_at_first)
            if steps > self._most_steps:
                return f"has sent no line for {silent_s:.1f} s, though its encoder has gone {steps} steps on"
        if self._clock() - asked.asked_s >= ASK_AGAIN_S:
            self._ask()
        return ""

    def _ask(self) -> None:
        question = Question(self._clock())
        self._asked = question
        threading.Thread(target=self._answer, args=(question,), name="ask camera", daemon=True).start()

    def _answer(self, question: Question) -> None:
        try:
            question.position = self._position(self._camera)
        except ScanError as error:
            question.gone = error.what
        except Exception as error:  # whatever a library says: the camera did not answer
            question.gone = f"does not answer ({error})"
        question.answered = True
