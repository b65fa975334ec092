"""How results show themselves to a person, in a notebook or at a prompt.

The room that draws them, ``reporting``, lies above the rooms that they come from; so the package as a whole says who
draws (``prooflight/__init__.py``), and nothing is loaded before something is to be shown.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

if TYPE_CHECKING:
    from PIL.Image import Image


class Renderer(Protocol):
    """Draws results; ``reporting.notebook`` is one."""

    def html(self, result: Any) -> str:
        """A result as HTML that stands anywhere, its texts escaped."""
        ...

    def sentence(self, result: Any) -> str:
        """A result in one line."""
        ...

    def picture(self, inspection: Any) -> Image:
        """What an inspection rests on."""
        ...


class Shown:
    """Shows itself."""

    __slots__ = ()
    renderer: ClassVar[Callable[[], Renderer]]

    def _repr_html_(self) -> str:
        """What notebooks show of a cell's last value."""
        return Shown.renderer().html(self)

    def show(self) -> None:
        """Show it now: in a notebook as a cell's last value would be, elsewhere in one line of text."""
        notebook = sys.modules.get("IPython")
        # A shell in a terminal has no kernel, and shows no pictures.
        if notebook is not None and hasattr(notebook.get_ipython(), "kernel"):
            notebook.display.display(self)
        else:
            sys.stdout.write(Shown.renderer().sentence(self) + "\n")
