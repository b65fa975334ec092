import numpy as np

from prooflight_studies.harness.measures import normalised_error


def test_equation_2() -> None:
    measured = np.array([[[100, 90]], [[5, 0]]], np.uint16)
    expected = np.array([[[96.0, 96.0]], [[5.5, 2.0]]], np.float32)
    variance = np.array([[[4.0, 9.0]], [[0.25, 1.0]]], np.float32)
    kept = measured.copy(), expected.copy(), variance.copy()
    z = normalised_error(measured, expected, variance)
    np.testing.assert_allclose(z, [[[2.0, -2.0]], [[-1.0, -2.0]]], rtol=1e-6)
    assert z.dtype == np.float32
    for after, before in zip((measured, expected, variance), kept, strict=True):
        np.testing.assert_array_equal(after, before)


def test_below_expectation_is_negative_and_does_not_wrap() -> None:
    z = normalised_error(
        np.zeros((1, 1), np.uint16), np.full((1, 1), 3.0, np.float32), np.ones((1, 1), np.float32)
    )
    assert z[0, 0] == -3
