"""Reason why a page could not be inspected, in one line."""

from __future__ import annotations

import logging

from prooflight.errors import ProoflightError

_log = logging.getLogger(__name__)


def reason_of(error: Exception, *, of: str) -> str:
    """Return an error as the reason in a verdict.

    An unexpected one is logged whole. of: the work that failed.
    """
    if isinstance(error, ProoflightError):
        return str(error)
    if isinstance(error, MemoryError):
        return "there is not enough memory"
    if isinstance(error, OSError):
        return f"{error.filename or 'system'}: {error.strerror or error}"
    _log.error("%s", of, exc_info=error)
    return f"a fault of Prooflight itself: {type(error).__name__}: {error}"
