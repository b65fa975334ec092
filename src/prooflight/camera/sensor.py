"""TDI line sensor: photons to electrons, volts and digital numbers, with the noise of each step."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Flag, auto
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from prooflight import spectra

LARGEST_BITS = 16
ROUNDING_DN2: Final = 1 / 12
"""Variance of rounding to integers: a uniform error of one code (EMVA 1288, quantisation noise). [DN^2]"""


class Noise(Flag):
    """Noise sources of one exposure, in the order in which they act."""

    SHOT = auto()
    READ = auto()
    PRNU = auto()
    DSNU = auto()
    NONE = 0
    TEMPORAL = SHOT | READ
    ALL = SHOT | READ | PRNU | DSNU


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineSensor:
    """Line sensor with time-delay integration (TDI), as characterised on the bench (paper, section 3.1).

    TDI sums ``tdi_stages`` exposures of the same line on the chip and reads once, so exposure is stages /
    line rate.
    """

    name: str
    pixels: int
    pixel_pitch_um: float
    fill_factor: float
    tdi_stages: int
    line_rate_hz: float
    conversion_gain_uv_per_e: float
    voltage_swing_v: float
    read_noise_e: float
    """Standard deviation of one read, after TDI summing. [e-]"""
    dark_current_e_per_s: float
    dsnu_e: float
    """Standard deviation of the fixed offset from column to column. [e-]"""
    prnu_percent: float
    """Standard deviation of the fixed gain from column to column. [%]"""
    bits: int
    black_level_dn: float
    """Offset that the camera adds before its converter. [DN]"""
    quantum_efficiency: NDArray[np.float64]
    """Quantum efficiency (36,), in electrons per photon."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "quantum_efficiency", spectra.on_grid(self.quantum_efficiency))
        positive = ("pixels", "pixel_pitch_um", "fill_factor", "tdi_stages", "line_rate_hz")
        for field in (*positive, "conversion_gain_uv_per_e", "voltage_swing_v", "bits"):
            if not getattr(self, field) > 0:
                message = f"{field} must be above 0, got {getattr(self, field)}"
                raise ValueError(message)
        for field in ("read_noise_e", "dark_current_e_per_s", "dsnu_e", "prnu_percent", "black_level_dn"):
            if getattr(self, field) < 0:
                message = f"{field} must not be negative, got {getattr(self, field)}"
                raise ValueError(message)
        if self.fill_factor > 1:
            message = f"fill_factor must be at most 1, got {self.fill_factor}"
            raise ValueError(message)
        if self.bits > LARGEST_BITS:
            message = f"bits must be at most {LARGEST_BITS}, got {self.bits}"
            raise ValueError(message)
        if (self.quantum_efficiency < 0).any() or (self.quantum_efficiency > 1).any():
            message = "quantum_efficiency must be in 0..1"
            raise ValueError(message)

    @property
    def exposure_s(self) -> float:
        """Return the time over which one line collects light. [s]"""
        return self.tdi_stages / self.line_rate_hz

    @property
    def dark_e(self) -> float:
        """Return the mean dark signal of one line. [e-]"""
        return self.dark_current_e_per_s * self.exposure_s

    @property
    def full_well_e(self) -> float:
        """Return the charge that fills the voltage swing. [e-]"""
        return self.voltage_swing_v / (self.conversion_gain_uv_per_e * 1e-6)

    @property
    def top_code_dn(self) -> int:
        """Return the greatest digital number, 2^bits - 1. [DN]"""
        return 2**self.bits - 1

    @property
    def dn_per_e(self) -> float:
        """Return the system gain, where one code is swing / 2^bits (ISETCam's rule). [DN/e-]"""
        return 2**self.bits / self.full_well_e

    def electrons(self, irradiance_photons: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean photo-electrons of one line, without dark signal.

        irradiance_photons (..., 36) [photons s-1 m-2 nm-1] -> (...) [e-]: sum(E QE dlambda) x pixel area x
        fill factor x exposure.
        """
        rate = irradiance_photons @ (self.quantum_efficiency * spectra.STEP_NM)
        area_m2 = (self.pixel_pitch_um * 1e-6) ** 2 * self.fill_factor
        return rate * area_m2 * self.exposure_s

    def quantise(self, volts: ArrayLike) -> NDArray[np.uint16]:
        """Convert volts to digital numbers: add black level, clip to the swing, round half up.

        The top code is 2^bits - 1.
        """
        step_v = self.voltage_swing_v / 2**self.bits
        raised = np.clip(np.asarray(volts) + self.black_level_dn * step_v, 0.0, self.voltage_swing_v)
        return np.minimum(np.floor(raised / step_v + 0.5), self.top_code_dn).astype(np.uint16)

    def variance_temporal_e2(self, electrons: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the variance from line to line before clipping: shot of signal and dark, and read. (...) [e-2]"""
        return electrons + self.dark_e + self.read_noise_e**2

    def variance_total_e2(self, electrons: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the variance over columns and lines combined: s1^2 (1 + p^2) + mu^2 p^2 + DSNU^2. (...) [e-2]"""
        p2 = (self.prnu_percent / 100) ** 2
        temporal = self.variance_temporal_e2(electrons)
        return temporal * (1 + p2) + (electrons + self.dark_e) ** 2 * p2 + self.dsnu_e**2

    def dn_moments(
        self, electrons: NDArray[np.float64], variance_e2: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and standard deviation of the digital number, given photo-electrons and their variance.

        Inputs and results have one shape (...). The mean is unrounded. Both are of the Gaussian clipped to
        the converter's range; the standard deviation includes the 1/12 DN^2 of rounding. [DN]
        """
        mean = (electrons + self.dark_e) * self.dn_per_e + self.black_level_dn
        clipped_mean, clipped_variance = clipped_gaussian(
            mean, np.sqrt(variance_e2) * self.dn_per_e, low=0.0, high=float(self.top_code_dn)
        )
        return clipped_mean, np.sqrt(clipped_variance + ROUNDING_DN2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixedPattern:
    """Fixed-pattern noise: differences from column to column that are the same on every line of every scan."""

    gain: NDArray[np.float64]
    """PRNU (pixels,), 1 on average. [-]"""
    offset_e: NDArray[np.float64]
    """DSNU (pixels,), 0 on average. [e-]"""


def draw_fixed_pattern(sensor: LineSensor, rng: np.random.Generator) -> FixedPattern:
    """Draw the fixed pattern of one specimen of the sensor: Gaussian PRNU and DSNU per column."""
    return FixedPattern(
        gain=1 + rng.standard_normal(sensor.pixels) * (sensor.prnu_percent / 100),
        offset_e=rng.standard_normal(sensor.pixels) * sensor.dsnu_e,
    )


def read_out(
    sensor: LineSensor,
    electrons: NDArray[np.float64],
    *,
    pattern: FixedPattern,
    rng: np.random.Generator,
    noise: Noise = Noise.ALL,
) -> NDArray[np.uint16]:
    """Read out lines of mean photo-electrons (lines, pixels) [e-] as digital numbers (lines, pixels) [DN].

    Noise acts in ISET's order: shot (Poisson of signal + dark), read, PRNU, DSNU, clip to the swing,
    quantise. Sources missing from ``noise`` are left out; the dark signal's mean always stays.
    """
    charge = electrons + sensor.dark_e
    if Noise.SHOT in noise:
        charge = rng.poisson(charge).astype(np.float64)
    if Noise.READ in noise:
        charge = charge + rng.standard_normal(charge.shape) * sensor.read_noise_e
    if Noise.PRNU in noise:
        charge = charge * pattern.gain
    if Noise.DSNU in noise:
        charge = charge + pattern.offset_e
    return sensor.quantise(charge * (sensor.conversion_gain_uv_per_e * 1e-6))


def clipped_gaussian(
    mean: NDArray[np.float64], sigma: NDArray[np.float64], *, low: float, high: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and variance of min(max(X, low), high), X normal; arrays broadcast, sigma > 0.

    Closed form from the truncated normal's moments: Johnson, Kotz, Balakrishnan, Continuous Univariate
    Distributions 1, section 13.10.1.
    """
    sigma = np.maximum(sigma, 1e-12)
    a, b = (low - mean) / sigma, (high - mean) / sigma
    below, above = special.ndtr(a), special.ndtr(-b)
    inside = special.ndtr(b) - below
    density_a, density_b = np.exp(-a * a / 2) / np.sqrt(2 * np.pi), np.exp(-b * b / 2) / np.sqrt(2 * np.pi)
    # Moments of (X - mean) / sigma after clipping keep precision where the mean is large.
    first = a * below + b * above + density_a - density_b
    second = a * a * below + b * b * above + inside + a * density_a - b * density_b
    return mean + sigma * first, np.maximum(second - first * first, 0.0) * sigma * sigma
