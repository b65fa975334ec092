"""One page and its scan: good prints pass, misprints are found where they are. Seeds fixed."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.disposition import without_gate
from prooflight.detectors.paper.detector import PaperDetector
from prooflight.detectors.registry import BUILT_IN, detector
from prooflight.detectors.verdict import Decision, Verdict
from prooflight.errors import RequestError, ScanError
from prooflight.inspection.inspector import Inspector
from prooflight.rng import stream
from prooflight.simulation.scans import KINDS, MisprintRequest, SimulatedScan, scan_page

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.detectors.base import Inspection, StoredArrays
    from prooflight.detectors.paper.evidence import Evidence
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

    MakePage = Callable[..., Page]

LOCAL_KINDS = [kind for kind in KINDS if kind in ("streak", "missing-content")]


def printed(page: Page, press: Press, seed: int, request: MisprintRequest | None = None) -> SimulatedScan:
    def no_other(number: int) -> Page:
        raise AssertionError(number)

    return scan_page(
        page, press=press, request=request, others=(), fetch=no_other, rng=stream(seed, "print", page.number)
    )


def inspected(
    page: Page, scan: np.ndarray, press: Press, *, name: str = "chi-square", seed: int = 0
) -> Inspection:
    return Inspector.of(press, name).inspect(page, scan, scan_name="p0001.tif", seed=seed)


# --- good prints ---


@pytest.mark.parametrize("seed", range(1, 9))
def test_a_good_print_passes(press: Press, make_page: MakePage, seed: int) -> None:
    page = make_page(seed)
    verdict = inspected(page, printed(page, press, seed).dn, press, seed=seed).verdict
    assert verdict.verdict == "good"
    assert without_gate(verdict) == ("accept", "default")
    assert verdict.kind is None
    assert verdict.regions == ()
    assert verdict.page == page.name
    assert verdict.score is not None
    assert verdict.threshold is not None
    assert verdict.score <= verdict.threshold
    assert verdict.milliseconds > 0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_good_print_passes_on_two_sensors(two_sensor_press: Press, make_page: MakePage, seed: int) -> None:
    page = make_page(seed)
    assert (
        inspected(page, printed(page, two_sensor_press, seed).dn, two_sensor_press).verdict.verdict == "good"
    )


def test_a_blank_page_passes(press: Press, make_page: MakePage) -> None:
    page = make_page(1)
    blank = replace(page, cmyk=np.zeros_like(page.cmyk))
    assert inspected(blank, printed(blank, press, 1).dn, press).verdict.verdict == "good"


def test_lines_after_the_page_do_not_matter(press: Press, page: Page) -> None:
    scan = printed(page, press, 1).dn
    longer = np.concatenate([scan, np.full_like(scan[:, :50], 4095)], axis=1)
    short, long = (inspected(page, one, press).verdict for one in (scan, longer))
    assert replace(short, milliseconds=0) == replace(long, milliseconds=0)


# --- misprints ---


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_severe_misprint_alarms(press: Press, make_page: MakePage, kind: str, seed: int) -> None:
    page = make_page(seed)
    scan = printed(page, press, seed, MisprintRequest(kind=kind, severity=0.9))
    verdict = inspected(page, scan.dn, press).verdict
    assert verdict.verdict == "misprint"
    assert without_gate(verdict) == ("stop", "default")
    # A bound of the p-value; of another page that is placed by few of its edges it comes to 0.998.
    assert verdict.probability == pytest.approx(1.0, abs=0.005)
    assert verdict.kind is not None
    assert verdict.regions
    assert verdict.score is not None
    assert verdict.threshold is not None
    assert verdict.score > verdict.threshold
    scores = [region.score for region in verdict.regions]
    assert min(scores) > 0
    for region in verdict.regions:
        assert region.x_mm >= 0
        assert region.y_mm >= 0
        assert region.x_mm + region.width_mm <= page.width_mm + 0.02
        assert region.y_mm + region.height_mm <= page.height_mm + 0.02


@pytest.mark.parametrize("kind", LOCAL_KINDS)
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("severity", [0.4, 0.9])
def test_the_strongest_region_of_a_local_misprint_lies_where_it_is(
    press: Press, make_page: MakePage, kind: str, seed: int, severity: float
) -> None:
    page = make_page(seed)
    scan = printed(page, press, seed, MisprintRequest(kind=kind, severity=severity))
    assert scan.misprint is not None
    verdict = inspected(page, scan.dn, press).verdict
    assert verdict.verdict == "misprint"
    x, y, width, height = scan.misprint.region_mm
    found = verdict.regions[0]
    block = 8 * press.geometry.pixel_pitch_mm
    across = min(x + width, found.x_mm + found.width_mm) - max(x, found.x_mm)
    along = min(y + height, found.y_mm + found.height_mm) - max(y, found.y_mm)
    assert across > 0
    assert along > 0
    # the box leaves the misprint by no more than the block that it shares and the next, which its light reaches
    reach = press.sensors[0].footprint.reach_mm + block
    assert found.x_mm >= x - block - reach
    assert found.x_mm + found.width_mm <= x + width + block + reach
    assert found.y_mm >= y - block - reach
    assert found.y_mm + found.height_mm <= y + height + block + reach


def test_a_misprint_that_only_the_second_sensor_sees(two_sensor_press: Press, page: Page) -> None:
    scan = printed(page, two_sensor_press, 1).dn
    good = inspected(page, scan, two_sensor_press).verdict
    scan[1, 150:250, 100:200] -= np.minimum(scan[1, 150:250, 100:200], 60)
    bad = inspected(page, scan, two_sensor_press).verdict
    assert (good.verdict, bad.verdict) == ("good", "misprint")


def test_the_scan_of_another_page_is_a_misprint(press: Press, make_page: MakePage) -> None:
    verdict = inspected(make_page(1), printed(make_page(2), press, 1).dn, press).verdict
    assert verdict.verdict == "misprint"


@dataclass(frozen=True, kw_only=True)
class Fixed:
    """A detector that has made up its mind."""

    misprint: bool
    probability: float
    name: str = "fixed"
    guarantee: str = "none"

    def stored_arrays(self, evidence: Evidence) -> dict[str, np.ndarray]:
        return {"block_z": evidence.block_z}

    def evidence_of(self, kept: StoredArrays, *, sensors: int) -> Evidence:
        raise NotImplementedError

    def decide(self, evidence: Evidence) -> Decision:
        assert evidence.block_z.size
        return Decision(
            misprint=self.misprint, score=2.0, threshold=1.0, p_value=None, probability=self.probability
        )


@pytest.mark.parametrize(
    ("misprint", "probability", "false_alarm_cents", "decided"),
    [
        (True, 0.6, 1.0, ("stop", "default")),  # stopping costs 0.4 cents, letting pass 0.6
        (True, 0.6, 2.0, ("accept", "costs")),  # 0.8 against 0.6
        (False, 0.6, 1.0, ("accept", "default")),  # no alarm, no stop
    ],
)
def test_whether_an_alarm_stops_the_press_is_a_matter_of_cost(
    press: Press,
    page: Page,
    misprint: bool,
    probability: float,
    false_alarm_cents: float,
    decided: tuple[str, str],
) -> None:
    costs = RunningCosts(misprint_rate=0.01, false_alarm_cents=false_alarm_cents, missed_misprint_cents=1.0)
    scan = printed(page, press, 1).dn
    priced = replace(press, costs=costs)
    fixed = PaperDetector(
        press_context=priced.press_context(), test=Fixed(misprint=misprint, probability=probability)
    )
    verdict = Inspector(press=priced, detector=fixed).inspect(page, scan).verdict
    assert verdict.verdict == ("misprint" if misprint else "good")
    assert without_gate(verdict) == decided
    assert verdict.probability == probability
    assert verdict.p_value is None


# --- what cannot be inspected ---


@pytest.mark.parametrize("change", [-1, 1, 100])
def test_a_scan_of_another_width_is_refused(press: Press, page: Page, change: int) -> None:
    scan = np.zeros((1, 1000, 400 + change), np.uint16)
    with pytest.raises(ScanError) as refusal:
        inspected(page, scan, press)
    text = str(refusal.value)
    assert text.startswith("p0001.tif: ")
    assert f"{400 + change} pixels" in text
    assert "400 pixels" in text
    assert "\n" not in text


def test_a_scan_of_another_number_of_sensors_is_refused(
    press: Press, two_sensor_press: Press, page: Page
) -> None:
    for scanned, needed in ((press, two_sensor_press), (two_sensor_press, press)):
        with pytest.raises(ScanError, match="sensors"):
            inspected(page, printed(page, scanned, 1).dn, needed)


def test_a_scan_that_ends_before_its_page_is_refused(press: Press, page: Page) -> None:
    scan = printed(page, press, 1).dn
    rows, _ = press.geometry.on_page(page.width_mm, page.height_mm)
    assert inspected(page, scan[:, : rows.stop], press).verdict.verdict == "good"
    with pytest.raises(ScanError) as refusal:
        inspected(page, scan[:, : rows.stop - 1], press)
    text = str(refusal.value)
    assert text.startswith(f"p0001.tif: ends after {rows.stop - 1} lines")
    assert f"needs {rows.stop} lines" in text
    with pytest.raises(ScanError):
        inspected(page, scan[:, :0], press)


def test_there_is_no_such_detector(press: Press) -> None:
    with pytest.raises(RequestError) as refusal:
        detector("oracle", press)
    assert "'oracle'" in str(refusal.value)
    assert all(name in str(refusal.value) for name in BUILT_IN)


# --- verdicts ---


def test_verdicts_go_into_json(press: Press, page: Page) -> None:
    scans = [
        printed(page, press, 1).dn,
        printed(page, press, 1, MisprintRequest(kind="streak", severity=0.9)).dn,
    ]
    for scan, word in zip(scans, ("good", "misprint"), strict=True):
        read = json.loads(json.dumps(asdict(inspected(page, scan, press).verdict), allow_nan=False))
        assert read["verdict"] == word
        assert 0 <= read["probability"] <= 1
        assert isinstance(read["milliseconds"], float)


def test_a_page_without_a_scan_is_passed_on_and_said_so() -> None:
    verdict = Verdict.skipped("p0009")
    assert (verdict.page, verdict.verdict, without_gate(verdict)[0]) == ("p0009", "not-inspected", "hold")
    json.dumps(asdict(verdict), allow_nan=False)


def test_an_inspection_holds_what_it_rests_on(press: Press, page: Page) -> None:
    scan = printed(page, press, 1).dn
    inspection = inspected(page, scan, press)
    area = (slice(None), *press.geometry.on_page(page.width_mm, page.height_mm))
    np.testing.assert_array_equal(inspection.measured_dn, scan[area])
    assert inspection.expect().expected_dn.shape == inspection.measured_dn.shape
    assert inspection.stored_arrays["tile_histogram"].sum() == inspection.measured_dn.size


def test_same_scan_same_verdict(press: Press, page: Page) -> None:
    scan = printed(page, press, 1).dn
    first, again = (replace(inspected(page, scan, press, seed=3).verdict, milliseconds=0) for _ in range(2))
    other = replace(inspected(page, scan, press, seed=4).verdict, milliseconds=0)
    assert first == again
    assert first.score != other.score  # another draw of the integral transform
