"""What every detector must do (``detectors.base``): the paper's two, ours, the golden one, and the example's."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

import prooflight as pf
from examples import write_a_detector
from prooflight.detectors import registry
from prooflight.detectors.base import BLOCK_PIXELS, StoredArrays
from prooflight.detectors.golden.detector import Golden, GoldenDetector
from prooflight.detectors.paper.bayes import BayesDetector, BayesianNetwork
from prooflight.errors import RequestError
from prooflight.inspection.redeciding import Figure

if TYPE_CHECKING:
    from collections.abc import Callable

MISPRINT = "missing-content:0.6"


@dataclass(frozen=True, kw_only=True)
class Bench:
    """A detector with a page that it has prepared, and scans of it."""

    press: pf.Press
    detector: pf.Detector
    page: pf.Page
    ready: pf.PreparedPage
    good: pf.Scan
    bad: pf.Scan
    other: pf.Scan
    """Of another page."""


@pytest.fixture(scope="module")
def bayes(press: pf.Press) -> pf.Press:
    """The press with a network that learned from made-up statistics: misprints vary more than good pages."""
    rng = np.random.default_rng(3)
    good = rng.normal([0, -4, 0.5], [0.02, 0.3, 0.005], (200, 3))
    bad = good + rng.normal(0, [0.3, 4.0, 0.05], good.shape)
    labels = ["correct"] * 200 + ["local"] * 100 + ["global"] * 100
    network = BayesianNetwork.learn(np.vstack([good, bad]), labels, misprint_rate=0.01)
    return press.with_detector("bayes", BayesDetector(network=network, threshold=0.5, unit=np.ones(1)))


@pytest.fixture(scope="module")
def makers(
    press: pf.Press, bayes: pf.Press, page: pf.Page, request: pytest.FixtureRequest
) -> dict[str, Callable[[], tuple[pf.Press, pf.Detector]]]:
    """Each detector on its press, made when asked for: teaching ours takes a while."""

    def trained() -> tuple[pf.Press, pf.Detector]:
        own = request.getfixturevalue("trained_press")
        return own, registry.detector("matched_filter", own)

    def golden() -> tuple[pf.Press, pf.Detector]:
        registered = registry.detector("golden", press)
        assert isinstance(registered, GoldenDetector)
        scan = Golden.of(pf.simulate(page, press, seed=8), press.sensors)
        return press, replace(registered, goldens={"": scan})

    return {
        "chi-square": lambda: (press, registry.detector("chi-square", press)),
        "bayes": lambda: (bayes, registry.detector("bayes", bayes)),
        "matched_filter": trained,
        "golden": golden,
        "squares": lambda: (press, write_a_detector.detector(press)),
    }


@pytest.fixture(scope="module", params=["chi-square", "bayes", "matched_filter", "golden", "squares"])
def bench(
    request: pytest.FixtureRequest,
    makers: dict[str, Callable[[], tuple[pf.Press, pf.Detector]]],
    page: pf.Page,
    make_page: Callable[..., pf.Page],
) -> Bench:
    press, detector = makers[request.param]()
    return Bench(
        press=press,
        detector=detector,
        page=page,
        ready=detector.prepare(pf.PlannedPage(page, press.press_context())),
        good=pf.simulate(page, press, seed=1),
        bad=pf.simulate(page, press, misprint=MISPRINT, seed=1),
        other=pf.simulate(make_page(11), press, seed=1),
    )


def told(inspection: pf.Inspection) -> tuple[object, ...]:
    """What two inspections of one scan must agree in."""
    verdict = inspection.verdict
    return verdict.verdict, verdict.kind, verdict.regions, verdict.score, verdict.threshold, verdict.p_value


def test_an_inspection_is_whole(bench: Bench) -> None:
    assert bench.detector.name
    assert bench.detector.guarantee
    for scan in (bench.good, bench.bad):
        found = bench.ready.inspect(scan, seed=1)
        assert found.verdict.page == bench.page.name
        assert found.verdict.detector == bench.detector.name
        assert found.regions == found.verdict.regions
        part = scan.dn[(slice(None), *found.area)]
        assert np.array_equal(found.measured_dn, part)
        assert found.expect().expected_dn.shape == part.shape
        sensors, rows, columns = found.block_z.shape
        assert sensors in (1, len(bench.press.sensors))
        assert (rows, columns) == tuple(size // BLOCK_PIXELS for size in part.shape[1:])
        assert np.isfinite(found.block_z).all()
        assert isinstance(found.state().amounts, dict)


def test_what_is_expected_is_in_the_camera_s_own_numbers(bench: Bench) -> None:
    found = bench.ready.inspect(bench.good)
    measured, expected = found.measured_dn[0].astype(float), found.expect().expected_dn[0]
    assert np.median(np.abs(measured - expected)) < 0.02 * bench.press.sensors[0].white_dn


def test_a_misprint_scores_higher_and_alarms(bench: Bench) -> None:
    good, bad = (bench.ready.inspect(scan).verdict for scan in (bench.good, bench.bad))
    assert bad.verdict == "misprint"
    assert good.score is not None
    assert bad.score is not None
    assert bad.score > good.score


def test_kept_evidence_is_decided_again_alike(bench: Bench) -> None:
    for scan in (bench.good, bench.bad, bench.other):
        found = bench.ready.inspect(scan)
        kept = StoredArrays(dict(found.stored_arrays), bench.detector.name)
        again = bench.detector.decided_again(kept)
        assert (again.misprint or kept.wrong_page) == (found.verdict.verdict == "misprint")
        for name in ("score", "threshold", "p_value", "probability"):
            figure = Figure(name=name, recorded=getattr(found.verdict, name), again=getattr(again, name))
            assert figure.same, figure


def test_another_page_is_a_misprint(bench: Bench) -> None:
    assert bench.ready.inspect(bench.other).verdict.verdict == "misprint"


def test_evidence_of_nothing_is_refused(bench: Bench) -> None:
    with pytest.raises(RequestError, match=bench.detector.name):
        bench.detector.decided_again(StoredArrays({}, bench.detector.name))


def test_the_same_detector_is_had_at_another_station(bench: Bench) -> None:
    press_context = bench.press.press_context(threads=1)
    moved = bench.detector.at(press_context)
    assert moved.press_context is press_context
    assert (type(moved), moved.name) == (type(bench.detector), bench.detector.name)
    ready = moved.prepare(pf.PlannedPage(bench.page, press_context))
    assert told(ready.inspect(bench.bad)) == told(bench.ready.inspect(bench.bad))
    under = bench.ready.under(press_context)
    assert under is None or told(under.inspect(bench.bad)) == told(bench.ready.inspect(bench.bad))


def test_threads_inspect_at_once_and_agree(bench: Bench) -> None:
    alone = [told(bench.ready.inspect(scan, seed=2)) for scan in (bench.good, bench.bad)]
    with ThreadPoolExecutor(4) as pool:
        scans = [bench.good, bench.bad] * 3
        found = list(pool.map(lambda scan: told(bench.ready.inspect(scan, seed=2)), scans))
    assert found == alone * 3


def test_a_detector_travels_to_other_processes(bench: Bench) -> None:
    there = pickle.loads(pickle.dumps(bench.detector))
    ready = there.prepare(pf.PlannedPage(bench.page, there.press_context))
    assert told(ready.inspect(bench.bad)) == told(bench.ready.inspect(bench.bad))


def test_an_inspector_takes_it_and_shows_what_it_found(bench: Bench) -> None:
    found = pf.Inspector(bench.press, bench.detector).inspect(bench.page, bench.bad)
    assert told(found) == told(bench.ready.inspect(bench.bad))
    assert found.verdict.milliseconds > 0
    assert "data:image/png;base64," in found._repr_html_()
