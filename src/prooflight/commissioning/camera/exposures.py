"""Statistics of a line camera's dark and flat exposures for photon transfer: lines repeat the same columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import RequestError, ScanError
from prooflight.files.given import shortly
from prooflight.scans.recorded import recorded_scans

LEAST_LINES = 16
LEAST_COLUMNS = 100
"""Least number of columns; a fixed pattern's size from fewer would be known to 7 % at best, 1 / sqrt(2 n)."""
DARK_SIGMAS = 3.0
"""Temporal standard deviations from the lowest exposure within which another is dark as well."""
_LINES_AT_A_TIME = 256


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exposure:
    """Statistics of one sensor's exposure to uniform light, or to none."""

    name: str
    lines: int
    column_mean_dn: NDArray[np.float64]
    """Mean over lines (pixels,). [DN]"""
    variance_dn2: float
    """Temporal variance of one pixel, mean over columns, without the part that all columns share. [DN^2]"""
    line_variance_dn2: float
    """Variance from line to line that all columns share (lamp, supply). [DN^2]"""
    lowest_share: float
    """Share of samples at code 0. [-]"""
    highest_dn: int
    highest_share: float
    """Share of samples at the highest code of this exposure. [-]"""
    line_rate_hz: float | None = None
    """Line rate of a dark exposure taken at another line rate than the rest."""

    @property
    def mean_dn(self) -> float:
        """Return the mean over lines and columns. [DN]"""
        return float(self.column_mean_dn.mean())

    @property
    def degrees_of_freedom(self) -> float:
        """Return the degrees of freedom of ``variance_dn2``.

        For variances from differences of L neighbouring lines they are 2 (L-1)^2 / (3 L - 4) a column. The
        variance of a Gaussian's variance estimate is 2 sigma^4 / degrees of freedom (von Neumann 1941 for
        successive differences).
        """
        return 2 * (self.lines - 1) ** 2 / (3 * self.lines - 4) * self.column_mean_dn.size


@dataclass(frozen=True, slots=True, kw_only=True)
class ExposureRequest:
    """File or folder that a user names, and the line rate of its dark exposures if it is another than the rest's."""

    path: Path
    line_rate_hz: float | None = None

    @classmethod
    def parse(cls, text: str) -> ExposureRequest:
        """Parse ``dark.tif`` or ``dark.tif@277`` (line rate in Hz).

        A path that exists as written is taken as it is.
        """
        path = Path(text)
        stem, at, rate = text.rpartition("@")
        if not at or path.exists():
            return cls(path=path)
        try:
            line_rate_hz = float(rate)
        except ValueError:
            return cls(path=path)
        if not (np.isfinite(line_rate_hz) and line_rate_hz > 0):
            raise RequestError(
                shortly(text),
                f"{shortly(rate)} is not a line rate",
                remedy="give FILE@HZ with a rate above 0",
            )
        return cls(path=Path(stem), line_rate_hz=line_rate_hz)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExposureRequests:
    """Files that a user names: dark exposures, flat ones, and some to be separated by their level."""

    dark: tuple[ExposureRequest, ...]
    flat: tuple[ExposureRequest, ...]
    either: tuple[ExposureRequest, ...]

    @classmethod
    def parse(cls, *, dark: Iterable[str], flat: Iterable[str], either: Iterable[str]) -> ExposureRequests:
        """Parse the names of files; RequestError if nothing is named."""
        kinds = [tuple(ExposureRequest.parse(text) for text in kind) for kind in (dark, flat, either)]
        if not any(kinds):
            remedy = "give DARK... FLAT..., or --dark and --flat"
            raise RequestError("camera characterise", "no exposures are named", remedy=remedy)
        return cls(dark=kinds[0], flat=kinds[1], either=kinds[2])


