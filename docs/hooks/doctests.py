"""Doctests in docstrings are shown as sessions at a prompt, not as Markdown's quotations."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

SESSION = re.compile(r"^>>> .*(?:\n(?!\s*$).*)*", re.MULTILINE)


class Doctests(Extension):
    """For mkdocstrings."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Put fences around every session of a docstring."""
        if obj.docstring is not None:
            obj.docstring.value = SESSION.sub(lambda found: f"```pycon\n{found[0]}\n```", obj.docstring.value)
