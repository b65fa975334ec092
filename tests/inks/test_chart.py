from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.stand_ins import others

from prooflight.errors import ChartError
from prooflight.inks.built_in import built_in_inks
from prooflight.inks.chart import Chart, read_chart
from prooflight.spectra import WAVE_NM, delta_e00, lab

CHARAC = others("characterisation data")
TABLE = """CTI3

DESCRIPTOR "{}"
NUMBER_OF_FIELDS 11
BEGIN_DATA_FORMAT
SAMPLE_ID CMYK_C CMYK_M CMYK_Y CMYK_K XYZ_X XYZ_Y XYZ_Z LAB_L LAB_A LAB_B
END_DATA_FORMAT
NUMBER_OF_SETS 2
BEGIN_DATA
1  0  0  0  0  80.00  83.00  68.00  93.01  0.05  -0.06
2  0  0  0  100  1.80  1.90  1.50  14.96  -0.24  0.58
END_DATA
"""
PERCENT = np.array(
    [[0, 0, 0, 0], [100, 0, 0, 0], [0, 100, 0, 0], [10.196078431372548, 0, 50, 0], [0, 0, 0, 100]]
)
SPECTRA = built_in_inks().reflectance(PERCENT / 100)

Text = Callable[..., str]


def read(tmp_path: Path, text: str) -> Chart:
    path = tmp_path / "chart.txt"
    path.write_text(text, encoding="latin-1")
    return read_chart(path)


@pytest.mark.parametrize(
    "names",
    [
        "SPECTRAL_NM{:.0f}",
        "SPECTRAL_NM_{:.0f}",
        "SPECTRAL_{:.0f}",
        "SPEC_{:.0f}",
        "SPEC_{:.1f}",
        "nm{:.0f}",
        "NM_{:.0f}",
        "R_{:.0f}",
        "D_{:.0f}",
        "{:.0f}nm",
        "{:.0f}",
    ],
)
def test_spectral_columns_by_any_usual_name(tmp_path: Path, chart_text: Text, names: str) -> None:
    chart = read(tmp_path, chart_text(PERCENT, SPECTRA, names=names))
    np.testing.assert_array_equal(chart.cmyk_percent, PERCENT)
    np.testing.assert_array_equal(chart.reflectance, SPECTRA)
    assert len(chart) == 5


@pytest.mark.parametrize(
    "change", [{"head": "CTI3", "separator": " "}, {"keywords": ['SPECTRAL_NORM "100.0"']}, {}]
)
def test_spectra_in_per_cent(tmp_path: Path, chart_text: Text, change: dict[str, object]) -> None:
    chart = read(tmp_path, chart_text(PERCENT, 100 * SPECTRA, **change))
    np.testing.assert_allclose(chart.reflectance, SPECTRA, rtol=1e-14)


def test_spectral_norm_counts_even_where_the_size_would_say_otherwise(
    tmp_path: Path, chart_text: Text
) -> None:
    dim = SPECTRA / 100  # a chart of dark patches in per cent
    chart = read(tmp_path, chart_text(PERCENT, 100 * dim, keywords=["SPECTRAL_NORM 100"]))
    np.testing.assert_allclose(chart.reflectance, dim, rtol=1e-14)


@pytest.mark.parametrize("norm", ["0", "-100", "1e-300", "1e999", "many"])
def test_a_norm_that_says_nothing(tmp_path: Path, chart_text: Text, norm: str) -> None:
    with pytest.raises(ChartError, match=f"SPECTRAL_NORM is {norm}"):
        read(tmp_path, chart_text(PERCENT, SPECTRA, keywords=[f"SPECTRAL_NORM {norm}"]))


def test_columns_in_falling_order_and_other_columns_between(tmp_path: Path, chart_text: Text) -> None:
    text = chart_text(PERCENT, SPECTRA[:, ::-1], wave_nm=WAVE_NM[::-1])
    text = text.replace("SAMPLE_ID", "SAMPLE_NAME")
    chart = read(tmp_path, text)
    np.testing.assert_array_equal(chart.reflectance, SPECTRA)


