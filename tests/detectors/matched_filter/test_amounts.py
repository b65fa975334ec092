"""Amounts of ink and light in a place: stated where one mode explains what is off, and not else."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from prooflight.detectors.matched_filter import amounts
from prooflight.detectors.matched_filter.amounts import Amount, amount_in

SHAPE = (40, 40)
WHITE = 1000.0
EFFECTS = np.array([[300.0, 500.0, 50.0, 800.0], [100.0, 300.0, 600.0, 800.0]])
"""Darkening by each ink, (sensors, inks): cyan and magenta differ in their proportions. [DN]"""


@pytest.fixture(autouse=True)
def _level(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lamp is as it was calibrated, and added ink darkens as more of it does."""
    level = SimpleNamespace(columns=np.zeros(SHAPE[1], np.float32))
    monkeypatch.setattr(amounts, "fitted_amounts", lambda *_: [level, level])
    monkeypatch.setattr(amounts, "moved", lambda images, _: images)


def images(share: float) -> NDArray[np.float32]:
    """Effects of all inks of a tint, (sensors, inks, lines, pixels); less light is less signal."""
    return np.broadcast_to((-share * EFFECTS)[..., None, None], (2, 4, *SHAPE)).astype(np.float32)


def measured(off_dn: NDArray[np.floating]) -> Any:
    """A scan of a page of 600 DN everywhere that is off by (sensors, 1 or lines, 1 or pixels)."""
    expected = np.full((2, *SHAPE), 600.0, np.float32)
    sensor = SimpleNamespace(white_dn=WHITE, column_offset_dn=np.zeros(SHAPE[1], np.float32))
    return SimpleNamespace(
        seen=SimpleNamespace(expected_dn=expected),
        measured_dn=expected + off_dn + np.random.default_rng(3).normal(0, 2.0, expected.shape),
        modes=SimpleNamespace(gain=images(0.5)),
        sensors=(sensor, sensor),
        where=SimpleNamespace(inside=np.ones(SHAPE, bool)),
        colours=None,
        inside=lambda _: np.ones(SHAPE, bool),
    )


def of_ink(ink: int, share: float) -> NDArray[np.floating]:
    return (-share * EFFECTS[:, ink])[:, None, None]


def stated(kind: str, off_dn: NDArray[np.floating], *, distinct: str = "CMYK") -> Amount:
    added: Any = SimpleNamespace(images=images(0.5).reshape(8, *SHAPE))
    fit: Any = None
    place = slice(5, 35)
    return amount_in(kind, place, place, measured(off_dn), added, fit, distinct=distinct, inks="CMYK")


def test_the_ink_and_its_share_are_stated() -> None:
    # Half of the paper has ink: a gain of 40 % is 0.2 of a solid's darkening. Noise of 2 DN in 450 pixels: 0.1 %.
    assert stated("missing-plane", of_ink(2, -0.2)).ink == "Y"
    assert stated("missing-plane", of_ink(2, -0.2)).darker_percent == pytest.approx(-40, abs=1)
    assert stated("scum", of_ink(0, 0.05)).ink == "C"
    assert stated("scum", of_ink(0, 0.05)).darker_percent == pytest.approx(10, abs=1)


def test_of_an_ink_that_is_not_certain_neither_name_nor_amount_is_stated() -> None:
    assert stated("scum", of_ink(0, 0.05), distinct="K") == Amount()
    between = (of_ink(0, 0.05) + of_ink(1, 0.05)) / 2  # cyan explains it nearly as well as magenta
    assert stated("ghost-smear", between).ink == ""


def test_content_that_is_missing_leaves_paper() -> None:
    paper = np.full((2, 1, 1), WHITE - 600.0)
    assert stated("missing-content", paper) == Amount(darker_percent=pytest.approx(-100, abs=1))


def test_what_differs_from_part_to_part_has_no_amount() -> None:
    uneven = np.where(np.arange(SHAPE[0]) < 20, 1.0, -0.9)[None, :, None] * of_ink(2, 0.2)
    assert stated("missing-plane", uneven).darker_percent is None
    assert stated("local-blur", of_ink(2, 0.2)) == Amount(), "blur has no amount"
    impossible = stated("missing-plane", of_ink(3, -0.7))
    assert impossible.darker_percent is None, "more than all of an ink"
