"""Steps of engineering at the usual priority: a busy machine would let those of the lowest wait for minutes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.pages.parallel import in_order
from prooflight.press.artefact import Press
from prooflight_console import child_process
from prooflight_console.engineering import steps

if TYPE_CHECKING:
    from collections.abc import Mapping
    from multiprocessing.connection import Connection

    from prooflight.detectors.entry import Training


def at_usual_priority(request: steps.StepRequest, sender: Connection) -> None:
    child_process.yield_to_all = lambda: None
    steps.step_aside(request, sender)


def build_with_little_training(request: steps.StepRequest, sender: Connection) -> None:
    """Build the press in use once more, and train nothing but distribute work as training does."""
    steps.build_press = lambda *_settings, **_options: Press.load(request.press)
    steps.training_functions = lambda _names: {_distribute: ()}
    at_usual_priority(request, sender)


def _distribute(_press: Press, _names: object, training: Training) -> Mapping[str, object]:
    assert list(in_order(abs, range(-9, 0), processes=training.processes, fewest=1)) == list(range(9, 0, -1))
    return {}
