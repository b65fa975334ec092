"""Correction for the part of the round lens's blur that a short separable footprint misses.

Diffraction scatters a little light far: 2 / (pi^3 f_c d) of an edge lies beyond d pixels, f_c the cut-off in
cycles a pixel, in rings that are no product of two line spreads. Prediction filters with a short footprint
and then adds the missing part as small weights at the camera's own resolution: near neighbours one by one,
farther ones in blocks, since the remainder is smooth there. The diffraction at 36 wavelengths is approximated at low
rank, so that a page is filtered a few times, not 36.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight import spectra
from prooflight.pages.lens_correction import LensCorrection, correction_frequencies, correction_to
from prooflight.pages.sampling import Footprint, transfer

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import LineSensor

SHORT_REACH_PIXELS: Final = 1.75
"""Reach of the separable footprint that is corrected.

Pixel and motion reach 1 along; of reaches from 1.5 to 2.5 all leave about as little after correction (0.12 to
0.22 sigma at text edges), and filtering costs in proportion to the reach.
"""
RANK = 3
"""Number of shapes that replace the 36 MTFs.

For the paper's rig an edge then errs by less than 3e-5 of white.
"""
_SHAPE_STEPS = 2**18  # frequencies at which shapes are tabulated: the nearest then errs by 1e-5
_FITTED_STEPS = 4096


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectralBlur:
    """A sensor's 36 diffraction MTFs, weighted by its electrons of each band, as a short sum of shapes.

    Electrons at frequency f of a pattern of reflectance R: sum over k of (R @ bands_e[:, k]) x shapes[k](f).
    """

    bands_e: NDArray[np.float64]
    """Weights (36, rank); the first column is the electrons of each band, so it alone gives uniform light. [e-]"""
    shapes: NDArray[np.float32]
    """Shapes (rank, steps) at even steps from 0 to the cut-off; the first is 1 at frequency 0, the others 0. [-]"""
    cutoff_per_pixel: float
    """Frequency beyond which the lens passes nothing, at any wavelength. [cycles/camera pixel]"""
    truncation: float
    """Bound on the error of a pixel near a step edge between any reflectances in 0..1, as a share of white. [-]"""


def spectral_blur(camera: Camera, sensor: LineSensor, *, rank: int = RANK) -> SpectralBlur:
    """Reduce the MTFs of the lens (36 bands by frequency) to ``rank`` shapes.

    The first is white's mean MTF, which keeps all light; the differences of the bands from it are cut after
    the greatest ``rank - 1`` singular values (Eckart and Young 1936: the best in least squares), frequencies
    weighted by 1/f as in the spectrum of an edge.
    """
    per_pixel = sensor.pixel_pitch_um * 1e-3
    cutoff = float(per_pixel / (spectra.WAVE_NM.min() * 1e-6 * camera.lens.working_f_number))
    frequency = np.linspace(0.0, cutoff, _SHAPE_STEPS)
    band_e = sensor.electrons(camera.irradiance_photons(np.eye(spectra.BANDS)))
    coarse = (np.arange(_FITTED_STEPS) + 0.5) * (cutoff / _FITTED_STEPS)
    mtf = camera.lens.mtf(coarse / per_pixel, wave_nm=spectra.WAVE_NM[:, None])
    mean = band_e @ mtf / band_e.sum()
    difference = band_e[:, None] * (mtf - mean)
    left, value, right = np.linalg.svd(difference / coarse, full_matrices=False)
    singular = rank - 1
    right = right[:singular] * coarse
    bands_e = np.concatenate([band_e[:, None], left[:, :singular] * value[:singular]], axis=1)
    lost = difference - bands_e[:, 1:] @ right
    # The worst reflectance has 1 where the error is of one sign and 0 elsewhere; sinc(f) / (pi f) is an edge seen
    # through a pixel's aperture.
    worst = np.maximum(lost.clip(min=0).sum(axis=0), (-lost).clip(min=0).sum(axis=0)) / band_e.sum()
    truncation = (worst * np.abs(np.sinc(coarse)) / (np.pi * coarse)).sum() * (cutoff / _FITTED_STEPS)
    knots = np.concatenate([[0.0], coarse])  # at frequency 0 the mean is 1 and the others are 0
    shapes = np.stack(
        [
            np.interp(frequency, knots, [at_zero, *shape])
            for at_zero, shape in zip((1.0, *[0.0] * singular), (mean, *right), strict=True)
        ]
    )
    shapes[:, -1] = 0.0
    return SpectralBlur(
        bands_e=bands_e,
        shapes=shapes.astype(np.float32),
        cutoff_per_pixel=cutoff,
        truncation=float(truncation),
    )
