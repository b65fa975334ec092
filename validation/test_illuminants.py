"""Against the spectral data that Argyll CMS ships."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight import spectra
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from pathlib import Path


def argyll_spectrum(path: Path) -> np.ndarray:
    """A .sp file of one spectrum, brought to the grid."""
    lines = path.read_text(encoding="ascii").splitlines()
    fields = {}
    for line in lines:
        words = line.split()
        if len(words) == 2:
            fields[words[0]] = words[1].strip('"')
    values = np.array(lines[lines.index("BEGIN_DATA") + 1].split(), dtype=float)
    wave = np.linspace(
        float(fields["SPECTRAL_START_NM"]), float(fields["SPECTRAL_END_NM"]), int(fields["SPECTRAL_BANDS"])
    )
    return spectra.resample(wave, values)


def light_of(prototype: PressFile, name: str) -> np.ndarray:
    text = prototype.text.replace('illuminant = "D65"', f'illuminant = "{name}"')
    assert f'"{name}"' in text
    power = PressFile(prototype.path, text).camera().light.relative_power
    return power / power.sum()


def test_illuminants_that_a_press_file_may_name(shared: Path, prototype: PressFile) -> None:
    for name in ("A", "D50", "D65", "F2", "F7", "F11"):
        want = argyll_spectrum(shared / "data" / "illum" / f"CIE-{name}.sp")
        want /= want.sum()
        # Fluorescent lamps' tables here have as few as two digits; the largest band sets the scale.
        np.testing.assert_allclose(light_of(prototype, name), want, atol=0.005 * want.max(), err_msg=name)


def test_illuminant_a_is_its_formula(prototype: PressFile) -> None:
    """CIE 15:2004, equation 3.1."""
    wave = spectra.WAVE_NM
    power = 100 * (560 / wave) ** 5 * np.expm1(1.435e7 / (2848 * 560)) / np.expm1(1.435e7 / (2848 * wave))
    want = power / power.sum()
    np.testing.assert_allclose(light_of(prototype, "A"), want, atol=0.002 * want.max())


def test_daylights_are_sums_of_each_other(prototype: PressFile) -> None:
    """Daylights are a mean and two components (CIE 15:2004, equation 3.2), so any four depend on one another."""
    lights = np.stack([light_of(prototype, name) for name in ("D50", "D55", "D65", "D75")])
    strength = np.linalg.svd(lights, compute_uv=False)
    assert strength[2] > 1e-3 * strength[0]
    assert strength[3] < 2e-4 * strength[0]
