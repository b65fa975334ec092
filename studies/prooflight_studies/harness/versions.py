"""Versions of the algorithms that results depend on; cached rows are stored under them.

Raise a number when figures of that package change. Tidying, renaming and speed change none: ``tests/frozen`` shows
which of the two a change was.
"""

from __future__ import annotations

from typing import Final

ALGORITHMS: Final = {
    "corpus": 1,
    "golden": 2,
    "matched filter": 6,
    "pages": 1,
    "paper": 1,
    "prediction": 2,
    "registration": 3,
    "simulation": 1,
    "studies": 1,
}

DETECTION: Final = {
    name: ALGORITHMS[name]
    for name in ("corpus", "matched filter", "pages", "prediction", "registration", "simulation", "studies")
}
"""Those on which the matched filter's statistics of simulated prints depend."""
