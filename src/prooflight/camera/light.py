"""The light on the page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight import spectra

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Light:
    """An illuminant of stated strength, falling evenly on the page."""

    name: str
    relative_power: NDArray[np.float64]
    """(36,) relative spectral power, any scale."""
    luminance_cd_m2: float
    """Luminance of a perfect white diffuser lying on the page. [cd/m2]"""

    def __post_init__(self) -> None:
        object.__setattr__(self, "relative_power", spectra.on_grid(self.relative_power))
        if (self.relative_power < 0).any() or not self.relative_power.any():
            message = "relative_power must be positive somewhere and negative nowhere"
            raise ValueError(message)
        if not self.luminance_cd_m2 > 0:
            message = f"luminance_cd_m2 must be above 0, got {self.luminance_cd_m2}"
            raise ValueError(message)

    @property
    def radiance_w(self) -> NDArray[np.float64]:
        """Radiance of a perfect diffuser (36,) [W sr-1 m-2 nm-1]; 683 sum(V L) dlambda is the luminance (CIE 015)."""
        luminous = (
            spectra.LUMINOUS_EFFICACY_LM_W
            * spectra.STEP_NM
            * (spectra.luminous_efficiency() @ self.relative_power)
        )
        return self.relative_power * (self.luminance_cd_m2 / luminous)

    @property
    def radiance_photons(self) -> NDArray[np.float64]:
        """Radiance of a perfect diffuser (36,) [photons s-1 sr-1 m-2 nm-1]."""
        return self.radiance_w * spectra.photons_per_joule()
