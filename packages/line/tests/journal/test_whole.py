"""The whole scan of a sheet: packed where it is written, read again as it was to an eye, and never believed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from packages.line.tests.journal.journals import facts, record

from prooflight_line.journal.arrays import MOST_PIXELS, packed, unpacked
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


def scan() -> NDArray[np.uint16]:
    """A page with a dark and a light half, and a camera's noise."""
    rng = np.random.default_rng(36)
    light = np.full((300, 200), 3200.0)
    light[:, :100] = 250
    return np.rint(light + rng.normal(0, np.sqrt(light))).astype(np.uint16)


def test_a_whole_scan_comes_back_from_a_journal_within_its_noise(tmp_path: Path) -> None:
    raw = scan()
    evidence = {"whole": raw, "whole_mm": np.array([0.0, 0.0, 20.0, 30.0]), "score": np.array(1.5)}
    with Journal.open(str(tmp_path / "runs.sqlite")) as journal:
        run = journal.begin_run(facts())
        journal.record(run, record(3, evidence=evidence))
        journal.commit()
        kept = journal.page(run, 3).evidence
    assert kept is not None
    assert kept["score"] == 1.5
    assert kept["whole"].nbytes < raw.nbytes / 4, "it is a JPEG"
    again = unpacked(kept)
    assert again is not None
    off = (again - raw) / np.sqrt(raw)
    assert float(np.sqrt((off**2).mean())) < 1.0  # less than the camera's own noise adds
    np.testing.assert_allclose(again[:, 20:80].mean(), raw[:, 20:80].mean(), rtol=0.02)
    np.testing.assert_allclose(again[:, 120:].mean(), raw[:, 120:].mean(), rtol=0.005)


def jpeg(lines: int, pixels: int) -> NDArray[np.uint8]:
    return cv2.imencode(".jpg", np.zeros((lines, pixels), np.uint8))[1].ravel()


@pytest.mark.parametrize(
    "spoilt",
    [
        {"whole": np.frombuffer(b"no picture at all", np.uint8)},
        {"whole": jpeg(40, 40)[:60]},
        {"whole": jpeg(4000, MOST_PIXELS // 4000 + 16)},
        {"whole": cv2.imencode(".jpg", np.zeros((9, 9, 3), np.uint8))[1].ravel()},
        {"whole": scan()},
        {"whole_top": np.array(np.nan)},
        {"whole_top": np.array(-1.0)},
        {"whole_top": np.zeros(3)},
    ],
)
def test_what_is_no_whole_scan_is_none(spoilt: dict[str, Any]) -> None:
    good = packed({"whole": scan()})
    assert unpacked(good) is not None
    assert unpacked({**good, **spoilt}) is None
