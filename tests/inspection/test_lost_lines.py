"""A sheet of which lines were lost is judged where it was seen: never a misprint for it, and still one for others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.inspection.codes.test_codes import with_code
from tests.inspection.test_inspector import printed

from prooflight.detectors.paper.bayes import BayesDetector, BayesianNetwork
from prooflight.inspection.codes.reading import with_codes
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.lost_lines import as_foretold, inspect_where_seen, unseen_share
from prooflight.rng import stream
from prooflight.scans.lines import Unseen
from prooflight.scans.scan import Scan
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.prints import Print
from prooflight.simulation.scans import MisprintRequest
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

    MakePage = Callable[..., Page]

FEW, BLOCK = (Unseen(150, 153),), (Unseen(120, 184),)
SEVERAL = (Unseen(60, 61), Unseen(150, 153), Unseen(200, 240))


def holed(scan: np.ndarray, unseen: tuple[Unseen, ...]) -> np.ndarray:
    """As the pager leaves it: the line before stands where lines were lost."""
    scan = scan.copy()
    for first, end, _ in unseen:
        scan[:, first:end] = scan[:, first - 1 : first]
    return scan


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("unseen", [FEW, BLOCK, SEVERAL])
def test_a_good_print_passes_whatever_was_lost(
    press: Press, make_page: MakePage, unseen: tuple[Unseen, ...], seed: int
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
    seen[slice(*BLOCK[0][:2])] = False
    np.testing.assert_array_equal(filled[:, seen], scan[:, seen])
    rows, columns = inspector.inspect(page, scan).area
    assert rows.start < BLOCK[0].first < BLOCK[0].end < rows.stop
    here = slice(*BLOCK[0][:2])
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
    assert unseen_share((Unseen(0, 3), Unseen(7, 9)), 10) == 0.5
    assert unseen_share((Unseen(0, 3), Unseen(7, 9, 0), Unseen(5, 9, 1)), 10) == 0.7


@pytest.mark.parametrize("seed", [1, 2])
def test_what_one_sensor_did_not_see_is_taken_from_its_prediction_alone(
    two_sensor_press: Press, make_page: MakePage, seed: int
) -> None:
    page = make_page(seed)
    whole = printed(page, two_sensor_press, seed).dn
    scan, unseen = whole.copy(), (Unseen(120, 184, 1),)
    scan[1, 120:184] = scan[1, 119]
    inspector = Inspector.of(two_sensor_press, "chi-square")
    prepared = inspector.prepare(page)
    filled = as_foretold(scan, inspector.inspect(prepared, scan), unseen, seed=seed)
    np.testing.assert_array_equal(filled[0], whole[0])
    assert (filled[1, 120:184] != scan[1, 120:184]).any()
    assert inspect_where_seen(inspector, prepared, scan, unseen=unseen, seed=seed).verdict.verdict == "good"
    assert inspector.inspect(prepared, scan, seed=seed).verdict.verdict == "misprint"


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("unseen", [FEW, BLOCK])
def test_bayes_calls_no_sheet_a_misprint_for_lost_lines(
    press: Press, make_page: MakePage, unseen: tuple[Unseen, ...], seed: int
) -> None:
    """A network that was taught by made-up statistics, as in the contract's tests, and the same verdict as on all."""
    page = make_page(seed)
    whole = printed(page, press, seed).dn
    rng = np.random.default_rng(3)
    good = rng.normal([0, -4, 0.5], [0.02, 0.3, 0.005], (200, 3))
    bad = good + rng.normal(0, [0.3, 4.0, 0.05], good.shape)
    labels = ["correct"] * 200 + ["local"] * 100 + ["global"] * 100
    network = BayesianNetwork.learn(np.vstack([good, bad]), labels, misprint_rate=0.01)
    taught = press.with_detector("bayes", BayesDetector(network=network, threshold=0.5, unit=np.ones(1)))
    inspector = Inspector.of(taught, "bayes")
    prepared = inspector.prepare(page)
    usual = inspector.inspect(prepared, whole, seed=seed).verdict
    found = inspect_where_seen(inspector, prepared, holed(whole, unseen), unseen=unseen, seed=seed).verdict
    assert found.verdict == usual.verdict == "good"


