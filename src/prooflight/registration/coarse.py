"""Coarse registration to about a pixel over the whole search range, at an eighth of the camera's resolution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from scipy import fft

from prooflight.kernels.registration.coarse import SHRINK, square_means
from prooflight.registration.pose import Pose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry

EDGE_LIMIT: Final = 0.15
"""Limit of the slopes: a page's edge against the backing must not drown its content. [white/coarse pixel]"""
PAD: Final = 20
"""Width of the frame of zeros around the picture, so that a shift of 12 mm does not wrap around. [coarse
pixels]"""
LEAST_EDGE: Final = 0.01
MOST_POINTS: Final = 2048
POINTS_PER_ROW: Final = 256
STEPS: Final = 5
SPREAD: Final = 0.03
"""Difference of two good pictures of one page in flat areas, from the gain of ink and lamp. [white]"""
START_SD: Final = np.array([0.5, 0.5, 0.005, 5e-4, 5e-4, 0.1, 0.1])
"""Standard deviations of the error of a start, all steps together: pose, level and gain. [mm, radian, -,
white, -]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoarsePage:
    """A design in the form that the coarse search uses."""

    picture: NDArray[np.float32]
    """Light signal as a share of white, mean over the sensors, (rows, columns)."""
    spectrum: NDArray[np.complex64]
    """Conjugate Fourier transform of the picture's edges, across + i along."""
    energy: float
    """Energy of the picture's edges."""
    pitch_mm: tuple[float, float]
    """Pitch of the coarse pixels, across and along."""
    first_mm: tuple[float, float]
    """Centre of the first coarse pixel, x and y from the page's centre."""
    points: NDArray[np.int64]
    """Flat indices of pixels at edges, (points,)."""
    points_mm: NDArray[np.float64]
    """Their x and y from the page's centre, (2, points)."""
    model: NDArray[np.float64]
    """Derivatives of the signal there by the pose's five numbers, and by level and gain, (points, 7)."""


