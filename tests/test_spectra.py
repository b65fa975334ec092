import colour
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight import spectra
from prooflight.spectra import BANDS, WAVE_NM


def test_the_grid_is_the_papers() -> None:
    assert BANDS == 36
    assert WAVE_NM[0] == 380
    assert WAVE_NM[-1] == 730
    assert (np.diff(WAVE_NM) == 10).all()
    with pytest.raises(ValueError, match="read-only"):
        WAVE_NM[0] = 0


def test_on_grid_copies_and_locks() -> None:
    values = np.ones(BANDS)
    locked = spectra.on_grid(values)
    values[0] = 7
    assert locked[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        locked[0] = 2


@pytest.mark.parametrize("values", [np.ones(35), np.ones((36, 1)), np.full(36, np.nan), np.full(36, np.inf)])
def test_on_grid_refuses_what_is_no_spectrum(values: np.ndarray) -> None:
    with pytest.raises(ValueError, match="36 finite values"):
        spectra.on_grid(values)


@given(
    wave=st.lists(st.floats(381, 729), min_size=0, max_size=30, unique=True),
    slope=st.floats(-2, 2),
    level=st.floats(-100, 100),
)
def test_resampling_is_exact_on_straight_lines_at_any_wavelengths(
    wave: list[float], slope: float, level: float
) -> None:
    given_nm = np.array(sorted([360.0, *wave, 750.0]))
    got = spectra.resample(given_nm, level + slope * given_nm)
    np.testing.assert_allclose(got, level + slope * WAVE_NM, atol=1e-9)


def test_resampling_keeps_values_on_the_grid_and_works_on_stacks() -> None:
    spectrum = np.random.default_rng(1).random((2, 3, BANDS))
    np.testing.assert_array_equal(spectra.resample(WAVE_NM, spectrum), spectrum)


@pytest.mark.parametrize(
    ("wave", "values", "fault"),
    [
        (np.arange(390, 731, 10), np.ones(35), "covers 390..730 nm"),
        (np.arange(380, 721, 10), np.ones(35), "covers 380..720 nm"),
        ([380, 500, 500, 730], np.ones(4), "must increase"),
        ([730, 380], np.ones(2), "must increase"),
        ([380, 730], np.ones(3), "one value for each"),
        ([380], np.ones(1), "must increase"),
        ([380, 730], [1, np.nan], "finite"),
        ([380, np.inf], [1, 1], "finite"),
    ],
)
def test_resampling_refuses(wave: list[float], values: np.ndarray, fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        spectra.resample(wave, values)


def test_illuminant_a_is_plancks_law_as_cie_015_writes_it() -> None:
    def planck(nm: np.ndarray) -> np.ndarray:
        return (560 / nm) ** 5 / np.expm1(1.435e7 / (2848 * nm))

    want = 100 * planck(WAVE_NM) / planck(np.array(560.0))
    np.testing.assert_allclose(spectra.illuminant("A"), want, rtol=1e-5)  # the table has six digits


@pytest.mark.parametrize("name", ["A", "D50", "D65"])
def test_tabulated_illuminants_are_100_at_560_nm(name: str) -> None:
    assert spectra.illuminant(name)[WAVE_NM == 560] == pytest.approx(100, rel=1e-5)


def test_cie_tables_are_colour_sciences() -> None:
    tables = spectra._cie()
    assert tables["wave_nm"] == WAVE_NM.tolist()
    for name, power in tables["illuminants"].items():
        theirs = colour.SDS_ILLUMINANTS[name]
        assert power == spectra.resample(theirs.wavelengths, theirs.values).tolist()
    photopic = colour.SDS_LEFS["CIE 1924 Photopic Standard Observer"]
    assert tables["photopic"] == spectra.resample(photopic.wavelengths, photopic.values).tolist()
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    assert tables["observer"] == spectra.resample(observer.wavelengths, observer.values.T).T.tolist()


def test_there_is_no_illuminant_of_that_name() -> None:
    with pytest.raises(KeyError):
        spectra.illuminant("D66")


def test_the_eye_peaks_between_550_and_560_nm_at_1() -> None:
    v = spectra.luminous_efficiency()
    assert v.max() == pytest.approx(0.995, abs=1e-4)  # V(550) = V(560) = 0.995 to three digits
    assert WAVE_NM[v.argmax()] in (550, 560)
    np.testing.assert_allclose(spectra.colour_matching()[:, 1], v, atol=2e-3)  # y-bar is V


def test_photons_in_a_joule() -> None:
    # lambda / (h c), 2.79e18 at 555 nm; ISET's older Planck constant lies 1.6e-5 above the SI's.
    got = spectra.photons_per_joule()
    want = WAVE_NM * 1e-9 / (6.62607015e-34 * 299792458.0)
    np.testing.assert_allclose(got, want, rtol=2e-5)


@pytest.mark.parametrize(
    ("light", "white"),
    [("D50", (0.9642, 1.0, 0.8251)), ("D65", (0.9504, 1.0, 1.0888)), ("A", (1.0985, 1.0, 0.3558))],
)
def test_white_points(light: str, white: tuple[float, float, float]) -> None:
    # The published ones integrate 360..830 nm by 1 nm; 380..730 by 10 stays within 0.003.
    np.testing.assert_allclose(spectra.white_xyz(light), white, atol=3e-3)


@given(st.floats(0.0, 1.2))
def test_lightness_of_greys_is_cie_1976(grey: float) -> None:
    want = 116 * np.cbrt(grey) - 16 if grey > 216 / 24389 else grey * 24389 / 27
    lightness, a, b = spectra.lab(np.full(BANDS, grey))
    assert lightness == pytest.approx(want, abs=1e-9)
    assert a == pytest.approx(0, abs=1e-9)
    assert b == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("one", "other", "difference"),  # Sharma, Wu, Dalal 2005, table 1, pairs 1, 7, 17 and 25
    [
        ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
        ((50, 0, 0), (50, -1, 2), 2.3669),
        ((50, 2.5, 0), (73, 25, -18), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ],
)
def test_ciede2000_meets_its_published_pairs(
    one: tuple[float, ...], other: tuple[float, ...], difference: float
) -> None:
    assert spectra.delta_e00(one, other) == pytest.approx(difference, abs=5e-5)


def test_srgb_is_colour_sciences_and_has_an_inverse() -> None:
    light = np.concatenate(
        [np.linspace(0, 0.01, 101), np.linspace(0.01, 1, 101)]
    )  # straight to 0.0031, then curved
    codes = spectra.srgb_encoded(light)
    np.testing.assert_allclose(codes, colour.models.eotf_inverse_sRGB(light), rtol=0, atol=1e-12)
    np.testing.assert_allclose(spectra.srgb_light(codes), light, rtol=0, atol=1e-12)
    assert spectra.srgb_encoded(light.astype(np.float32)).dtype == np.float32
    np.testing.assert_allclose(spectra.srgb_encoded(np.array([-1.0, 2.0])), [0, 1], rtol=0, atol=1e-12)
