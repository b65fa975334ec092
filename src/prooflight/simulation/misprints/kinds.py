"""Kinds of misprint and their drawing functions.

Kinds, amounts and severities are those of ``worlds.toml``. Each misprint acts where it does on a press: most
change the printed raster, a page off its place lies elsewhere under the camera.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from prooflight.rng import stream
from prooflight.simulation.misprints import content, marks, planes
from prooflight.simulation.misprints.drawing import Drawn, Mishap, Misprint
from prooflight.simulation.worlds import entry

if TYPE_CHECKING:
    from prooflight.pages.raster import Page

__all__ = ["KINDS", "Drawn", "Misprint", "draw_misprint", "scope_of"]

_DRAWERS: dict[str, Callable[[Mishap], Drawn]] = {
    "missing-plane": planes.missing_plane,
    "swapped-planes": planes.swapped_planes,
    "density": planes.density,
    "plane-register": planes.plane_register,
    "streak": marks.streak,
    "banding": planes.banding,
    "spots-voids": marks.spots_voids,
    "ghost-smear": content.ghost_smear,
    "local-blur": content.local_blur,
    "missing-content": content.missing_content,
    "wrong-page": content.wrong_page,
    "scum": marks.scum,
}
KINDS = tuple(_DRAWERS)
"""Kinds in the order of ``worlds.toml``."""


def scope_of(kind: str) -> str:
    """Return ``global`` or ``local``, as ``worlds.toml`` has it: the paper's two types of misprint."""
    return str(entry(kind)["scope"])


def draw_misprint(
    page: Page,
    kind: str,
    severity: float,
    *,
    others: Sequence[int],
    fetch: Callable[[int], Page],
    rng: np.random.Generator,
) -> Drawn:
    """Draw one misprint of a kind of ``KINDS`` on a page, at a severity from 0 to 1; the page given is not changed.

    others: numbers of the job's other pages, which ``fetch`` gives. Inks and places are drawn from those that
    the page has; where a kind cannot be on this page (a page of one ink has no planes out of register)
    nothing is changed, and the caller has to check and to draw again.
    """
    rounding = stream(int(rng.integers(2**63)), "misprint-rounding")
    return _DRAWERS[kind](
        Mishap(
            kind=kind, page=page, severity=severity, rng=rng, rounding=rounding, others=others, fetch=fetch
        )
    )
