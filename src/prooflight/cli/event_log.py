"""The log of a command that runs for long, for programs: one JSON object a line, instead of lines for people.

A line has ``time``, ``level`` and ``event``, and the fields of the event. It goes to standard error, where people
otherwise read; standard output keeps what was asked for, as with ``--json``.
"""

from __future__ import annotations

import json
import logging
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal

import typer

from prooflight.cli import show

VARIABLE: Final = "PROOFLIGHT_LOG"
LogOption = Annotated[
    Literal["text", "json"],
    typer.Option(
        "--log",
        envvar=VARIABLE,
        show_envvar=False,
        help=f"Log for people, or one JSON object a line for programs; default ${VARIABLE}.",
    ),
]

_events: Final = logging.getLogger("prooflight.events")
_added: ContextVar[Mapping[str, Any]] = ContextVar("added", default=MappingProxyType({}))


class JsonLines(logging.Handler):
    """Handler that writes each record as a line of JSON; records of other libraries are the event ``log``."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record."""
        line: dict[str, Any] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
        }
        if record.name == _events.name:
            line |= {"event": record.getMessage(), **_added.get(), **record.__dict__["fields"]}
        else:
            line |= {
                "event": "log",
                **_added.get(),
                "logger": record.name,
                "text": record.getMessage(),
            }
        if record.exc_info and record.exc_info[1] is not None:
            line["exception"] = logging.Formatter().formatException(record.exc_info)
        text = json.dumps(_finite(line), default=str)
        try:
            sys.stderr.write(text + "\n")
            sys.stderr.flush()
        except (OSError, ValueError):  # nobody reads any more, and a run must not end for that
            self.handleError(record)


def is_on() -> bool:
    """Return whether this process logs for programs."""
    return any(isinstance(one, JsonLines) for one in _events.handlers)


def begin(log: Literal["text", "json"]) -> None:
    """Log as ``LogOption`` asks, until ``end``; for programs, nothing is printed for people meanwhile."""
    if log == "text" or is_on():
        return
    _events.addHandler(JsonLines())
    _events.setLevel(logging.INFO)
    _events.propagate = False
    logging.getLogger().addHandler(JsonLines(logging.WARNING))
    show.people.quiet = show.errors.quiet = True


def end() -> None:
    """Print for people again."""
    if not is_on():
        return
    for logger in (_events, logging.getLogger()):
        for handler in [one for one in logger.handlers if isinstance(one, JsonLines)]:
            logger.removeHandler(handler)
    show.people.quiet = show.errors.quiet = False


def write(
    event: str, *, level: int = logging.INFO, error: BaseException | None = None, **fields: Any
) -> bool:
    """Log an event with its fields; return whether this process logs for programs, otherwise nothing is written.

    error: its traceback is logged as well.
    """
    if not is_on():
        return False
    _events.log(level, event, exc_info=error, extra={"fields": fields})
    return True


@contextmanager
def added(**fields: Any) -> Iterator[None]:
    """Add fields to all lines that this thread or task logs within the block."""
    token = _added.set({**_added.get(), **fields})
    try:
        yield
    finally:
        _added.reset(token)


def _finite(value: Any) -> Any:
    """Return a value with NaN and infinities as texts, for which JSON has no numbers."""
    if isinstance(value, float):
        return value if math.isfinite(value) else repr(value)
    if isinstance(value, Mapping):
        return {str(name): _finite(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return value
