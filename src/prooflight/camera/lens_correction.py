"""Correction for the part of the round lens's blur that a short separable footprint misses.

Diffraction scatters a little light far: 2 / (pi^3 f_c d) of an edge lies beyond d pixels, f_c the cut-off in
cycles a pixel, in rings that are no product of two line spreads. Prediction filters with a short footprint
and then adds the missing part as small weights at the camera's own resolution: near neighbours one by one,
farther ones in blocks, since the remainder is smooth there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.camera.spectral_blur import spectral_blur
from prooflight.pages.lens_correction import correction_frequencies, correction_to
from prooflight.pages.sampling import transfer

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import LineSensor
    from prooflight.pages.lens_correction import LensCorrection
    from prooflight.pages.sampling import Footprint

SHORT_REACH_PIXELS: Final = 1.75
"""Reach of the separable footprint that is corrected.

Pixel and motion reach 1 along; of reaches from 1.5 to 2.5 all leave about as little after correction (0.12 to
0.22 sigma at text edges), and filtering costs in proportion to the reach.
"""


def lens_correction(camera: Camera, sensor: LineSensor, footprint: Footprint) -> LensCorrection:
    """Compute the correction that turns ``footprint`` into the exact camera's (``correction_to``).

    White paper's light stands for every colour's (``spectral_blur``). Lines may lie further apart than pixels
    (binning, other speeds): weights are of lines along and pixels across.
    """
    frequency = correction_frequencies()
    per_line = frequency / (camera.line_pitch_mm / camera.pixel_pitch_mm)
    exact, separable = transfers(camera, sensor, footprint, per_line, frequency)
    return correction_to(exact, separable)


def transfers(
    camera: Camera,
    sensor: LineSensor,
    footprint: Footprint,
    fy: NDArray[np.float64],
    fx: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the exact and the separable transfer function, (along, across) at frequencies fy and fx [cycles/pixel]."""
    blur = spectral_blur(camera, sensor)
    pitch = camera.line_pitch_mm / camera.pixel_pitch_mm
    along = np.sinc(fy) * np.sinc(fy * pitch)
    along *= np.sinc(fy * sensor.tdi_stages * abs(camera.travel_pixels - 1))
    steps = np.hypot(fx, fy[:, None]) * ((blur.shapes.shape[1] - 1) / blur.cutoff_per_pixel)
    # What a coarse lens cuts off within the scan's own frequencies is 0: the last shape's.
    lens = blur.shapes[0][np.minimum(np.rint(steps), blur.shapes.shape[1] - 1).astype(np.int64)]
    exact = lens * np.sinc(fx) * along[:, None]
    reach = footprint.reach_mm / camera.pixel_pitch_mm
    separable = transfer(footprint.along, reach, fy)[:, None] * transfer(footprint.across, reach, fx)
    return exact, separable