def shrunk(
    images: NDArray[np.uint16] | NDArray[np.float32], sensors: Sequence[SensorModel]
) -> NDArray[np.float32]:
    """Return means over 8 x 8 pixels of images (sensors, lines, pixels) [DN], columns corrected. [share of white]"""
    rows, columns = (extent // SHRINK for extent in images.shape[1:])
    total = np.zeros((rows, columns), np.float32)
    for image, sensor in zip(images, sensors, strict=True):
        small = np.empty((rows, columns), np.float32)
        square_means(image, small)
        offset, gain = (
            array[: columns * SHRINK].reshape(columns, SHRINK).mean(axis=1)
            for array in (sensor.column_offset_dn, sensor.column_gain)
        )
        total += (small - offset) / (gain * np.float32(sensor.white_dn * len(sensors)))
    return total


def coarse_page(
    prediction: Prediction,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    page_width_mm: float,
    page_height_mm: float,
) -> CoarsePage:
    """Return what the coarse search needs of a page, from its prediction at its nominal place."""
    picture = shrunk(prediction.expected_dn, sensors)
    edges = _edges(picture, picture.shape)
    across, along = np.gradient(picture, axis=1), np.gradient(picture, axis=0)
    strength = across**2 + along**2
    flat = strength.ravel()
    count = min(MOST_POINTS, int((flat > LEAST_EDGE**2).sum()))
    points = (
        np.sort(np.argpartition(-flat, min(count, len(flat) - 1))[:count]) if count else np.zeros(0, np.intp)
    )
    rows, columns = picture.shape
    x_mm = geometry.centres_x_mm(page_width_mm)[: columns * SHRINK].reshape(-1, SHRINK).mean(axis=1)
    y_mm = geometry.centres_y_mm(rows * SHRINK).reshape(-1, SHRINK).mean(axis=1)
    x_mm, y_mm = x_mm - page_width_mm / 2, y_mm - page_height_mm / 2
    x, y = (axis.ravel()[points] for axis in np.meshgrid(x_mm, y_mm))
    pitch_mm = SHRINK * geometry.pixel_pitch_mm, SHRINK * geometry.line_pitch_mm
    gx, gy = (-slope.ravel()[points] / pitch for slope, pitch in zip((across, along), pitch_mm, strict=True))
    model = np.stack([gx, gy, gy * x - gx * y, gx * x, gy * y, np.ones_like(gx), picture.ravel()[points]], 1)
    return CoarsePage(
        picture=picture,
        spectrum=np.conj(fft.fft2(edges)).astype(np.complex64),
        energy=float((np.abs(edges) ** 2).sum()),
        pitch_mm=pitch_mm,
        first_mm=(float(x_mm[0]), float(y_mm[0])),
        points=points,
        points_mm=np.stack([x, y]),
        model=model,
    )


def _edges(picture: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.complex64]:
    """Return the slopes across + i along, limited, of the first ``shape`` of the picture in a frame of zeros."""
    picture = picture[: shape[0], : shape[1]]
    across = np.clip(np.gradient(picture, axis=1), -EDGE_LIMIT, EDGE_LIMIT)
    along = np.clip(np.gradient(picture, axis=0), -EDGE_LIMIT, EDGE_LIMIT)
    framed = np.zeros([fft.next_fast_len(extent + 2 * PAD) for extent in shape], np.complex64)
    framed[: picture.shape[0], : picture.shape[1]] = across + 1j * along
    return framed


def peaks(
    page: CoarsePage, scan: NDArray[np.float32], *, reach_mm: float, turn: float, most: int
) -> list[tuple[float, Pose]]:
    """Return the greatest maxima of the correlation of edges within ``reach_mm``, best first.

    Each comes with its height (1 for identical pictures) and with the pose of a page that is turned by
    ``turn`` and lies at the maximum.
    """
    edges = _edges(scan, page.picture.shape)
    pitch_x, pitch_y = page.pitch_mm
    far_x, far_y = (min(int(np.ceil(reach_mm / pitch)), PAD - 2) for pitch in (pitch_x, pitch_y))
    rows, columns = (np.arange(-far - 1, far + 2) for far in (far_y, far_x))
    # The inverse transform of both axes, but of rows within reach alone.
    along = fft.ifft(fft.fft2(edges) * page.spectrum, axis=0, norm="forward")[rows]
    near = fft.ifft(along * np.float32(1 / edges.size), axis=1, norm="forward")[:, columns].real
    near /= np.sqrt(page.energy * float((np.abs(edges) ** 2).sum())) + 1e-12
    maxima: list[tuple[float, Pose]] = []
    inner = near[1:-1, 1:-1]
    summit = inner >= cv2.dilate(near, np.ones((3, 3), np.uint8))[1:-1, 1:-1]
    for row, column in sorted(np.argwhere(summit), key=lambda at: -inner[at[0], at[1]])[:most]:
        x = column - far_x + _vertex(near[row + 1, column : column + 3])
        y = row - far_y + _vertex(near[row : row + 3, column + 1])
        pose = Pose(x_mm=float(x) * pitch_x, y_mm=float(y) * pitch_y, turn=turn)
        maxima.append((float(inner[row, column]), pose))
    return maxima


def _vertex(three: NDArray[np.float32]) -> float:
    """Return the position of the maximum of a parabola through three values, relative to the middle one."""
    bend = 2 * three[1] - three[0] - three[2]
    return float(np.clip((three[2] - three[0]) / (2 * bend), -0.5, 0.5)) if bend > 0 else 0.0


def refined(
    page: CoarsePage, scan: NDArray[np.float32], pose: Pose, *, holed: NDArray[np.bool_] | None = None
) -> Pose:
    """Refine a pose on the pixels at edges.

    Inverse compositional Lucas-Kanade (Baker and Matthews 2004) of pose, level and gain with Cauchy weights.
    The scan is interpolated linearly, which is enough for a search.

    Parameters
    ----------
    page : the design
    scan : (rows, columns) coarse picture of the scan, as a share of white
    pose : where to start
    holed : (rows,) whether a row of the scan is missing and is left out; None if none is
    """
    if page.points.size < 8:
        return pose
    (x, y), (first_x, first_y), (pitch_x, pitch_y) = page.points_mm, page.first_mm, page.pitch_mm
    expected = page.picture.ravel()[page.points]
    begin, precision = pose, 1 / START_SD**2
    for _ in range(STEPS):
        move_x, move_y = pose.displacement_mm(x, y)
        rows = (y + move_y - first_y) / pitch_y
        seen = _read(scan, (x + move_x - first_x) / pitch_x, rows)
        error = seen - expected
        spread = max(1.4826 * float(np.median(np.abs(error - np.median(error)))), SPREAD)
        weight = 1 / (1 + (error / (2 * spread)) ** 2) / spread**2
        if holed is not None:
            above, below = (
                np.clip(end(rows).astype(np.intp), 0, holed.size - 1) for end in (np.floor, np.ceil)
            )
            weight = np.where(holed[above] | holed[below], 0.0, weight)
        weighted = page.model * weight[:, None]
        # Neighbouring coarse pixels err together: count one in four.
        further = np.append(pose.numbers - begin.numbers, (0.0, 0.0))
        step = np.linalg.solve(
            page.model.T @ weighted / 4 + np.diag(precision), weighted.T @ error / 4 - precision * further
        )
        pose = pose.moved(np.asarray(step[:5], np.float64))
    return pose


def _read(
    scan: NDArray[np.float32], columns: NDArray[np.float64], rows: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Interpolate the coarse scan linearly; beyond its border, the value at the border holds."""
    maps = np.zeros((2, columns.size + -columns.size % POINTS_PER_ROW), np.float32)
    maps[:, : columns.size] = columns, rows
    across, along = maps.reshape(2, -1, POINTS_PER_ROW)
    read = cv2.remap(scan, across, along, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return read.ravel()[: columns.size]
