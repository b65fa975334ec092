"""What a command says to whoever started it, by its exit code.

0 is said only where everything asked for was done and every sheet was judged good.
"""

from __future__ import annotations

from typing import Final

MISPRINT_FOUND: Final = 1
"""Every sheet was inspected, and there was a misprint; of ``run replay``: a figure differs."""
UNUSABLE_INPUT: Final = 2
"""The input cannot be used; one line says what, where, and what would be right."""
NOT_ALL_INSPECTED: Final = 3
"""A sheet was not inspected or is held, is missing, or was not recorded; there may have been misprints as well."""
OWN_FAULT: Final = 4
"""A defect of Prooflight itself: one line says so and names the log file."""
OVERLOADED: Final = 5
"""Sheets were not inspected because inspection did not keep pace with the press; all of 3 may hold as well."""
INTERRUPTED: Final = 130
"""A person ended a command that does not end itself, as shells say it: 128 and the number of SIGINT."""


def of_run(*, misprints: int, complete: bool, overloaded: bool = False) -> int:
    """What a run of sheets comes to.

    complete: whether every sheet came, was judged, and was recorded. overloaded: whether inspection did not keep pace.
    """
    if overloaded:
        return OVERLOADED
    if not complete:
        return NOT_ALL_INSPECTED
    return MISPRINT_FOUND if misprints else 0
