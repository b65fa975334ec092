"""Several good scans of one page made into one golden: the mean of each pixel, and how much it differs between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.golden.differences import in_contrasts, level_difference, place_of
from prooflight.errors import ScanError


def mean_and_spread(
    goldens: Sequence[NDArray[np.float32]], names: Sequence[str]
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Return the mean of good scans of one page, and the standard deviation of a further one from it.

    Both have the shape (channels, lines, pixels) and the unit of the first scan, to which the others are
    registered, turned by 180 degrees if need be, and whose levels they take. A pixel that another scan does
    not show counts as in the first one. The spread is None for one scan; with n it holds the uncertainty of
    the mean too, a factor sqrt(1 + 1 / n).

    ScanError: a scan is of another size or number of channels than the first, or shows another page.
    """
    first = goldens[0]
    if len(goldens) == 1:
        return first, None
    aligned = [first]
    for golden, name in zip(goldens[1:], names[1:], strict=True):
        if golden.shape != first.shape:
            own, wanted = (" x ".join(map(str, image.shape)) for image in (golden, first))
            what = f"has {own} channels, lines and pixels, but {names[0]} has {wanted}"
            raise ScanError(name, what, remedy="give goldens of one page that were scanned in one way")
        aligned.append(_aligned(first, golden, name, names[0]))
    stack = np.stack(aligned)
    spread = stack.std(axis=0, ddof=1) * np.sqrt(1 + 1 / len(stack))
    return stack.mean(axis=0), np.asarray(spread, np.float32)


def _aligned(
    first: NDArray[np.float32], golden: NDArray[np.float32], name: str, of: str
) -> NDArray[np.float32]:
    """Return ``golden`` as it would look where ``first`` lies, in its levels."""
    where = place_of(golden, first)
    if not where.located:
        golden = np.ascontiguousarray(golden[:, ::-1, ::-1])
        where = place_of(golden, first)
    if not where.located or where.bent:
        remedy = "leave it out, or name it as the page that it shows"
        raise ScanError(name, f"does not show the page that {of} shows", remedy=remedy)
    result = np.empty_like(first)
    for channel, (one, other) in enumerate(zip(first, golden, strict=True)):
        moved = where.moved(other)
        moved = np.where(np.isfinite(moved), moved, one)
        (scaled,), (target,) = in_contrasts(moved[None], one[None])
        contrast = np.float32(np.ptp(moved) / max(float(np.ptp(scaled)), 1e-9))
        result[channel] = moved + contrast * level_difference(scaled, target, np.zeros_like(scaled))
    return result
