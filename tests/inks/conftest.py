"""Charts to test with: one constructed from the built-in press, one measured where it is at hand."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from prooflight.inks.built_in import built_in_inks
from prooflight.inks.chart import Chart, read_chart
from prooflight.inks.recipes import choose_recipes, printable_recipes
from prooflight.spectra import WAVE_NM

MEASURED = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "spectral"

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


@pytest.fixture(scope="session")
def measured_chart() -> Chart:
    """An offset chart of 1617 patches, smoothed by its makers."""
    files = sorted(MEASURED.glob("*Spectral.txt")) if MEASURED.is_dir() else []
    if not files:
        pytest.skip("needs shared/data/spectral beside the repository")
    return read_chart(files[0])
