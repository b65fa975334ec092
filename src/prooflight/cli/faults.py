"""Reports of errors, in one line on standard error, with tracebacks in a log file.

Operators of a press read lines, not tracebacks; developers of Prooflight need the tracebacks.
"""

from __future__ import annotations

import contextlib
import logging
import platform
import tempfile
from collections.abc import Iterator, Sequence
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Final

from prooflight import __version__
from prooflight.cli import event_log
from prooflight.cli.show import errors
from prooflight.errors import sentence
from prooflight.files.user_folders import user_folder

PACKAGES: Final = ("prooflight", "prooflight_line", "prooflight_console", "opentelemetry")
"""Packages whose log records are printed; the last exports traces, and says when it cannot."""
LOG_BYTES: Final = 1_000_000
"""Size of the log file, and of the one before it: some 300 tracebacks."""


def report(line: object) -> None:
    """Print one line for a person, or log it for programs."""
    if event_log.write("report", level=logging.WARNING, text=sentence(line)):
        return
    errors.print(f"prooflight: {sentence(line)}", highlight=False, soft_wrap=True)


class FaultLog(logging.Handler):
    """Handler that prints warnings in one line each, and writes tracebacks to a file."""

    def __init__(self, arguments: Sequence[str]) -> None:
        super().__init__(logging.WARNING)
        self._command = " ".join(["prooflight", *arguments])

    def emit(self, record: logging.LogRecord) -> None:
        """Print a log record; an exception that comes with it is written to the file, and named."""
        if event_log.is_on():  # whose own handler writes it
            return
        line = record.getMessage()
        if record.exc_info and record.exc_info[1] is not None:
            line += f": {type(record.exc_info[1]).__name__}: {record.exc_info[1]} ({self._store(record)})"
        report(line)

    def _store(self, record: logging.LogRecord) -> str:
        for of_user in (True, False):
            with contextlib.suppress(OSError, RuntimeError):  # a user without a home has no folder
                folder = user_folder("state") if of_user else Path(tempfile.gettempdir())
                file = folder / "prooflight-faults.log"
                folder.mkdir(parents=True, exist_ok=True)
                self._write(file, record)
                return f"details in {file}"
        return "and its details could not be written"

    def _write(self, file: Path, record: logging.LogRecord) -> None:
        handler = RotatingFileHandler(
            file, maxBytes=LOG_BYTES, backupCount=1, encoding="utf-8", errors="replace"
        )
        version = f"{__version__}, Python {platform.python_version()}, {platform.platform()}"
        handler.setFormatter(logging.Formatter(f"%(asctime)s %(message)s\n{self._command}\n{version}"))
        with contextlib.closing(handler):
            handler.emit(record)


@contextlib.contextmanager
def logged(arguments: Sequence[str]) -> Iterator[logging.Logger]:
    """Print log records of ``PACKAGES`` as lines, and give the logger for unexpected errors."""
    loggers, handler = [logging.getLogger(name) for name in PACKAGES], FaultLog(arguments)
    for one in loggers:
        one.addHandler(handler)
    try:
        yield loggers[0]
    finally:
        event_log.end()
        for one in loggers:
            one.removeHandler(handler)
