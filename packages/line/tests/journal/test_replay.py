"""A verdict comes out of the journal's evidence and the press file again, to the last digit."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.detectors.matched_filter.calibrated import WRONG_PAGE
from prooflight.detectors.paper.bayes import BayesDetector, BayesianNetwork
from prooflight.detectors.verdict import Verdict
from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.redeciding import Figure, decided_again, evidence_to_store, replayed
from prooflight.press.artefact import Press
from prooflight.rng import stream
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunFacts

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.detectors.base import Inspection
    from prooflight.pages.raster import Page

    MakePage = Callable[..., Page]
    Looks = list[tuple[Inspection, dict[str, np.ndarray]]]

KINDS = ("", "streak", "wrong-page")


def scanned(page: Page, press: Press, kind: str, other: Page) -> np.ndarray:
    """A scan in the ideal world."""
    request = MisprintRequest(kind=kind, severity=0.9) if kind == "streak" else None
    shown = other if kind == "wrong-page" else page
    rng = stream(4, "print", page.number)
    return scan_page(shown, press=press, request=request, others=(), fetch=lambda _: other, rng=rng).dn


@pytest.fixture(scope="module")
def bayes_press(press: Press) -> Press:
    """The press with a network that learned from made-up statistics: good pages near N(0, 1)'s, misprints not."""
    rng = np.random.default_rng(3)
    good = np.column_stack([rng.normal(0, 0.02, 200), rng.normal(-4, 0.3, 200), rng.normal(0.5, 0.005, 200)])
    bad = good + rng.normal(0, [0.3, 4.0, 0.05], good.shape)
    labels = ["correct"] * 200 + ["local"] * 100 + ["global"] * 100
    network = BayesianNetwork.learn(np.vstack([good, bad]), labels, misprint_rate=0.01)
    return press.with_detector("bayes", BayesDetector(network=network, threshold=0.5, unit=np.ones(1)))


@pytest.fixture(scope="module", params=["chi-square", "matched_filter", "bayes"])
def inspector(request: pytest.FixtureRequest, press: Press, bayes_press: Press) -> Inspector:
    of_name = {"chi-square": press, "bayes": bayes_press}
    trained = of_name.get(request.param) or request.getfixturevalue("trained_press")
    return Inspector.of(trained, request.param)


@pytest.fixture(scope="module")
def looks(inspector: Inspector, make_page: MakePage) -> Looks:
    """A good print, a streak and another page, inspected, with what is kept of each."""
    page = make_page(3)
    other = replace(page, cmyk=page.cmyk[::-1, ::-1].copy())
    prepared, found = inspector.prepare(page), []
    for kind in KINDS:
        inspection = inspector.inspect(
            prepared, scanned(page, inspector.press, kind, other), scan_name="scan"
        )
        found.append((inspection, dict(evidence_to_store(inspection, prepared.page, inspector.press))))
    return found


def test_verdicts_are_replayed_from_the_journal_to_the_last_digit(
    looks: Looks, inspector: Inspector, tmp_path: Path
) -> None:
    assert looks[-1][0].verdict.verdict == "misprint"
    digest = inspector.press.save(tmp_path / "x.press")
    told = RunFacts(
        job="j", job_digest="", press="p", press_digest=digest, detector="", source="", started_s=0.0
    )
    with Journal.open(str(tmp_path / "j.sqlite")) as journal:
        run = journal.begin_run(told)
        for sheet, (inspection, kept) in enumerate(looks):
            record = PageRecord(
                sheet=sheet,
                job_page=sheet,
                verdict=inspection.verdict,
                late=False,
                first_line=0,
                time_s=0.0,
                evidence=kept,
            )
            journal.record(run, record)
    press = Press.load(tmp_path / "x.press")
    with Journal.open(str(tmp_path / "j.sqlite"), read_only=True) as journal:
        assert journal.run(run).facts.press_digest == press.digest
        for sheet, (inspection, _) in enumerate(looks):
            page = journal.page(run, sheet)
            assert page.evidence is not None
            figures = replayed(page.verdict, page.evidence, press)
            assert [figure.name for figure in figures] == [
                *("verdict", "score", "threshold", "p_value", "probability")
            ]
            for figure in figures:
                assert figure.same
                assert figure.again == getattr(inspection.verdict, figure.name)  # no rounding on one machine


