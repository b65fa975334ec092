"""Against the spectral data that Argyll CMS ships."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

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


@pytest.mark.parametrize("name", ["A", "D50", "D65", "F2", "F7", "F11"])
def test_illuminants_that_a_press_file_may_name(shared: Path, prototype: PressFile, name: str) -> None:
    path = shared / "data" / "illum" / f"CIE-{name}.sp"
    if not path.is_file():
        pytest.skip(f"needs shared/data/illum/{path.name}")
    text = prototype.text.replace('illuminant = "D65"', f'illuminant = "{name}"')
    got = PressFile(prototype.path, text).camera().light.relative_power
    want = argyll_spectrum(path)
    # Fluorescent lamps' tables here have as few as two digits; the largest band sets the scale.
    np.testing.assert_allclose(got / got.sum(), want / want.sum(), atol=0.005 * (want / want.sum()).max())
