"""Charts to test with: one constructed from the built-in press, one measured where it is at hand."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from tests.stand_ins import others

from prooflight.inks.built_in import built_in_inks
from prooflight.inks.chart import Chart, read_chart
from prooflight.inks.recipes import choose_recipes, printable_recipes
from prooflight.spectra import WAVE_NM

MEASURED = others("a measured chart")
SPREADING = 1.7
"""How far paper spreads light between dots (Yule and Nielsen's n); offset on coated paper has about that. [-]"""
TRAPPED = 0.93
"""How much of an ink's density is left for each ink that it lies on; assumed. [-]"""

WriteChart = Callable[..., Path]


@pytest.fixture(scope="session")
def recipes_100() -> np.ndarray:
    """(100, 4) ink fractions: solids, overprints, and a spread of tints."""
    candidates = printable_recipes()
    return candidates[choose_recipes(candidates, 100)]


@pytest.fixture(scope="session")
def chart_text() -> Callable[..., str]:
    """Text of a chart; keyword arguments change one thing each."""

    def text(
        percent: np.ndarray,
        spectra: np.ndarray,
        *,
        names: str | Sequence[str] = "SPECTRAL_NM{:.0f}",
        wave_nm: np.ndarray = WAVE_NM,
        head: str = "CGATS.17",
        keywords: Sequence[str] = (),
        separator: str = "\t",
        sets: int | None = None,
    ) -> str:
        columns = [names.format(nm) for nm in wave_nm] if isinstance(names, str) else list(names)
        fields = ["SAMPLE_ID", "CMYK_C", "CMYK_M", "CMYK_Y", "CMYK_K", *columns]
        rows = [
            separator.join([f"P{at}", *map(repr, recipe), *map(repr, spectrum)])
            for at, (recipe, spectrum) in enumerate(
                zip(percent.tolist(), spectra.tolist(), strict=True), start=1
            )
        ]
        return "\n".join(
            [
                head,
                *keywords,
                f"NUMBER_OF_FIELDS {len(fields)}",
                "BEGIN_DATA_FORMAT",
                separator.join(fields),
                "END_DATA_FORMAT",
                f"NUMBER_OF_SETS {len(rows) if sets is None else sets}",
                "BEGIN_DATA",
                *rows,
                "END_DATA",
                "",
            ]
        )

    return text


@pytest.fixture(scope="session")
def built_in_chart(
    tmp_path_factory: pytest.TempPathFactory, recipes_100: np.ndarray, chart_text: Callable[..., str]
) -> Chart:
    """100 recipes of the built-in press without error, paper measured three times."""
    cmyk = np.concatenate([recipes_100, np.zeros((2, 4))])
    path = tmp_path_factory.mktemp("chart") / "built-in.txt"
    path.write_text(chart_text(100 * cmyk, built_in_inks().reflectance(cmyk)))
    return read_chart(path)


def offset_spectra(cmyk: np.ndarray) -> np.ndarray:
    """What an offset press makes of recipes (n, 4): (n, 36). No model of the package is of just this form.

    The built-in inks trap worse the more lie below, dots gain less where other inks lie, and light spreads.
    """
    inks = built_in_inks()
    gained = cmyk + 0.25 * cmyk * (1 - cmyk) * (1 - 0.15 * (cmyk.sum(axis=1, keepdims=True) - cmyk))
    root = np.zeros((len(cmyk), WAVE_NM.size))
    for solid in np.ndindex(2, 2, 2, 2):
        share = np.where(np.array(solid) == 1, gained, 1 - gained).prod(axis=1)
        density = (np.array(solid) * TRAPPED ** np.cumsum((0, *solid[:3]))) @ inks.density
        root += share[:, None] * (0.005 + inks.paper * 10**-density) ** (1 / SPREADING)
    return root**SPREADING


@pytest.fixture(scope="session")
def offset_chart(tmp_path_factory: pytest.TempPathFactory, chart_text: Callable[..., str]) -> Chart:
    """Ramps and mixtures as usual charts have them, of a press between the built-in one and no model's form."""
    mixed = np.stack(np.meshgrid(*[[0, 20, 40, 70, 100]] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
    ramps = np.kron(np.eye(4, dtype=int), np.arange(5, 100, 5)[:, None])
    cmyk = np.concatenate([mixed[mixed.sum(axis=1) <= 360], ramps]) / 100
    cmyk = np.unique(cmyk, axis=0)
    path = tmp_path_factory.mktemp("chart") / "offset.txt"
    path.write_text(chart_text(100 * cmyk, offset_spectra(cmyk)))
    return read_chart(path)


@pytest.fixture(scope="session", params=["offset", "measured"] if MEASURED else ["offset"])
def measured_chart(request: pytest.FixtureRequest, offset_chart: Chart) -> Chart:
    """A chart of hundreds of patches without noise: constructed, and measured on a press and smoothed by its makers."""
    return read_chart(MEASURED[0]) if request.param == "measured" else offset_chart
