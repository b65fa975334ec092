"""Conditions on one defect of a sheet: its kind, its ink, its size, and its place on the page."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class DefectConditions:
    """Conditions that one defect of a sheet must meet together; None: no condition.

    The place is a rectangle of the page, widened by ``within_mm`` all round; a defect meets it if its own rectangle
    reaches into it. A rectangle without width and height is a point.
    """

    kind: str | None = None
    ink: str | None = None
    """Letter of the ink; empty: of no single ink."""
    least_mm: float | None = None
    """Least length of the longer side of the defect's rectangle. [mm]"""
    x_mm: float | None = None
    y_mm: float | None = None
    """Top-left corner; without ``x_mm`` the place is as wide as the page, without ``y_mm`` as long. [mm]"""
    width_mm: float = 0.0
    height_mm: float = 0.0
    within_mm: float = 0.0

    @property
    def box_mm(self) -> tuple[float, float, float, float] | None:
        """Left, top, right and bottom of the place; None: any place. [mm]"""
        if self.x_mm is None and self.y_mm is None:
            return None
        left, right = (-math.inf, math.inf) if self.x_mm is None else (self.x_mm, self.x_mm + self.width_mm)
        top, bottom = (-math.inf, math.inf) if self.y_mm is None else (self.y_mm, self.y_mm + self.height_mm)
        return left, top, right, bottom

    @property
    def any_defect(self) -> bool:
        """Whether a defect of any ink, size and place meets them, so that a sheet's own kind suffices."""
        return self.ink is None and self.least_mm is None and self.box_mm is None

    def sql(
        self, *, kind: str, ink: str, box: tuple[str, str, str, str], mark: str = "?", greatest: str = "max"
    ) -> tuple[str, list[str]]:
        """Return the same as SQL, and the texts for its marks; numbers are written out.

        kind, ink, box: SQL of the defect's kind, its ink, and its left, top, width and height. mark: the place of a
        value. greatest: the function that returns the greatest of its arguments.
        """
        left, top, width, height = box
        parts, values = [], []
        for column, text in ((kind, self.kind), (ink, self.ink)):
            if text is not None:
                parts.append(f"{column} = {mark}")
                values.append(text)
        if self.least_mm is not None:
            parts.append(f"{greatest}({width}, {height}) >= {self.least_mm!r}")
        if (place := self.box_mm) is not None:
            gaps = [
                f"{greatest}({start} - {last!r}, {first!r} - ({start} + {length}), 0.0)"
                for start, length, first, last in (
                    (left, width, place[0], place[2]),
                    (top, height, place[1], place[3]),
                )
                if math.isfinite(first)
            ]
            parts.append(f"{' + '.join(f'{gap} * {gap}' for gap in gaps)} <= {self.within_mm**2!r}")
        return " AND ".join(parts) or "1 = 1", values