def test_decimal_commas(tmp_path: Path, chart_text: Text) -> None:
    chart = read(tmp_path, chart_text(PERCENT, SPECTRA).replace(".", ","))
    np.testing.assert_array_equal(chart.reflectance, SPECTRA)


def test_the_table_with_inks_and_spectra_is_found_among_several(tmp_path: Path, chart_text: Text) -> None:
    other = "CAL\nBEGIN_DATA_FORMAT\nI C M Y K\nEND_DATA_FORMAT\nBEGIN_DATA\n0 0 0 0 0\nEND_DATA\n"
    chart = read(tmp_path, other + chart_text(PERCENT, SPECTRA, head="CTI3") + other)
    assert len(chart) == 5


def test_a_coarser_chart_is_resampled(tmp_path: Path, chart_text: Text) -> None:
    some = slice(2, 35, 2)
    chart = read(tmp_path, chart_text(PERCENT, SPECTRA[:, some], wave_nm=WAVE_NM[some]))
    assert chart.reflectance.shape == (5, 36)
    assert delta_e00(lab(chart.reflectance), lab(SPECTRA)).max() < 0.3  # 0.14 on a measured chart


def test_repeats_are_kept_averaged_and_their_scatter_told(tmp_path: Path, chart_text: Text) -> None:
    rng = np.random.default_rng(4)
    percent = np.repeat(PERCENT, [3, 1, 2, 1, 1], axis=0)
    spectra = built_in_inks().reflectance(percent / 100) + rng.normal(scale=0.002, size=(8, 36))
    chart = read(tmp_path, chart_text(percent, spectra))
    recipes = chart.recipes()
    assert len(chart) == 8
    np.testing.assert_array_equal(np.sort(recipes.count), [1, 1, 1, 2, 3])
    np.testing.assert_allclose(100 * recipes.cmyk[recipes.of_patch], percent, atol=1e-4)
    white = recipes.of_patch[0]
    np.testing.assert_allclose(recipes.reflectance[white], spectra[:3].mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(chart.paper(), spectra[:3].mean(axis=0), rtol=1e-12)
    scatter = chart.scatter()
    assert scatter is not None
    assert (scatter.recipes, scatter.patches) == (2, 5)
    assert scatter.rms_reflectance == pytest.approx(0.002, rel=0.25)  # 108 degrees of freedom: 7 % one sigma
    assert 0 < scatter.median_delta_e00 <= scatter.max_delta_e00


def test_without_repeats_there_is_no_scatter_and_without_paper_an_error(
    tmp_path: Path, chart_text: Text
) -> None:
    chart = read(tmp_path, chart_text(PERCENT[1:], SPECTRA[1:]))
    assert chart.scatter() is None
    with pytest.raises(ChartError, match="no substrate patch"):
        chart.paper()


def test_digest_follows_the_numbers_alone(tmp_path: Path, chart_text: Text) -> None:
    first = read(tmp_path, chart_text(PERCENT, SPECTRA))
    renamed = read(tmp_path, chart_text(PERCENT, SPECTRA, names="nm{:.0f}", keywords=["X 1"]))
    changed = read(tmp_path, chart_text(PERCENT, SPECTRA * (1 + 1e-15 * np.eye(5, 36))))
    assert first.digest == renamed.digest != changed.digest


WRONG = {
    "fractions": ({"percent": PERCENT / 100}, "no ink goes beyond 1 %; the recipes look like 0..1"),
    "bytes": ({"percent": PERCENT * 2.55}, "line 9: ink of 255 %; the recipes look like 0..255"),
    "negative ink": ({"percent": PERCENT - 1}, "ink of -1 %"),
    "spectra of 0..255": ({"spectra": SPECTRA * 255}, "it looks like 0..255"),
    "negative reflectance": ({"spectra": SPECTRA - 0.1}, "reflectance runs from -0.0"),
    "mirrors": ({"spectra": SPECTRA * 1.9}, "reflectance runs from"),
    "densities": ({"spectra": -np.log10(SPECTRA) / 2}, "densities, not reflectance"),
    "short": ({"spectra": SPECTRA[:, 8:], "wave_nm": WAVE_NM[8:]}, "spectra cover 460 to 730 nm"),
    "few bands": ({"spectra": SPECTRA[:, :4], "wave_nm": WAVE_NM[:4]}, "spectra are missing"),
    "twice": (
        {"names": [f"nm{nm:.0f}" for nm in (380, *WAVE_NM[:-1])]},
        "the column nm380 appears twice",
    ),
    "patches missing": ({"sets": 6}, "NUMBER_OF_SETS states 6, the table has 5"),
    "empty": ({"percent": PERCENT[:0], "spectra": SPECTRA[:0]}, "the chart has no patches"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_charts_that_cannot_be_used(tmp_path: Path, chart_text: Text, kind: str) -> None:
    change, message = WRONG[kind]
    with pytest.raises(ChartError, match=message.replace(".", r"\.")) as caught:
        read(tmp_path, chart_text(**({"percent": PERCENT, "spectra": SPECTRA} | change)))
    assert str(caught.value).startswith(str(tmp_path / "chart.txt"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("cell", ["nan", "NaN", "-inf", "N/A", '""'])
def test_a_cell_that_is_no_number_is_named(tmp_path: Path, chart_text: Text, cell: str) -> None:
    text = chart_text(PERCENT, SPECTRA).replace(repr(float(SPECTRA[2, 7])), cell)
    with pytest.raises(ChartError, match=r"line 10, column SPECTRAL_NM450: .* is not a number"):
        read(tmp_path, text)


@pytest.mark.parametrize("lost", [1, 60, 600])
def test_a_truncated_chart_is_refused(tmp_path: Path, chart_text: Text, lost: int) -> None:
    text = chart_text(PERCENT, SPECTRA).rstrip()
    with pytest.raises(ChartError, match="cut off"):
        read(tmp_path, text[:-lost])


def test_charts_without_spectra_or_inks_say_what_is_missing(tmp_path: Path) -> None:
    text = (
        "BEGIN_DATA_FORMAT\nSAMPLE_ID {} LAB_L LAB_A LAB_B\nEND_DATA_FORMAT\nBEGIN_DATA\n1 {} 9 9 9\nEND_DATA"
    )
    with pytest.raises(
        ChartError, match=r"spectra are missing: it holds CMYK and LAB only; export .* SPECTRAL_NM380"
    ):
        read(tmp_path, text.format("CMYK_C CMYK_M CMYK_Y CMYK_K", "0 0 0 0"))
    with pytest.raises(ChartError, match="CMYK_C, CMYK_M, CMYK_Y, CMYK_K are missing"):
        read(tmp_path, text.format("RGB_R", "0"))


@pytest.mark.parametrize("table", [None, *CHARAC], ids=lambda path: path.stem if path else "made")
def test_tables_without_spectra(table: Path | None, tmp_path: Path) -> None:
    if table is None:
        table = tmp_path / "made.ti3"
        table.write_text(TABLE)
    with pytest.raises(ChartError, match="spectra are missing: it holds CMYK and LAB and XYZ only"):
        read_chart(table)


@pytest.mark.parametrize("path", others("a measured chart"))
def test_a_measured_chart(path: Path) -> None:
    measured_chart = read_chart(path)
    assert len(measured_chart) == 1617
    assert len(measured_chart.recipes().cmyk) == 1588
    scatter = measured_chart.scatter()
    assert scatter is not None
    assert scatter.max_delta_e00 == 0  # its makers averaged repeats
    assert dict(measured_chart.keywords)["WEIGHTING_FUNCTION"] == "OBSERVER,\t2 degree"
    assert 89 < lab(measured_chart.paper())[0] < 90  # a clay-coated news back board
