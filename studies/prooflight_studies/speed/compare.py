"""Speed of comparing a scan with a given prediction, its baselines, and the memory's own speed, in one run."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.detectors.base import BLOCK_PIXELS
from prooflight.detectors.paper.evidence import compare, gather, interval_edges
from prooflight.kernels.compiled import kernel
from prooflight.prediction.compact import Scale, compact
from prooflight_studies.harness.measures import normalised_error

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.prediction.predict import Prediction

REPEATS: Final = 9
READ_LIMIT: Final = "read 6 bytes a pixel"
"""Row that reads the bytes of a scan and of its expected signal: an upper bound for any comparison."""
COMPARE_AND_GATHER: Final = "compare and gather"
LEAST_WORK: Final = "compare integers alone, without the draw"
"""Row that neither makes integers of the prediction nor draws what the converter rounded away: the least work."""
NUMPY: Final = "numpy, the same statistics of plain z"
SSIM_SCIKIT: Final = "SSIM, scikit-image"
SSIM_WINDOW: Final = 11
SSIM_SIGMA_PX: Final = 1.5
"""Window of SSIM (Wang, Bovik, Sheikh, Simoncelli 2004, section III.C)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareRow:
    """One method of comparison, timed on one core in turns with all others."""

    name: str
    mpx_per_cpu_s: float
    """Camera megapixels a second of processor time, median of the repeats."""
    lowest_mpx_per_cpu_s: float
    highest_mpx_per_cpu_s: float
    of_read_limit: float
    """Speed over that of reading 6 bytes a pixel in the same run. [-]"""
    speed_ratio: float
    """Speed of ``COMPARE_AND_GATHER`` over this one. [-]"""


@kernel("numbers (_)")
def read(numbers):  # type: ignore[no-untyped-def]
    """Touch every 8 bytes once."""
    seen = np.uint64(0)
    for i in range(numbers.size):
        seen ^= numbers[i]
    return seen


def numpy_statistics(
    measured_dn: NDArray[np.uint16], prediction: Prediction
) -> tuple[NDArray[np.generic], ...]:
    """Return the statistics of ``Evidence`` in NumPy, of plain z: histogram, block means, energy, extremes, sums."""
    z = normalised_error(measured_dn, prediction.expected_dn, prediction.variance_dn2)
    place = np.searchsorted(interval_edges().astype(np.float32) / 64, z.ravel())
    sensors, lines, pixels = z.shape
    rows, columns = lines // BLOCK_PIXELS, pixels // BLOCK_PIXELS
    whole = z[:, : rows * BLOCK_PIXELS, : columns * BLOCK_PIXELS]
    blocks = whole.reshape(sensors, rows, BLOCK_PIXELS, columns, BLOCK_PIXELS)
    return (
        np.bincount(place),
        blocks.mean(axis=(2, 4)),
        np.square(blocks).sum(axis=(2, 4)),
        blocks.min(axis=(2, 4)),
        blocks.max(axis=(2, 4)),
        z.sum(axis=1),
        z.sum(axis=2),
    )


def ssim_opencv(one: NDArray[np.float32], other: NDArray[np.float32], *, top: float) -> float:
    """Return the mean structural similarity of two images by OpenCV's Gaussian windows (Wang 2004, equation 13)."""
    window = (SSIM_WINDOW, SSIM_WINDOW)

    def smooth(image: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.GaussianBlur(image, window, SSIM_SIGMA_PX), np.float32)

    c1, c2 = (0.01 * top) ** 2, (0.03 * top) ** 2
    mean, mean_other = smooth(one), smooth(other)
    product = mean * mean_other
    squares = mean * mean + mean_other * mean_other
    covariance = smooth(one * other) - product
    variances = smooth(one * one) + smooth(other * other) - squares
    return float(((2 * product + c1) * (2 * covariance + c2) / ((squares + c1) * (variances + c2))).mean())


def _scikit_image(
    measured: NDArray[np.float32], expected: NDArray[np.float32], top: float
) -> dict[str, Callable[[], object]]:
    try:
        from skimage.metrics import structural_similarity  # imported late: only this row needs it
    except ImportError:
        return {}
    return {
        SSIM_SCIKIT: lambda: structural_similarity(
            measured,
            expected,
            gaussian_weights=True,
            sigma=SSIM_SIGMA_PX,
            use_sample_covariance=False,
            data_range=top,
        )
    }


