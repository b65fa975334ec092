"""The study of resolutions: prints that only their raster's rounding makes odd, and counts that are those of rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from prooflight.errors import RequestError
from prooflight_studies.resolution.study import FINER, PRINTED_DPI, Row, _results, run_resolution_study

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press


def row(**changes: object) -> Row:
    usual = {
        "page": "a",
        "printed_dpi": 0,
        "finer": 1,
        "misprint": "",
        "severity": 0.0,
        "alarm": False,
        "p_value": 0.5,
        "said": None,
    }
    return Row(**(usual | changes))  # type: ignore[arg-type]


def test_rows_are_counted_by_resolution_and_raster(trained_press: Press) -> None:
    rows = [row(printed_dpi=dpi, finer=finer) for dpi in PRINTED_DPI for finer in FINER]
    rows += [
        row(printed_dpi=600, finer=1, alarm=True, p_value=0.001),
        row(printed_dpi=1200, finer=2, alarm=True, p_value=0.001, page="b"),
        row(printed_dpi=1200, finer=2, misprint="streak", alarm=True),
        row(printed_dpi=1200, finer=2, misprint="scum"),
    ]
    found = _results(rows, trained_press, seed=1, pages=2)
    by = {(one["printed_dpi"], one["finer"]): one for one in found.rows}
    assert (by[600, 1]["alarms"], by[600, 1]["good"], by[600, 1]["odd"]) == (1, 2, 1)
    assert (by[1200, 2]["alarms"], by[1200, 2]["caught"], by[1200, 2]["misprints"]) == (1, 1, 2)
    assert (by[0, 1]["alarms"], by[0, 1]["misprints"]) == (0, 0)
    assert found.worst == [{"page": "b", "alarms": 1}]


def test_a_press_that_was_not_taught_is_refused(press: Press, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="was not taught 'matched_filter'"):
        run_resolution_study(press, tmp_path, tmp_path, seed=1)


def test_a_folder_without_a_page_that_fits_is_refused(trained_press: Press, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="holds no PDF that fits"):
        run_resolution_study(trained_press, tmp_path, tmp_path, seed=1)
