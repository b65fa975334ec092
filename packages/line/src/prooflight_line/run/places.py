"""Description of places on a sheet in words that an operator can follow."""

from __future__ import annotations

from typing import Final

Box = tuple[float, float, float, float]
"""x, y, width and height. [mm]"""

ALL_OVER_SHARE: Final = 0.6
"""Share of the sheet's area above which a box counts as all over the sheet."""
ACROSS_SHARE: Final = 0.8
"""Share of the sheet's width above which a box counts as across the sheet."""
DOWN: Final = ("top", "middle", "bottom")
ACROSS: Final = ("left", "centre", "right")


def place_text(
    box_mm: Box | None, *, column: bool = False, size_mm: tuple[float, float] | None = None
) -> str:
    """Return a description of a box's place on the sheet.

    column: only the position across counts, as for a streak. size_mm: of the sheet, if known.

    >>> place_text((52.0, 12.0, 3.2, 4.1), size_mm=(210.0, 297.0))
    'top left, around 54 mm from the left and 14 mm from the top (3.2 x 4.1 mm)'
    >>> place_text((119.5, 0.0, 1.0, 297.0), column=True, size_mm=(210.0, 297.0))
    'centre, 120 mm from the left, along the travel'
    >>> place_text((0.0, 30.0, 210.0, 12.0), size_mm=(210.0, 297.0))
    'top, across the sheet from 30 to 42 mm from the top'
    >>> place_text((52.0, 12.0, 30.0, 41.0))
    'around 67 mm from the left and 32 mm from the top (30 x 41 mm)'
    >>> place_text(None)
    'all over the sheet'
    """
    if box_mm is None:
        return "all over the sheet"
    x_mm, y_mm, width_mm, height_mm = box_mm
    across_mm, down_mm = x_mm + width_mm / 2, y_mm + height_mm / 2
    down, across = "", ""
    if size_mm is not None:
        across, down = _third(ACROSS, across_mm, size_mm[0]), _third(DOWN, down_mm, size_mm[1])
    if column:
        return _joined(across, f"{across_mm:.0f} mm from the left, along the travel")
    if size_mm is not None and width_mm * height_mm > ALL_OVER_SHARE * size_mm[0] * size_mm[1]:
        return "all over the sheet"
    if size_mm is not None and width_mm > ACROSS_SHARE * size_mm[0]:
        ends = f"{max(y_mm, 0.0):.0f} to {y_mm + height_mm:.0f}"
        return _joined(down, f"across the sheet from {ends} mm from the top")
    digits = 1 if min(width_mm, height_mm) < 10 else 0
    size = f"{width_mm:.{digits}f} x {height_mm:.{digits}f} mm"
    place = f"around {across_mm:.0f} mm from the left and {down_mm:.0f} mm from the top ({size})"
    return _joined(f"{down} {across}".strip(), place)


def _third(names: tuple[str, str, str], at_mm: float, of_mm: float) -> str:
    return names[min(max(int(3 * at_mm / of_mm), 0), 2)]


def _joined(field: str, place: str) -> str:
    return f"{field}, {place}" if field else place


def around(one: Box, other: Box) -> Box:
    """Return the bounding box of two boxes."""
    left, top = min(one[0], other[0]), min(one[1], other[1])
    right = max(one[0] + one[2], other[0] + other[2])
    bottom = max(one[1] + one[3], other[1] + other[3])
    return left, top, right - left, bottom - top


def gap_mm(one: Box, other: Box, *, column: bool) -> float:
    """Return the gap between two boxes: the larger of those along the two axes; below 0, they overlap.

    column: only the axis across counts.
    """
    axes = (0,) if column else (0, 1)
    return max(
        max(one[axis], other[axis]) - min(one[axis] + one[axis + 2], other[axis] + other[axis + 2])
        for axis in axes
    )
