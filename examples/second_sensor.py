"""# Design a camera with a second sensor

One grey sensor sees yellow ink badly: it takes away blue light, of which the sensor sees little. A second sensor can
look where the first is blind. Which light should it see?

Candidates see a band of 60 nm each, around another wavelength. For each, the example asks how far 10 % too much of an
ink stands out of the noise of one pixel, with both sensors together, and takes the ink that stands out least. The
picture: that figure over the candidates; and what light the best of them sees, beside the first sensor and the inks.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import prooflight as pf
from prooflight.spectra import WAVE_NM

if TYPE_CHECKING:
    from numpy.typing import NDArray

INKS = {"cyan": "#009fd6", "magenta": "#d0118f", "yellow": "#cdb400", "black": "#222222"}
PEAKS_NM = np.arange(400, 701, 10)
BAND_NM = 60.0
"""Full width at half height of a candidate."""


def seen_by(peak_nm: float) -> NDArray[np.float64]:
    """Electrons per photon of a candidate (36,), at most 0.4."""
    return np.asarray(0.4 * np.exp(-4 * np.log(2) * ((WAVE_NM - peak_nm) / BAND_NM) ** 2))


def with_second(camera: pf.Camera, peak_nm: float) -> pf.Camera:
    """The camera and a second sensor that differs in its light alone."""
    (first,) = camera.sensors
    second = replace(first, name=f"{peak_nm:.0f} nm", quantum_efficiency=seen_by(peak_nm))
    return replace(camera, sensors=(first, second))


def standing_out(camera: pf.Camera) -> NDArray[np.float64]:
    """Of each sensor and ink, how far a tint of 55 % stands out from one of 50 %, in the noise of one pixel."""
    tint = 0.5 * np.eye(4)
    planned, more = (pf.built_in_inks().reflectance(recipes) for recipes in (tint, 1.1 * tint))
    return np.array(
        [
            np.abs(one.dn_mean - other.dn_mean) / one.dn_sigma_temporal
            for one, other in zip(pf.respond(camera, planned), pf.respond(camera, more), strict=True)
        ]
    )


def main(out: Path) -> None:
    """Try every candidate, draw what they are worth."""
    camera = pf.PressFile.prototype().camera()
    (alone,) = standing_out(camera)
    together = np.array(
        [np.linalg.norm(standing_out(with_second(camera, float(peak))), axis=0) for peak in PEAKS_NM]
    )
    best = int(together.min(axis=1).argmax())
    print("one sensor: " + ", ".join(f"{ink} {z:.1f}" for ink, z in zip(INKS, alone, strict=True)))
    print(
        f"and one at {PEAKS_NM[best]} nm: "
        + ", ".join(f"{ink} {z:.1f}" for ink, z in zip(INKS, together[best], strict=True))
    )

    figure = Figure(figsize=(11, 4), layout="constrained")
    worth, light = figure.subplots(1, 2)
    for ink, (name, colour) in enumerate(INKS.items()):
        worth.plot(PEAKS_NM, together[:, ink], color=colour, label=name)
        worth.axhline(alone[ink], color=colour, lw=1, ls=":")
    worth.plot(PEAKS_NM, together.min(axis=1), color="0.6", lw=5, alpha=0.5, label="the worst", zorder=0)
    worth.axvline(PEAKS_NM[best], color="0.5", lw=1)
    worth.set(
        title="10 % too much of an ink, both sensors (dotted: one)",
        xlabel="centre of the second sensor's band [nm]",
        ylabel="difference [sigma of one pixel]",
        ylim=(0, None),
    )
    worth.legend(fontsize=8, loc="center right", bbox_to_anchor=(1, 0.72))
    for sensor, style in zip(with_second(camera, float(PEAKS_NM[best])).sensors, ("-", "--"), strict=True):
        light.plot(WAVE_NM, sensor.quantum_efficiency, style, color="black", label=sensor.name)
    spectra = pf.built_in_inks().reflectance(np.eye(4))
    for spectrum, colour in zip(spectra, INKS.values(), strict=True):
        light.plot(WAVE_NM, spectrum, color=colour, lw=1)
    light.set(title="Light", xlabel="wavelength [nm]", ylabel="quantum efficiency; reflectance of solids [-]")
    light.legend(fontsize=8)
    figure.savefig(out / "second-sensor.png", dpi=110)


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]))  # the folder for what is drawn; without one, this folder
