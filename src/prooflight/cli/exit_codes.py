"""Exit codes of commands.

A command exits with 0 only if all requests were done and every sheet was judged good.
"""

from __future__ import annotations

from typing import Final

EXIT_MISPRINT: Final = 1
"""Every sheet was inspected, and there was a misprint; for ``run replay``, a figure differs."""
UNUSABLE_INPUT: Final = 2
"""The input cannot be used; one line states what, where, and what would be right."""
NOT_ALL_INSPECTED: Final = 3
"""A sheet was not inspected or is held, is missing, or was not recorded; there may have been misprints as
well."""
OWN_FAULT: Final = 4
"""A defect of Prooflight itself occurred; one line reports it and names the log file."""
OVERLOADED: Final = 5
"""Sheets were not inspected because inspection did not keep pace with the press; all of 3 may hold as well."""
INTERRUPTED: Final = 130
"""A person ended a command that does not end itself; as in shells, 128 plus the number of SIGINT."""


def of_run(*, misprints: int, complete: bool, overloaded: bool = False) -> int:
    """Return the exit code of a run of sheets.

    ``complete`` states whether every sheet came, was judged, and was recorded; ``overloaded``, whether
    inspection did not keep pace.
    """
    if overloaded:
        return OVERLOADED
    if not complete:
        return NOT_ALL_INSPECTED
    return EXIT_MISPRINT if misprints else 0
