"""Display of results in a notebook or at a prompt.

``reporting``, which draws them, lies above the packages that they come from, so ``prooflight/__init__.py``
sets the renderer, and nothing is loaded before a result is displayed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

if TYPE_CHECKING:
    from PIL.Image import Image


class Renderer(Protocol):
    """Interface for drawing results; ``reporting.notebook`` implements it."""

    def html(self, result: Any) -> str:
        """Return a result as HTML that is valid anywhere, with its texts escaped."""
        ...

    def sentence(self, result: Any) -> str:
        """Return a result in one line."""
        ...

    def picture(self, inspection: Any) -> Image:
        """Return a picture of the evidence of an inspection."""
        ...


class Shown:
    """Mixin for results that display themselves."""

    __slots__ = ()
    renderer: ClassVar[Callable[[], Renderer]]

    def _repr_html_(self) -> str:
        """Return the HTML that notebooks show for a cell's last value."""
        return Shown.renderer().html(self)

    def show(self) -> None:
        """Show the result: in a notebook as a cell's last value would be, elsewhere in one line of text."""
        notebook = sys.modules.get("IPython")
        # A shell in a terminal has no kernel, and shows no pictures.
        if notebook is not None and hasattr(notebook.get_ipython(), "kernel"):
            notebook.display.display(self)
        else:
            sys.stdout.write(Shown.renderer().sentence(self) + "\n")
