"""Edges that do not show in the light: one ink ends where others begin, and the light is nearly the same.

Test forms and grey balance charts have them, and photographs. A plane that is slightly out of register opens a
gap there, or overlaps, and shows a line that no slope of the expected light announces.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.memory import unset
from prooflight.kernels.residuals.hidden_edges import hidden_slopes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.modes import Modes
    from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
    from prooflight.prediction.tables import SensorModel

PLANE_SD: Final = 0.05
"""Displacement of a plane relative to the others that registration and fit leave. [binned pixels] Assumed: half of
the raster's own pixels, by which planes are placed, less what the fit's linear step takes of it."""
LEAST_SLOPE: Final = 0.03
"""Hidden slope that matters somewhere on a page, as a share of white a pixel: that of a place near an edge."""


def hidden_edges(modes: Modes, sensors: Sequence[SensorModel]) -> NDArray[np.float32] | None:
    """Return the squared slope of edges that do not show in the light of a page.

    Parameters
    ----------
    modes : of the page in its nominal place, in binned pixels.
    sensors : of binned pixels.

    Returns
    -------
    (sensors, lines, pixels) by how much the squared slopes of the planes exceed that of their light
    [DN^2/pixel^2]; None where no place has ``LEAST_SLOPE``.
    """
    if np.count_nonzero(modes.cover.any(axis=(1, 2))) < 2:
        return None
    shape = modes.cover.shape[1:]
    out = unset((len(sensors), *shape))
    seen = False
    for index, sensor in enumerate(sensors):
        most = hidden_slopes(modes.gain[index], modes.cover, 0, shape[0], out[index])
        seen |= most >= (LEAST_SLOPE * sensor.white_dn) ** 2
    return out if seen else None


def with_hidden_edges(
    texture: NDArray[np.float32], hidden: NDArray[np.float32] | None, residual_variance: ResidualVariance
) -> NDArray[np.float32]:
    """Return the variance of halftones at unit contrast with that of planes out of register added.

    Neither shows in the slope of the light, so that the fit and the residuals treat them alike.

    Parameters
    ----------
    texture : (sensors, lines, pixels) ``Modes.texture`` [DN^2].
    hidden : (sensors, lines, pixels) ``hidden_edges`` at the same place [DN^2/pixel^2]; None: there are none.
    residual_variance : by whose ``contrast`` the texture is multiplied.
    """
    if hidden is None or residual_variance.contrast <= 0:
        return texture
    return np.asarray(texture + np.float32(PLANE_SD**2 / residual_variance.contrast) * hidden, np.float32)
