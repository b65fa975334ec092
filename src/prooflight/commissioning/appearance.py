"""Appearance of recipes to a person, for pictures only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight import spectra
from prooflight.commissioning.characterise import recipe_grid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.inks.reflectance import ReflectanceModel

STEPS = 9

XYZ_TO_LINEAR_SRGB = np.array(  # IEC 61966-2-1
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)


def appearance_srgb(inks: ReflectanceModel) -> NDArray[np.uint8]:
    """Return sRGB (IEC 61966-2-1) of recipes at 9 even steps of each ink, (9, 9, 9, 9, 3).

    Bare paper is shown white.
    """
    axis = np.linspace(0, 1, STEPS)
    tristimulus = spectra.xyz(inks.reflectance(recipe_grid(axis, axis, axis, axis)), "D65")
    relative = tristimulus / tristimulus[0, 0, 0, 0] * spectra.white_xyz("D65")
    return srgb_bytes(relative @ XYZ_TO_LINEAR_SRGB.T)


def srgb_bytes(light: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return sRGB (IEC 61966-2-1) of light over white's, bounded to 0..1."""
    return np.round(spectra.srgb_encoded(light) * 255).astype(np.uint8)
