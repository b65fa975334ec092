import numpy as np

from prooflight.commissioning.characterise import appearance_srgb
from prooflight.inks.built_in import built_in_inks

SRGB = appearance_srgb(built_in_inks())


def test_paper_is_white_and_all_inks_are_nearly_black() -> None:
    assert SRGB.shape == (9, 9, 9, 9, 3)
    assert SRGB.dtype == np.uint8
    np.testing.assert_array_equal(SRGB[0, 0, 0, 0], [255, 255, 255])
    assert SRGB[-1, -1, -1, -1].max() < 40


def test_solids_have_the_hues_of_their_names() -> None:
    cyan, magenta, yellow, black = SRGB[-1, 0, 0, 0], SRGB[0, -1, 0, 0], SRGB[0, 0, -1, 0], SRGB[0, 0, 0, -1]
    assert cyan.argmin() == 0  # cyan takes red away
    assert magenta.argmin() == 1
    assert yellow.argmin() == 2
    assert np.ptp(black.astype(int)) < 15


def test_more_black_is_darker_in_every_channel() -> None:
    # of black alone: coloured inks leave the gamut of sRGB, where a channel that was clipped may come back
    assert (np.diff(SRGB.astype(int), axis=3) <= 1).all()
    assert (np.diff(SRGB[0, 0, 0].astype(int), axis=0) < 0).all()