def statistics(dn: NDArray[np.uint16], *, name: str, line_rate_hz: float | None = None) -> Exposure:
    """Reduce one sensor's exposure (lines, pixels) [DN] to statistics; ScanError if it is too small.

    The temporal variance is half the mean square difference of neighbouring lines, the two-image method of
    EMVA 1288 (Release 4.0 Linear, temporal noise) with lines as images: slow drift of the lamp does not
    enter, nor does, like the images' mean difference there, the part that all columns of a line share.
    """
    lines, pixels = dn.shape
    if lines < LEAST_LINES or pixels < LEAST_COLUMNS:
        what = f"has {lines} lines of {pixels} pixels"
        remedy = f"record at least {LEAST_LINES} lines of {LEAST_COLUMNS} pixels, better 500 full lines"
        raise ScanError(name, what, remedy=remedy)
    total = np.zeros(pixels)
    own = shared = 0.0
    lowest = int(dn.min())
    highest = int(dn.max())
    at_zero = at_highest = 0
    for start in range(0, lines, _LINES_AT_A_TIME):
        block = dn[start : start + _LINES_AT_A_TIME + 1].astype(np.float64)
        difference = np.diff(block, axis=0)
        jump = difference.mean(axis=1)
        own += float(np.square(difference - jump[:, None]).sum())
        shared += float(np.square(jump).sum())
        block = block[:_LINES_AT_A_TIME]
        total += block.sum(axis=0)
        at_highest += int((block == highest).sum())
        at_zero += int((block == 0).sum()) if lowest == 0 else 0
    variance = own / (2 * (lines - 1) * (pixels - 1))
    return Exposure(
        name=name,
        lines=lines,
        column_mean_dn=total / lines,
        variance_dn2=variance,
        line_variance_dn2=max(shared / (2 * (lines - 1)) - variance / pixels, 0.0),
        lowest_share=at_zero / dn.size,
        highest_dn=highest,
        highest_share=at_highest / dn.size,
        line_rate_hz=line_rate_hz,
    )


def read_exposures(
    requests: ExposureRequests,
    *,
    sensors: int | None = None,
    shown: Callable[[Sequence[ExposureRequest]], Iterable[ExposureRequest]] = iter,
) -> tuple[list[tuple[Exposure, ...]], list[tuple[Exposure, ...]]]:
    """Read dark and flat exposures, each with one statistic a sensor; ScanError if a file cannot be used.

    sensors: of the camera; None: as many as images in the first file. shown: passes requests on one by one,
    e.g. with a progress bar.
    """
    named = [*requests.dark, *requests.flat, *requests.either]
    count = _images_in(named[0].path) if sensors is None else sensors
    read = [_exposures_of(request, sensors=count) for request in shown(named)]
    _same_width(chain.from_iterable(read))
    first, end = len(requests.dark), len(requests.dark) + len(requests.flat)
    dark, flat, either = (
        list(chain.from_iterable(part)) for part in (read[:first], read[first:end], read[end:])
    )
    more_dark, more_flat = separated_by_level(either)
    return dark + more_dark, flat + more_flat


def _images_in(path: Path) -> int:
    """Count the images in the first TIFF that ``path`` names: the sensors of a camera that no press file describes."""
    first = recorded_scans(path, sensors=1)
    return sum(scan.path == first[0].path for scan in first)


def _exposures_of(request: ExposureRequest, *, sensors: int) -> list[tuple[Exposure, ...]]:
    """Reduce every exposure of a file or folder, one statistic for each sensor.

    ScanError if the file cannot be used.
    """
    scans = recorded_scans(request.path, sensors=sensors)
    reduced = []
    for scan in scans:
        name = str(scan.path)
        if scan.first_image or sum(other.path == scan.path for other in scans) > 1:
            name = f"{name} exposure {scan.first_image // sensors + 1}"
        reduced.append(
            tuple(statistics(image, name=name, line_rate_hz=request.line_rate_hz) for image in scan.read())
        )
    return reduced


def _same_width(exposures: Iterable[Sequence[Exposure]]) -> None:
    """Raise ScanError if two exposures have lines of different lengths."""
    first, *others = (sensors[0] for sensors in exposures)
    for exposure in others:
        wide, wanted = exposure.column_mean_dn.size, first.column_mean_dn.size
        if wide != wanted:
            what = f"is {wide} pixels wide where {first.name} is {wanted}"
            raise ScanError(
                exposure.name, what, remedy="record all exposures with one camera and whole lines"
            )


def separated_by_level(
    exposures: Sequence[tuple[Exposure, ...]],
) -> tuple[list[tuple[Exposure, ...]], list[tuple[Exposure, ...]]]:
    """Separate dark exposures from flat ones by level: dark ones have a line rate, or the lowest level of all.

    exposures, each with one entry a sensor. At the lowest level: within 3 temporal standard deviations, in
    each.
    """
    plain = [exposure for exposure in exposures if exposure[0].line_rate_hz is None]
    if not plain:
        return list(exposures), []
    lowest = min(plain, key=lambda exposure: sum(sensor.mean_dn for sensor in exposure))
    limits = [sensor.mean_dn + DARK_SIGMAS * sensor.variance_dn2**0.5 for sensor in lowest]

    def is_dark(exposure: tuple[Exposure, ...]) -> bool:
        dim = all(sensor.mean_dn <= limit for sensor, limit in zip(exposure, limits, strict=True))
        return dim or exposure[0].line_rate_hz is not None

    return [e for e in exposures if is_dark(e)], [e for e in exposures if not is_dark(e)]