@pytest.mark.parametrize("seed", [1, 2])
def test_in_the_press_world_lost_lines_make_chi_square_no_surer(
    press: Press, make_page: MakePage, seed: int
) -> None:
    """It calls such prints misprints anyway, as it allows for noise alone; lost lines are filled as the print is.

    So its score stays what the print's is, to 3 % on these pages.
    """
    page, rng = make_page(seed), stream(seed, "running-print", seed)
    session = Session.draw(amounts_of(press), press, stream(seed, "session"))
    whole = fast_scan(page, press, session, Print.draw(session, press, page, rng), rng=rng)
    inspector = Inspector.of(press, "chi-square")
    prepared = inspector.prepare(page)
    usual = inspector.inspect(prepared, whole, seed=seed).verdict
    found = inspect_where_seen(inspector, prepared, holed(whole, BLOCK), unseen=BLOCK, seed=seed).verdict
    assert found.score is not None
    assert usual.score is not None
    assert found.score < 1.05 * usual.score


@pytest.mark.parametrize("unseen", [FEW, BLOCK, (Unseen(1, 40),), (Unseen(60, 61), Unseen(90, 118))])
def test_our_detector_asks_nothing_of_lost_lines(
    trained_press: Press, make_page: MakePage, unseen: tuple[Unseen, ...]
) -> None:
    """Whatever stands in their place, the verdict is the same to the bit, and one look is enough."""
    page = make_page(1003, number=4, height_mm=30.0)
    whole = _printed_in_the_press_world(trained_press, page, 1)
    inspector = Inspector.of(trained_press, "matched_filter")
    prepared = inspector.prepare(page)
    usual = inspector.inspect(prepared, whole).verdict
    dark, noisy = whole.copy(), whole.copy()
    for first, end, _ in unseen:
        dark[:, first:end] = 0
        noisy[:, first:end] = np.random.default_rng(1).integers(0, 4096, noisy[:, first:end].shape)
    found = [
        inspect_where_seen(inspector, prepared, one, unseen=unseen).verdict for one in (dark, noisy, whole)
    ]
    assert found[0].score == found[1].score == found[2].score
    assert {one.verdict for one in found} == {usual.verdict} == {"good"}


def test_our_detector_finds_what_is_wrong_beside_lost_lines(
    trained_press: Press, make_page: MakePage
) -> None:
    page = make_page(1003, number=4, height_mm=30.0)
    scan = holed(_printed_in_the_press_world(trained_press, page, 1), FEW)
    scan[:, 60:80, 60:80] //= 3
    inspector = Inspector.of(trained_press, "matched_filter")
    found = inspect_where_seen(inspector, inspector.prepare(page), scan, unseen=FEW).verdict
    assert found.verdict == "misprint"


def test_a_code_on_which_lines_were_lost_says_nothing_where_it_does_not_read(
    press: Press, make_page: MakePage
) -> None:
    page = with_code(make_page(1))
    inspector = Inspector.of(press, "chi-square")
    prepared = inspector.prepare(page)
    (code,) = prepared.codes
    first = code.corner[0]
    unseen = (Unseen(first, first + code.light.shape[0]),)
    whole = printed(page, press, 1).dn
    assert inspector.inspect(prepared, whole).verdict.codes[0].checked
    good = inspector.inspect(prepared, whole)
    blank = whole.copy()
    blank[:, unseen[0].first : unseen[0].end] = whole.max()
    where = {"page": page, "sensors": press.sensors, "geometry": press.geometry}
    assert with_codes(good, prepared.codes, Scan(dn=blank), **where).verdict.kind == "code"
    done = with_codes(good, prepared.codes, Scan(dn=blank, unseen=unseen), **where).verdict
    (unread,) = done.codes
    assert (done.verdict, unread.read, unread.failed) == ("good", None, False)
    (read,) = with_codes(good, prepared.codes, Scan(dn=whole, unseen=unseen), **where).verdict.codes
    assert (read.checked, read.read, read.grade, read.weakest) == (True, read.text, None, "lost lines")


def _printed_in_the_press_world(press: Press, page: Page, seed: int) -> np.ndarray:
    rng = stream(seed, "running-print", seed)
    session = Session.draw(amounts_of(press), press, stream(seed, "session"))
    return fast_scan(page, press, session, Print.draw(session, press, page, rng), rng=rng)
