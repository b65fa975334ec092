"""Prooflight on a running press: line cameras, a verdict for each sheet, the journal, the gate and the plant.

``import prooflight_line as line`` gives these names; each is loaded when it is first touched.

================  =====================================================================================
Journal           every verdict of a press, and the evidence for it; ``Journal.open("runs.sqlite")``
JournalFollower   a journal that another process writes, read as it grows
JournalError      a journal that cannot be used
RunFacts          what is known of a run when it begins
RunRow            a run as the journal keeps it
PageRecord        one sheet of a run
Event             what is told to the plant: a run, a sheet, an incident, the press's state
parsed            an event from its JSON
list_cameras      the line cameras that answer
CameraLines       the lines of a camera, with an account of all losses
Settings          how a press is watched
watched           watch a source of lines: one outcome a sheet
================  =====================================================================================

Everything else is imported from its room: docs/ARCHITECTURE.md is the map.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from prooflight_line.cameras.backends import list_cameras as list_cameras
    from prooflight_line.cameras.source import CameraLines as CameraLines
    from prooflight_line.journal.following import JournalFollower as JournalFollower
    from prooflight_line.journal.journal import Journal as Journal
    from prooflight_line.journal.records import PageRecord as PageRecord
    from prooflight_line.journal.records import RunFacts as RunFacts
    from prooflight_line.journal.records import RunRow as RunRow
    from prooflight_line.journal.schema import JournalError as JournalError
    from prooflight_line.plant.events import Event as Event
    from prooflight_line.plant.events import parsed as parsed
    from prooflight_line.run.settings import Settings as Settings
    from prooflight_line.run.watching import watched as watched

__version__ = "0.3.0"

_HOMES = {
    "Journal": "journal.journal",
    "JournalFollower": "journal.following",
    "JournalError": "journal.schema",
    "RunFacts": "journal.records",
    "RunRow": "journal.records",
    "PageRecord": "journal.records",
    "Event": "plant.events",
    "parsed": "plant.events",
    "list_cameras": "cameras.backends",
    "CameraLines": "cameras.source",
    "Settings": "run.settings",
    "watched": "run.watching",
}
"""The module of each public name."""

__all__ = [*_HOMES, "__version__"]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first touched (PEP 562)."""
    if name not in _HOMES:
        message = f"module 'prooflight_line' has no attribute {name!r}"
        raise AttributeError(message)
    value = getattr(import_module(f"prooflight_line.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
