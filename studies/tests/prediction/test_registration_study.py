"""Where prints lie in truth: by what was drawn, and by nothing that registration found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.prediction.predict import predict
from prooflight.simulation.prints import Print
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import Amounts
from prooflight_studies.registration import study
from prooflight_studies.registration.results import COLUMNS, plane_parts, printed_at, reported_at
from prooflight_studies.registration.study import FindDesign, Task

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.registration.register import Landmarks, Registration

CYAN, BLACK = 0, 3


def barred(page: Page, **coverage: tuple[int, slice]) -> Page:
    """Bars 12 pixels wide, 24 apart, upright and lying, of inks in a part of the page's columns."""
    cmyk = np.zeros_like(page.cmyk)
    rows, columns = np.ogrid[: cmyk.shape[0], : cmyk.shape[1]]
    bars = (rows // 12 % 2 == 0) ^ (columns // 12 % 2 == 0)
    for ink, where in coverage.values():
        cmyk[:, where, ink] = 255 * bars[:, where]
    return replace(page, cmyk=cmyk)


def with_register(press: Press, page: Page, pixels: NDArray[np.int64]) -> Print:
    """A print whose planes lie so many raster pixels off, (4, 2)."""
    rng = np.random.default_rng(1)
    drawn = Print.draw(Session.draw(Amounts.stated(), press, rng), press, page, rng)
    return replace(drawn, register_mm=pixels * page.pixel_mm)


def test_a_page_of_one_ink_lies_where_its_plane_lies(press: Press, page: Page) -> None:
    black = barred(page, black=(BLACK, slice(None)))
    parts = plane_parts(black, press)
    np.testing.assert_allclose(parts, np.eye(4)[[BLACK, BLACK]])
    off = np.array([[5, 5], [-4, 3], [2, 2], [1, -2]])
    print_ = with_register(press, black, off)
    truth = printed_at(print_, parts, black)
    moved = np.subtract(truth.shift_mm, print_.placement.shift_mm)
    np.testing.assert_allclose(moved, off[BLACK] * page.pixel_mm, atol=1e-9)
    assert truth.warp is print_.placement.warp


def test_a_page_without_ink_lies_where_its_sheet_lies(press: Press, page: Page) -> None:
    blank = replace(page, cmyk=np.zeros_like(page.cmyk))
    parts = plane_parts(blank, press)
    assert not parts.any()
    print_ = with_register(press, blank, np.full((4, 2), 3))
    assert printed_at(print_, parts, blank).shift_mm == print_.placement.shift_mm


def test_planes_count_as_the_shift_that_fits_them_best(press: Press, page: Page) -> None:
    """Black moves by a raster pixel and cyan does not: the best shift of both, by least squares over the pixels.

    A raster pixel is half of the camera's, so signals answer nearly linearly: 0.03 is allowed.
    """
    middle = page.cmyk.shape[1] // 2
    both = barred(page, cyan=(CYAN, slice(0, middle)), black=(BLACK, slice(middle, None)))
    parts = plane_parts(both, press)
    assert parts.sum(axis=1) == pytest.approx([1, 1])
    assert 0.02 < parts[0, CYAN] < 0.4 < parts[0, BLACK]

    def expected(of: Page) -> NDArray[np.float64]:
        seen = predict(of, sensors=press.sensors, geometry=press.geometry)
        return np.asarray(seen.expected_dn / np.sqrt(start.variance_dn2), np.float64)

    start = predict(both, sensors=press.sensors, geometry=press.geometry)
    for axis in (0, 1):
        black_alone, whole = both.cmyk.copy(), np.roll(both.cmyk, 1, 1 - axis)
        black_alone[..., BLACK] = np.roll(both.cmyk[..., BLACK], 1, 1 - axis)
        edge = [slice(None), slice(None)]
        edge[1 - axis] = slice(0, 1)
        black_alone[(*edge, BLACK)], whole[tuple(edge)] = 0, 0
        moved, all_moved = (
            expected(replace(both, cmyk=cmyk)) - expected(both) for cmyk in (black_alone, whole)
        )
        best = float((moved * all_moved).sum() / (all_moved**2).sum())
        assert parts[axis, BLACK] == pytest.approx(best, abs=0.03)


@dataclass(frozen=True, slots=True)
class SmallPages:
    make: Callable[..., Page]

    def page(self, index: int) -> Page:
        return self.make(index, number=index + 1)


def test_whatever_registration_says_its_planes_count_the_truth_stays(
    press: Press, make_page: Callable[..., Page], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Good prints lie within half a pixel of where they are found, whatever parts are said with it (seed 3)."""
    work = FindDesign(
        press=press,
        composed=SmallPages(make_page),  # type: ignore[arg-type]
        real=None,
        seed=3,
        prints=2,
    )
    task = Task(design=4, real=False, crops=False)
    rows = work(task)["rows"]
    register = study.register

    def other_parts(landmarks: Landmarks, scan: NDArray[np.uint16]) -> Registration:
        found = register(landmarks, scan)
        return replace(found, plane_parts=found.plane_parts[:, ::-1] * 2)

    monkeypatch.setattr(study, "register", other_parts)
    np.testing.assert_array_equal(work(task)["rows"], rows)
    assert rows.shape == (4, len(COLUMNS))
    good = rows[rows[:, COLUMNS.index("condition")] == 0]
    assert (good[:, COLUMNS.index("found")] == 1).all()
    assert (good[:, COLUMNS.index("content_rms")] < 0.5).all()


def test_planes_that_are_found_where_they_were_drawn_leave_no_error(press: Press, page: Page) -> None:
    """What is said may put the page's middle anywhere among its planes: each plane's own place is what counts."""
    parts = plane_parts(page, press)
    print_ = with_register(press, page, np.array([[4, 0], [-2, 3], [1, 1], [0, -3]]))
    planes_mm = print_.register_mm
    middle = planes_mm[2]
    found = SimpleNamespace(
        placement=replace(print_.placement, shift_mm=tuple(np.add(print_.placement.shift_mm, middle))),
        planes_mm=planes_mm - middle,
    )
    truth, said = printed_at(print_, parts, page), reported_at(found, parts)  # type: ignore[arg-type]
    np.testing.assert_allclose(said.shift_mm, truth.shift_mm, atol=1e-9)
