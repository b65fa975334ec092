"""The press artefact by which a run was judged."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.errors import PressError
from prooflight.press.artefact import Press

if TYPE_CHECKING:
    from pathlib import Path


def press_of_run(path: Path, *, name: str, digest: str) -> Press:
    """Load a press artefact; PressError: it is none, or not the one by which the run was judged.

    name, digest: of the press, as the run's record has them.
    """
    press = Press.load(path)
    if digest != press.digest:
        what = f"has digest {press.digest[:16]}, the run was judged by {digest[:16]}"
        raise PressError(path, what, remedy=f"give the artefact of press {name} that the run used")
    return press
