"""The console: runs of a press in a browser.

It is a process of its own, which reads the journal while `watch` writes it, and writes only its own file.

``import prooflight_console`` gives these names; each is loaded when it is first touched.

================  =====================================================================================
ConsoleSettings   what a console shows, and where; ``ConsoleSettings.of(Path("runs.sqlite"))``
console_app       the ASGI application of a console
Listening         where a console listens
serve             serve a console until it is stopped
================  =====================================================================================
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from prooflight_console.app import console_app as console_app
    from prooflight_console.running import Listening as Listening
    from prooflight_console.running import serve as serve
    from prooflight_console.settings import ConsoleSettings as ConsoleSettings

__version__ = "0.3.0"

_HOMES = {
    "ConsoleSettings": "settings",
    "console_app": "app",
    "Listening": "running",
    "serve": "running",
}
"""The module of each public name."""

__all__ = [*_HOMES, "__version__"]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first touched (PEP 562)."""
    if name not in _HOMES:
        message = f"module 'prooflight_console' has no attribute {name!r}"
        raise AttributeError(message)
    value = getattr(import_module(f"prooflight_console.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
