"""What a short separable footprint misses of the round lens, as small weights at the camera's own resolution.

Diffraction scatters a little light far: 2 / (pi^3 f_c d) of an edge lies beyond d pixels, f_c the cut-off in cycles a
pixel, in rings that are no product of two line spreads. Prediction filters with a short footprint and then adds what
that misses: the neighbours one by one, what is farther in blocks, as smooth as it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.camera.spectral_blur import spectral_blur
from prooflight.kernels.prediction.lens_correction import FAR_BLOCK, FARTHER_BLOCK, NEAR_REACH
from prooflight.pages.sampling import LensCorrection, transfer

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import LineSensor
    from prooflight.pages.sampling import Footprint

SHORT_REACH_PIXELS: Final = 1.75
"""Of the footprint that is corrected. Pixel and motion reach 1 along; of reaches from 1.5 to 2.5 all leave about as
little after correction (0.12 to 0.22 sigma at text edges), and filtering costs in proportion to it."""
FAR_REACH: Final = 2
FARTHER_REACH: Final = 3
"""Blocks to each side; beyond 3.5 x 16 pixels lies 0.02 % of an edge."""
_PERIOD: Final = 256  # pixels; frequencies are a cycle in so many apart
# of the mean square: keeps blocks' weights small, whose own aliasing the fit does not see
_RIDGE: Final = 1e-3
_EVEN_LIGHT: Final = 100.0  # weight of frequency 0 over that of its neighbours


def lens_correction(camera: Camera, sensor: LineSensor, footprint: Footprint) -> LensCorrection:
    """The correction that makes ``footprint`` the exact camera's, by least squares over the frequencies of a scan.

    Errors are weighted by 1 / f, as edges have it. White paper's light stands for every colour's (``spectral_blur``).
    Lines may lie further apart than pixels (binning, other speeds): weights are of lines along and pixels across.
    """
    frequency = np.arange(_PERIOD // 2 + 1) / _PERIOD
    per_line = frequency / (camera.line_pitch_mm / camera.pixel_pitch_mm)
    exact, ours = transfers(camera, sensor, footprint, per_line, frequency)
    radius = np.hypot(frequency, frequency[:, None])
    weight = 1 / np.maximum(radius, 1 / _PERIOD)
    weight /= weight.mean()
    weight[0, 0] *= _EVEN_LIGHT
    parts = [_cosines(NEAR_REACH, 1, frequency), _cosines(FAR_REACH, FAR_BLOCK, frequency)]
    parts.append(_cosines(FARTHER_REACH, FARTHER_BLOCK, frequency))
    basis = np.concatenate([part.reshape(-1, exact.size) for part in parts]) * (ours * weight).ravel()
    sizes = np.concatenate([_multiplicity(part.shape[0]).ravel() for part in parts])
    normal = basis @ basis.T + np.diag(_RIDGE * exact.size * sizes)
    found = np.linalg.solve(normal, basis @ ((exact - ours) * weight).ravel())
    ends = np.cumsum([part.shape[0] ** 2 for part in parts])[:-1]
    near, far, farther = (
        _unfolded(quadrant.reshape((round(quadrant.size**0.5),) * 2)) for quadrant in np.split(found, ends)
    )
    near[NEAR_REACH, NEAR_REACH] -= near.sum() + far.sum() + farther.sum() - 1
    return LensCorrection(
        near=near.astype(np.float32), far=far.astype(np.float32), farther=farther.astype(np.float32)
    )


def transfers(
    camera: Camera,
    sensor: LineSensor,
    footprint: Footprint,
    fy: NDArray[np.float64],
    fx: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Exact and separable transfer functions, (along, across) at frequencies fy and fx [cycles/pixel]."""
    blur = spectral_blur(camera, sensor)
    pitch = camera.line_pitch_mm / camera.pixel_pitch_mm
    along = np.sinc(fy) * np.sinc(fy * pitch)
    along *= np.sinc(fy * sensor.tdi_stages * abs(camera.travel_pixels - 1))
    steps = np.hypot(fx, fy[:, None]) * ((blur.shapes.shape[1] - 1) / blur.cutoff_per_pixel)
    # What a coarse lens cuts off within the scan's own frequencies is 0: the last shape's.
    lens = blur.shapes[0][np.minimum(np.rint(steps), blur.shapes.shape[1] - 1).astype(np.int64)]
    exact = lens * np.sinc(fx) * along[:, None]
    reach = footprint.reach_mm / camera.pixel_pitch_mm
    ours = transfer(footprint.along, reach, fy)[:, None] * transfer(footprint.across, reach, fx)
    return exact, ours


def _cosines(reach: int, block: int, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transfer functions of symmetric weights of blocks: (reach + 1, reach + 1, frequencies, frequencies)."""
    centred = np.arange(block) - (block - 1) / 2
    mean = np.cos(2 * np.pi * frequency[:, None] * centred).mean(axis=1)
    places = np.arange(reach + 1)[:, None]
    # A block's mean is one box, linear interpolation between blocks two more.
    one = (2 - (places == 0)) * np.cos(2 * np.pi * places * block * frequency) * mean**3
    return np.asarray(one[:, None, :, None] * one[None, :, None, :])


def _multiplicity(count: int) -> NDArray[np.float64]:
    """How many weights each of a quadrant's stands for."""
    sides = np.where(np.arange(count) == 0, 1.0, 2.0)
    return np.outer(sides, sides)


def _unfolded(quadrant: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n + 1, n + 1) -> (2 n + 1, 2 n + 1)."""
    half = np.concatenate([quadrant[:0:-1], quadrant])
    return np.concatenate([half[:, :0:-1], half], axis=1)
