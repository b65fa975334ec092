"""Versions of the algorithms that results depend on, by which kept rows are known.

Raise a number when figures of that room change. Tidying, renaming and speed change none: ``tests/frozen`` tells which
of the two a change was.
"""

from __future__ import annotations

from typing import Final

ALGORITHMS: Final = {
    "corpus": 1,
    "golden": 2,
    "matched filter": 5,
    "pages": 1,
    "paper": 1,
    "prediction": 1,
    "registration": 3,
    "simulation": 1,
    "studies": 1,
}