def test_other_evidence_gives_other_figures(looks: Looks, inspector: Inspector) -> None:
    (good, _), (_, kept) = looks[:2]
    figures = {figure.name: figure for figure in replayed(good.verdict, kept, inspector.press)}
    assert not figures["score"].same
    assert figures["threshold"].same


def test_a_scan_of_another_page_keeps_its_score(looks: Looks, inspector: Inspector) -> None:
    """Ours gives it one above that of any evidence; the paper's detectors give it none of its own."""
    kept = looks[0][1]
    good, wrong = (
        decided_again(kept | {"wrong_page": np.array(word)}, inspector.press, inspector.detector.name)
        for word in (False, True)
    )
    if inspector.detector.name == "matched_filter":
        assert good.score < wrong.score == WRONG_PAGE
        assert wrong.misprint
    else:
        assert good == wrong


def test_evidence_of_another_detector_is_refused(
    looks: Looks, bayes_press: Press, inspector: Inspector
) -> None:
    other = "bayes" if inspector.detector.name == "chi-square" else "chi-square"
    with pytest.raises(RequestError, match="does not hold"):
        decided_again(looks[0][1], bayes_press, other)


def test_cuts_show_the_scan_at_the_places_of_a_misprint(
    looks: Looks, inspector: Inspector, make_page: MakePage
) -> None:
    inspection, kept = looks[1]
    if inspection.verdict.verdict == "good":
        pytest.skip("this detector does not see a streak")
    page, geometry = make_page(3), inspector.press.geometry
    scan = scanned(page, inspector.press, KINDS[1], make_page(4))
    region = inspection.verdict.regions[0]
    x, y, width, height = kept["cut0_mm"]
    shift_x, shift_y = inspection.placement.shift_mm
    left = (x + geometry.left_mm(page.width_mm) + shift_x) / geometry.pixel_pitch_mm
    top = (y + geometry.lead_in_mm + shift_y) / geometry.line_pitch_mm
    _, lines, pixels = kept["cut0"].shape
    first, start = round(top), round(left)
    np.testing.assert_array_equal(kept["cut0"], scan[:, first : first + lines, start : start + pixels])
    assert (pixels, lines) == (
        round(width / geometry.pixel_pitch_mm),
        round(height / geometry.line_pitch_mm),
    )
    # the middle of the place is in it, and it is no larger than it may be
    assert x <= region.x_mm + region.width_mm / 2 <= x + width
    assert y <= region.y_mm + region.height_mm / 2 <= y + height
    assert max(lines, pixels) <= 257
    assert not any(name.startswith("cut") for name in looks[0][1]) or looks[0][0].verdict.regions


@pytest.mark.parametrize(
    ("recorded", "again", "same"),
    [
        (1.0, 1.0 + 1e-12, True),
        (1.0, 1.0 + 1e-6, False),
        (float("nan"), float("nan"), True),
        (float("inf"), 1.0, False),
        (None, None, True),
        (None, 0.0, False),
        ("good", "misprint", False),
    ],
)
def test_figures_are_the_same_but_for_rounding(recorded: Any, again: Any, same: bool) -> None:
    assert Figure(name="score", recorded=recorded, again=again).same is same


def test_what_nobody_compared_cannot_be_replayed(press: Press) -> None:
    verdict = Verdict(page="p0001", verdict="not-inspected")
    with pytest.raises(RequestError, match="p0001: was not compared"):
        replayed(verdict, {}, press)