def ways(
    measured_dn: NDArray[np.uint16], prediction: Prediction, *, top_codes_dn: Sequence[int]
) -> dict[str, Callable[[], object]]:
    """Return the timed functions by name, on (sensors, lines, pixels) arrays.

    Baselines use the first sensor's image.
    """
    expected, variance = prediction.expected_dn, prediction.variance_dn2
    both = np.concatenate([image.ravel().view(np.uint16) for image in (measured_dn, expected)])
    numbers = both[: both.size // 4 * 4].view(np.uint64)
    image, model = measured_dn[0].astype(np.float32), np.ascontiguousarray(expected[0])
    whole = np.rint(expected[0]).astype(np.uint16)
    top = float(top_codes_dn[0])
    return {
        READ_LIMIT: lambda: read(numbers),
        COMPARE_AND_GATHER: lambda: gather(
            measured_dn, expected, variance, top_codes_dn=top_codes_dn, seed=1, threads=1
        ),
        LEAST_WORK: _least_work(measured_dn, prediction, top_codes_dn),
        NUMPY: lambda: numpy_statistics(measured_dn, prediction),
        "absolute difference alone, OpenCV": lambda: cv2.absdiff(measured_dn[0], whole),
        "SSIM, OpenCV": lambda: ssim_opencv(image, model, top=top),
        **_scikit_image(image, model, top),
    }


def _least_work(
    measured_dn: NDArray[np.uint16], prediction: Prediction, top_codes_dn: Sequence[int]
) -> Callable[[], object]:
    """Return the function of ``LEAST_WORK``."""
    expected, variance = prediction.expected_dn, prediction.variance_dn2
    scales = [
        Scale.of(top_code_dn=top, least_variance_dn2=float(of_sensor.min()))
        for top, of_sensor in zip(top_codes_dn, variance, strict=True)
    ]
    codes = [compact(expected[sensor], variance[sensor], scale) for sensor, scale in enumerate(scales)]
    lines = range(measured_dn.shape[1])
    return lambda: [
        compare(
            measured_dn[sensor], *codes[sensor], scale=scale, sensor=sensor, lines=lines, seed=1, dither=False
        )
        for sensor, scale in enumerate(scales)
    ]


def in_turns(
    works: Mapping[str, Callable[[], object]], repeats: int, *, clock: Callable[[], float]
) -> dict[str, NDArray[np.float64]]:
    """Return the time of each function by a clock, (repeats,) [s], all in turns, after one turn that is not counted."""
    times: dict[str, list[float]] = {name: [] for name in works}
    for turn in range(repeats + 1):
        for name, work in works.items():
            started = clock()
            work()
            if turn:
                times[name].append(clock() - started)
    return {name: np.array(taken) for name, taken in times.items()}


def compare_rows(
    measured_dn: NDArray[np.uint16],
    prediction: Prediction,
    *,
    top_codes_dn: Sequence[int],
    repeats: int = REPEATS,
) -> list[CompareRow]:
    """Time every method in turns, ``repeats`` times, after one turn that is not counted; one core.

    measured_dn, prediction: (sensors, lines, pixels) of a page's area, contiguous, larger than the processor's caches
    if reading memory is to be the limit.
    """
    functions = ways(measured_dn, prediction, top_codes_dn=top_codes_dn)
    of_sensor = measured_dn[0].size / 1e6
    size = dict.fromkeys(functions, measured_dn.size / 1000000.0)
    size |= {name: of_sensor for name in functions if "OpenCV" in name or "scikit" in name}
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        times = in_turns(functions, repeats, clock=time.thread_time)
    finally:
        cv2.setNumThreads(threads)
    speeds = {name: size[name] / taken for name, taken in times.items()}
    limit, ours = (float(np.median(speeds[name])) for name in (READ_LIMIT, COMPARE_AND_GATHER))
    return [
        CompareRow(
            name=name,
            mpx_per_cpu_s=round(float(np.median(speed)), 1),
            lowest_mpx_per_cpu_s=round(float(speed.min()), 1),
            highest_mpx_per_cpu_s=round(float(speed.max()), 1),
            of_read_limit=round(float(np.median(speed)) / limit, 4),
            speed_ratio=round(ours / float(np.median(speed)), 1),
        )
        for name, speed in speeds.items()
    ]
