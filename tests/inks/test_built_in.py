import numpy as np

from prooflight.inks.built_in import COEFFICIENTS, built_in_inks, built_in_spectra
from prooflight.spectra import BANDS

MODEL = built_in_inks()
GRID = np.stack(np.meshgrid(*[np.linspace(0, 256 / 255, 9)] * 4, indexing="ij"), axis=-1)


def test_reflectance_stays_within_0_and_1_and_falls_with_every_ink() -> None:
    grid = MODEL.reflectance(GRID)
    assert grid.shape == (9, 9, 9, 9, BANDS)
    assert (grid > 0).all()
    assert (grid < 1).all()
    for ink in range(4):
        assert (np.diff(grid, axis=ink) < 0).all()


def test_spectra_are_plausible() -> None:
    paper, density = built_in_spectra(COEFFICIENTS)
    assert paper.min() > 0.4
    assert paper.max() < 0.95
    assert (density > 0).all()
    assert (density < 4.7).all()  # about 1 % of the light, what surface reflection leaves of a gloss solid
    # smooth: neighbouring bands of a pigment's broad absorption never differ by half of its peak
    assert (np.abs(np.diff(density, axis=1)).max(axis=1) < 0.5 * density.max(axis=1)).all()
