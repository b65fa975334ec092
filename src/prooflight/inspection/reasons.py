"""Why a page could not be looked at, in one line."""

from __future__ import annotations

import logging

from prooflight.errors import ProoflightError

_log = logging.getLogger(__name__)


def reason_of(error: Exception, *, of: str) -> str:
    """An error as the reason in a verdict; one that nobody foresaw is logged whole. of: what was being done."""
    if isinstance(error, ProoflightError):
        return str(error)
    if isinstance(error, MemoryError):
        return "there is not enough memory"
    if isinstance(error, OSError):
        return f"{error.filename or 'system'}: {error.strerror or error}"
    _log.error("%s", of, exc_info=error)
    return f"a fault of Prooflight itself: {type(error).__name__}: {error}"
