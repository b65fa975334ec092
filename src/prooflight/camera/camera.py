"""Camera of light, lens and line sensors: its response to a uniform colour and its footprint on a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prooflight import spectra
from prooflight.camera.sensor import FixedPattern, LineSensor, Noise, read_out
from prooflight.pages.sampling import Footprint

if TYPE_CHECKING:
    from prooflight.camera.optics import Lens, Light

REACH_PIXELS = 4.0
"""Distance from a footprint's centre at which it is cut; diffraction leaves 0.2 % of an edge beyond.

The remainder is 2 / (pi^3 f_c d), f_c the cut-off in cycles a pixel and d the distance.
"""
FOOTPRINT_STEPS_PER_PIXEL = 64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorResponse:
    """Response of one sensor to uniform colours on the axis.

    Every array has the shape of the colours (...).
    """

    name: str
    irradiance_photons: NDArray[np.float64]
    """Irradiance (..., 36), before the lens's blur. [photons s-1 m-2 nm-1]"""
    illuminance_lux: NDArray[np.float64]
    electrons: NDArray[np.float64]
    """Photo-electrons, without dark signal. [e-]"""
    volts: NDArray[np.float64]
    """Photo-electrons times conversion gain, without dark signal. [V]"""
    dn_mean: NDArray[np.float64]
    """Mean signal with dark signal and black level, after clipping, unrounded. [DN]"""
    dn_sigma_temporal: NDArray[np.float64]
    """Standard deviation from line to line in one column: shot, dark, read, rounding. [DN]"""
    dn_sigma_total: NDArray[np.float64]
    """Standard deviation over lines and columns, PRNU and DSNU included. [DN]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Camera:
    """Light, lens and one or more line sensors that see the same line of the page."""

    light: Light
    lens: Lens
    sensors: tuple[LineSensor, ...]
    speed_mm_s: float | None = None
    """Speed of the paper; None: in step with the sensor, so that lines are as far apart as pixels are wide. [mm/s]"""
    binning_along: int = 1

    def __post_init__(self) -> None:
        if not self.sensors:
            message = "a camera needs at least one sensor"
            raise ValueError(message)
        first = self.sensors[0]
        for other in self.sensors[1:]:
            for field in ("pixels", "pixel_pitch_um", "line_rate_hz"):
                if getattr(other, field) != getattr(first, field):
                    message = f"sensors must share {field}: {first.name} and {other.name} differ"
                    raise ValueError(message)

    @property
    def pixel_pitch_mm(self) -> float:
        """Return the pixel pitch projected onto the page. [mm]"""
        return self.sensors[0].pixel_pitch_um * 1e-3 / self.lens.magnification

    @property
    def line_travel_mm(self) -> float:
        """Return the distance that the page moves in one line of the sensor. [mm]"""
        if self.speed_mm_s is None:
            return self.pixel_pitch_mm
        return self.speed_mm_s / self.sensors[0].line_rate_hz

    @property
    def travel_pixels(self) -> float:
        """Return the distance that the page moves in one line, in units of a pixel's width on the page. [-]"""
        return self.line_travel_mm / self.pixel_pitch_mm

    def smear_pixels(self, sensor: LineSensor) -> float:
        """Return the width of the box by which TDI smears where paper and charge are out of step. [pixel]

        It is the limit of many stages.
        """
        return sensor.tdi_stages * abs(self.travel_pixels - 1)

    @property
    def line_pitch_mm(self) -> float:
        """Return the distance between neighbouring lines of a scan on the page, after binning. [mm]"""
        return self.line_travel_mm * self.binning_along

    @property
    def field_mm(self) -> float:
        """Return the width of paper that the sensors see. [mm]"""
        return self.sensors[0].pixels * self.pixel_pitch_mm

    def irradiance_photons(self, reflectance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the on-axis image irradiance of uniform reflectances, both (..., 36). [photons s-1 m-2 nm-1]"""
        return reflectance * (self.light.radiance_photons * self.lens.irradiance_per_radiance)

    def white_mtf(self, sensor: LineSensor, frequency_per_mm: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the lens's MTF (...) for white paper's photo-electrons, weighted by light x QE.

        frequency_per_mm: (...) [cycles/mm on the sensor]. NaN if ``sensor`` is not sensitive to this light.
        """
        weight = self.light.radiance_photons * sensor.quantum_efficiency
        mtf = self.lens.mtf(frequency_per_mm[..., None], wave_nm=spectra.WAVE_NM)
        return np.asarray(mtf @ (weight / weight.sum()), dtype=np.float64)

    def column_light(self) -> NDArray[np.float64]:
        """Return the relative illumination of each column by cos^4, (pixels,), 1 on the axis."""
        sensor = self.sensors[0]
        height_mm = (np.arange(sensor.pixels) + 0.5 - sensor.pixels / 2) * sensor.pixel_pitch_um * 1e-3
        return self.lens.relative_illumination(height_mm)

    def footprint(self, sensor: LineSensor, *, reach_pixels: float = REACH_PIXELS) -> Footprint:
        """Return the footprint of one pixel of ``sensor`` on the page: lens, aperture, motion, TDI smear, binning.

        The lens's line-spread function is the one of white paper's photo-electrons: diffraction MTFs weighted
        by light x QE, cut at ``reach_pixels`` and scaled back to 1. The aperture is the whole pixel: its fill
        factor scales light, not its shape (ISETCam's box).
        """
        # Binned lines follow one another without a gap, so their motion is one box.
        along_widths = (1.0, self.binning_along * self.travel_pixels, self.smear_pixels(sensor))
        steps = np.ceil((reach_pixels + sum(along_widths) - 2) * FOOTPRINT_STEPS_PER_PIXEL)
        reach = float(steps / FOOTPRINT_STEPS_PER_PIXEL)
        across, along = (_cumulative_spread(self, sensor, widths, reach) for widths in ((1.0,), along_widths))
        return Footprint(reach_mm=reach * self.pixel_pitch_mm, across=across, along=along)


def _cumulative_spread(
    camera: Camera, sensor: LineSensor, widths: Sequence[float], reach: float
) -> NDArray[np.float64]:
    """Integrate a line-spread function over -reach .. reach pixels, from 0 to 1; lens and boxes of given widths.

    It is formed in the frequency domain on a window eight times as long, so that the tails that wrap around
    are negligible; a box of width w pixels has the transfer function sinc(w f).
    """
    steps = 2 * round(reach * FOOTPRINT_STEPS_PER_PIXEL)
    size = 8 * steps
    frequency = np.fft.rfftfreq(size, d=1 / FOOTPRINT_STEPS_PER_PIXEL)  # cycles per pixel
    mtf = camera.white_mtf(sensor, frequency / (sensor.pixel_pitch_um * 1e-3))
    for width in widths:
        mtf = mtf * np.sinc(width * frequency)
    spread = np.fft.fftshift(np.fft.irfft(mtf, size))
    middle = spread[size // 2 - steps // 2 : size // 2 + steps // 2 + 1].clip(min=0.0)
    cumulative = np.concatenate([[0.0], np.cumsum((middle[1:] + middle[:-1]) / 2)])
    return cumulative / cumulative[-1]


def respond(camera: Camera, reflectance: NDArray[np.float64]) -> tuple[SensorResponse, ...]:
    """Return the response of each sensor to uniform reflectances (..., 36), on the axis of the lens."""
    irradiance = camera.irradiance_photons(reflectance)
    lux = (irradiance / spectra.photons_per_joule()) @ (
        spectra.luminous_efficiency() * (spectra.LUMINOUS_EFFICACY_LM_W * spectra.STEP_NM)
    )
    answers = []
    for sensor in camera.sensors:
        electrons = sensor.electrons(irradiance)
        mean, temporal = sensor.dn_moments(electrons, sensor.variance_temporal_e2(electrons))
        _, total = sensor.dn_moments(electrons, sensor.variance_total_e2(electrons))
        answers.append(
            SensorResponse(
                name=sensor.name,
                irradiance_photons=irradiance,
                illuminance_lux=lux,
                electrons=electrons,
                volts=electrons * (sensor.conversion_gain_uv_per_e * 1e-6),
                dn_mean=mean,
                dn_sigma_temporal=temporal,
                dn_sigma_total=total,
            )
        )
    return tuple(answers)


def expose_flat(
    camera: Camera,
    reflectance: NDArray[np.float64],
    *,
    lines: int,
    patterns: Sequence[FixedPattern],
    rng: np.random.Generator,
    noise: Noise = Noise.ALL,
) -> NDArray[np.uint16]:
    """Simulate a scan of one uniform colour (36,), zeros for a covered lens; (sensors, lines, pixels). [DN]"""
    column_light = camera.column_light()
    scan = []
    for sensor, pattern in zip(camera.sensors, patterns, strict=True):
        line_e = sensor.electrons(camera.irradiance_photons(reflectance)) * column_light
        electrons = np.broadcast_to(line_e, (lines, sensor.pixels))
        scan.append(read_out(sensor, electrons, pattern=pattern, rng=rng, noise=noise))
    return np.stack(scan)


def with_pixels(camera: Camera, pixels: int) -> Camera:
    """Return the same camera with longer or shorter line sensors."""
    return replace(camera, sensors=tuple(replace(sensor, pixels=pixels) for sensor in camera.sensors))
