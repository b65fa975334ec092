"""Where a page lies to about a pixel, however far it is off: its picture at an eighth of the camera's resolution."""

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
"""Steeper edges count as this: a page's edge against the backing must not drown its content. [white/coarse pixel]"""
PAD: Final = 20
"""Coarse pixels of nothing around the picture, so that a shift of 12 mm does not wrap around."""
LEAST_EDGE: Final = 0.01
MOST_POINTS: Final = 2048
POINTS_PER_ROW: Final = 256
STEPS: Final = 5
SPREAD: Final = 0.03
"""What two good pictures of one page differ by at flat places: gain of ink and lamp. [white]"""
START_SD: Final = np.array([0.5, 0.5, 0.005, 5e-4, 5e-4, 0.1, 0.1])
"""Of what a start may be wrong by, all steps together: pose, level and gain. [mm, radian, -, white, -]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoarsePage:
    """A design as the coarse search needs it."""

    picture: NDArray[np.float32]
    """(rows, columns) light signal as a share of white, sensors averaged."""
    spectrum: NDArray[np.complex64]
    """Conjugate Fourier transform of its edges, across + i along."""
    energy: float
    """Of its edges."""
    pitch_mm: tuple[float, float]
    """Of its pixels, across and along."""
    first_mm: tuple[float, float]
    """Centre of the first of them, x and y from the page's centre."""
    points: NDArray[np.int64]
    """(points,) flat indices of pixels at edges."""
    points_mm: NDArray[np.float64]
    """(2, points) their x and y, from the page's centre."""
    model: NDArray[np.float64]
    """(points, 7) how the signal there changes with the pose's five numbers, and with level and gain."""


def shrunk(
    images: NDArray[np.uint16] | NDArray[np.float32], sensors: Sequence[SensorModel]
) -> NDArray[np.float32]:
    """Means over 8 x 8 pixels of (sensors, lines, pixels) [DN] as a share of white, columns evened out."""
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
    """What the search needs of a prediction of the page in its place."""
    picture = shrunk(prediction.expected_dn, sensors)
    edges = _edges(picture, picture.shape)
    across, along = np.gradient(picture, axis=1), np.gradient(picture, axis=0)
    strength = across**2 + along**2
    flat = strength.ravel()
    count = min(MOST_POINTS, int((flat > LEAST_EDGE**2).sum()))
    points = np.sort(np.argpartition(-flat, count)[:count]) if count else np.zeros(0, np.intp)
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
    """Slopes across + i along, limited, in a frame of zeros around the first ``shape`` of the picture."""
    picture = picture[: shape[0], : shape[1]]
    across = np.clip(np.gradient(picture, axis=1), -EDGE_LIMIT, EDGE_LIMIT)
    along = np.clip(np.gradient(picture, axis=0), -EDGE_LIMIT, EDGE_LIMIT)
    framed = np.zeros([fft.next_fast_len(extent + 2 * PAD) for extent in shape], np.complex64)
    framed[: picture.shape[0], : picture.shape[1]] = across + 1j * along
    return framed


def peaks(
    page: CoarsePage, scan: NDArray[np.float32], *, reach_mm: float, turn: float, most: int
) -> list[tuple[float, Pose]]:
    """The greatest maxima of the correlation of edges (1 for the very same) within ``reach_mm``, best first.

    With each the pose of a page that is turned so much, and lies there.
    """
    edges = _edges(scan, page.picture.shape)
    likeness = fft.ifft2(fft.fft2(edges) * page.spectrum).real
    likeness /= np.sqrt(page.energy * float((np.abs(edges) ** 2).sum())) + 1e-12
    pitch_x, pitch_y = page.pitch_mm
    far_x, far_y = (min(int(np.ceil(reach_mm / pitch)), PAD - 2) for pitch in (pitch_x, pitch_y))
    near = np.roll(likeness, (far_y + 1, far_x + 1), axis=(0, 1))[: 2 * far_y + 3, : 2 * far_x + 3]
    found: list[tuple[float, Pose]] = []
    inner = near[1:-1, 1:-1]
    summit = inner >= cv2.dilate(near, np.ones((3, 3), np.uint8))[1:-1, 1:-1]
    for row, column in sorted(np.argwhere(summit), key=lambda at: -inner[at[0], at[1]])[:most]:
        x = column - far_x + _vertex(near[row + 1, column : column + 3])
        y = row - far_y + _vertex(near[row : row + 3, column + 1])
        pose = Pose(x_mm=float(x) * pitch_x, y_mm=float(y) * pitch_y, turn=turn)
        found.append((float(inner[row, column]), pose))
    return found


def _vertex(three: NDArray[np.float32]) -> float:
    """Place of the maximum of a parabola through three values, from the middle one."""
    bend = 2 * three[1] - three[0] - three[2]
    return float(np.clip((three[2] - three[0]) / (2 * bend), -0.5, 0.5)) if bend > 0 else 0.0


def refined(
    page: CoarsePage, scan: NDArray[np.float32], pose: Pose, *, holed: NDArray[np.bool_] | None = None
) -> Pose:
    """A pose made to fit edge by edge. holed: (rows,) rows of the scan that say nothing; None: none.

    Inverse compositional Lucas-Kanade (Baker and Matthews 2004) of pose, level and gain with Cauchy weights; the scan
    is read between its pixels here, for this is only a search.
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
    """The coarse scan between its pixels, linear; beyond it, its edge."""
    short = -columns.size % POINTS_PER_ROW
    maps = [
        np.pad(axis, (0, short)).astype(np.float32).reshape(-1, POINTS_PER_ROW) for axis in (columns, rows)
    ]
    read = cv2.remap(scan, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return read.ravel()[: columns.size]
