from __future__ import annotations

import numpy as np
import pytest

from prooflight.prediction.predict import Prediction
from prooflight_studies.speed.compare import (
    COMPARE_AND_GATHER,
    LEAST_WORK,
    NUMPY,
    READ_LIMIT,
    compare_rows,
    numpy_statistics,
    ssim_opencv,
)


@pytest.fixture
def images() -> tuple[np.ndarray, Prediction]:
    rng = np.random.default_rng(1)
    expected = rng.uniform(100, 3000, (1, 150, 170)).astype(np.float32)
    measured = np.rint(expected + 8 * rng.standard_normal(expected.shape)).astype(np.uint16)
    return measured, Prediction(expected_dn=expected, variance_dn2=np.full_like(expected, 64 + 1 / 12))


def test_every_way_is_timed_beside_the_limit(images: tuple[np.ndarray, Prediction]) -> None:
    rows = {row.name: row for row in compare_rows(*images, top_codes_dn=[4095], repeats=2)}
    assert {READ_LIMIT, COMPARE_AND_GATHER, LEAST_WORK, NUMPY} < rows.keys()
    assert rows[READ_LIMIT].of_read_limit == 1
    assert rows[COMPARE_AND_GATHER].speed_ratio == 1
    for row in rows.values():
        assert 0 < row.lowest_mpx_per_cpu_s <= row.mpx_per_cpu_s <= row.highest_mpx_per_cpu_s


def test_the_numpy_form_counts_every_pixel(images: tuple[np.ndarray, Prediction]) -> None:
    assert numpy_statistics(*images)[0].sum() == images[0].size


def test_opencvs_ssim_is_scikit_images(images: tuple[np.ndarray, Prediction]) -> None:
    metrics = pytest.importorskip("skimage.metrics")
    one, other = images[0][0].astype(np.float32), images[1].expected_dn[0]
    _, whole = metrics.structural_similarity(
        one,
        other,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=4095.0,
        full=True,
    )
    # scikit-image leaves out 5 pixels at the border in its mean; the map itself is compared by its mean
    assert ssim_opencv(one, other, top=4095.0) == pytest.approx(float(whole.mean()), abs=2e-4)
