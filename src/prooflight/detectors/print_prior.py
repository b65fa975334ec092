"""What good prints do a priori: the fit, the check of a scan's light and the following of slow changes assume it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.base import LAMP_WAVES
from prooflight.registration.field import Prior


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintPrior:
    """Standard deviations of what good prints do, a priori.

    The defaults are those of a good office-class press: assumed, from the amounts of the press world (a test
    compares them). For a press whose ``[variation]`` says otherwise ``commissioning.training`` makes a prior,
    which is stored with the press's trained detector.
    """

    white: float = 0.013
    """Light of each sensor: table gain 1 %, white 0.5 % per channel. [-]"""
    common: float = 0.008
    """Light common to all sensors: white 0.8 %. [-]"""
    lamp: float = 0.009
    """Profile of the lamp: 0.8 % per session and 0.4 % per print. [-]"""
    lamp_length: float = 0.25
    """Share of the field over which the lamp profile's correlation falls to 1/e."""
    shape: float = 0.01
    gain: float = 0.0192
    """Gain of each ink: 1.2 % per session and 1.5 % per print."""
    tilt: float = 0.008
    dot: float = 0.016
    plane_mm: float = 0.048
    """Displacement of each plane; not conditioned on what registration measured."""
    most_plane_mm: float = 0.114
    """Maximum displacement of a plane."""
    place: float = 0.003
    """Local change common to all light: 1.5 times the paper's 0.2 %, for the lamp. [-]"""
    place_near: float = 0.001
    """The same within a few millimetres, about the smooth level: half of the paper's. [-]"""
    speck_share: float = 0.12
    """Ink of the darkest benign speck of paper (worlds.toml). [-]"""
    speck_mm2: float = float(np.pi / 4 * 0.5**2)
    """Area of the greatest such speck, 0.5 mm wide (worlds.toml)."""
    column: float = 0.0015
    """Gain of a column that flat-fielding left. [-]"""
    flicker: float = 0.0015
    """Flicker of the lamp from line to line. [-]"""
    turn_deg: float = 0.2
    """Skew: twice the bound of the uniform distribution of prints, so that registration finds what is
    slightly outside."""
    stretch_percent: float = 0.06
    """Scale, likewise."""
    warp_across_um: float = 30.0
    warp_along_um: float = 41.0

    @property
    def lamp_sd(self) -> NDArray[np.float64]:
        """Amplitudes of the lamp profile's waves cos(k pi x / W), (LAMP_WAVES,). [-]"""
        power = np.exp(-((np.pi * self.lamp_length * np.arange(1, LAMP_WAVES + 1)) ** 2) / 4)
        return np.asarray(self.lamp * np.sqrt(power / (0.5 * power.sum() + 0.5)))

    @property
    def of_place(self) -> Prior:
        """The prior of placement, for registration."""
        return Prior(
            turn_deg=self.turn_deg,
            stretch_percent=self.stretch_percent,
            warp_across_um=self.warp_across_um,
            warp_along_um=self.warp_along_um,
            plane_um=1e3 * self.plane_mm,
        )
