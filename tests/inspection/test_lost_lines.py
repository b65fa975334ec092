"""A sheet of which lines were lost is judged where it was seen: never a misprint for it, and still one for others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.inspection.test_inspector import printed

from prooflight.inspection.inspector import Inspector
from prooflight.inspection.lost_lines import as_foretold, inspect_where_seen, unseen_share
from prooflight.simulation.scans import MisprintRequest

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

    MakePage = Callable[..., Page]

FEW, BLOCK, SEVERAL = ((150, 153),), ((120, 184),), ((60, 61), (150, 153), (200, 240))


def holed(scan: np.ndarray, unseen: tuple[tuple[int, int], ...]) -> np.ndarray:
    """As the pager leaves it: the line before stands where lines were lost."""
    scan = scan.copy()
    for first, end in unseen:
        scan[:, first:end] = scan[:, first - 1 : first]
    return scan


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("unseen", [FEW, BLOCK, SEVERAL])
def test_a_good_print_passes_whatever_was_lost(
    press: Press, make_page: MakePage, unseen: tuple[tuple[int, int], ...], seed: int
) -> None:
    page = make_page(seed)
    scan = holed(printed(page, press, seed).dn, unseen)
    inspector = Inspector.of(press, "chi-square")
    prepared = inspector.prepare(page)
    found = inspect_where_seen(inspector, prepared, scan, unseen=unseen, seed=seed)
    assert found.verdict.verdict == "good"
    if unseen is not FEW:  # the same lines taken for the paper's own would be a misprint
        assert inspector.inspect(prepared, scan, seed=seed).verdict.verdict == "misprint"


@pytest.mark.parametrize("seed", [1, 2])
def test_a_misprint_beside_lost_lines_is_found_as_ever(press: Press, make_page: MakePage, seed: int) -> None:
    page = make_page(seed)
    request = MisprintRequest(kind="streak", severity=1.0)
    scan = holed(printed(page, press, seed, request).dn, FEW)
    inspector = Inspector.of(press, "chi-square")
    found = inspect_where_seen(inspector, inspector.prepare(page), scan, unseen=FEW, seed=seed)
    assert found.verdict.verdict == "misprint"


def test_what_was_seen_stays_and_what_was_lost_is_as_foretold(press: Press, make_page: MakePage) -> None:
    page = make_page(5)
    whole = printed(page, press, 5).dn
    scan = holed(whole, BLOCK)
    inspector = Inspector.of(press, "chi-square")
    filled = as_foretold(scan, inspector.inspect(page, scan), BLOCK, seed=5)
    seen = np.ones(scan.shape[1], bool)
    seen[slice(*BLOCK[0])] = False
    np.testing.assert_array_equal(filled[:, seen], scan[:, seen])
    rows, columns = inspector.inspect(page, scan).area
    assert rows.start < BLOCK[0][0] < BLOCK[0][1] < rows.stop
    here = slice(*BLOCK[0])
    off = filled[:, here, columns].astype(float) - whole[:, here, columns]
    as_it_was = np.abs(scan[:, here, columns].astype(float) - whole[:, here, columns]).mean()
    assert np.abs(off).mean() < 0.2 * as_it_was


def test_without_loss_it_is_the_inspection_itself(press: Press, make_page: MakePage) -> None:
    page = make_page(1)
    scan = printed(page, press, 1).dn
    inspector = Inspector.of(press, "chi-square")
    prepared = inspector.prepare(page)
    found, usual = inspect_where_seen(inspector, prepared, scan, unseen=()), inspector.inspect(prepared, scan)
    assert found.verdict.score == usual.verdict.score
    assert unseen_share(((0, 3), (7, 9)), 10) == 0.5
