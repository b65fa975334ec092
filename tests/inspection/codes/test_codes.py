"""Codes of a page are found in its prediction and read in its scans, which are of the ideal world here."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import zxingcpp

from prooflight.detectors.base import PlannedPage
from prooflight.detectors.disposition import without_gate
from prooflight.inspection.codes.finding import page_codes
from prooflight.inspection.codes.reading import KIND, failed_again, read_codes
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.redeciding import evidence_to_store, replayed
from prooflight.pages.raster import Page
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.inspection.codes.finding import PageCode
    from prooflight.press.artefact import Press

    MakePage = Callable[..., Page]

TEXT = "PROOF-1234"
MODULE_MM = 0.45


def with_code(
    page: Page, *, symbology: str = "QRCode", text: str = TEXT, module_mm: float = MODULE_MM, ink: int = 3
) -> Page:
    """The page with a white field in which a code stands, 4 mm from the page's left and top edges."""
    drawn = zxingcpp.create_barcode(text, getattr(zxingcpp.BarcodeFormat, symbology))
    dark = np.array(drawn.to_image(scale=1, add_hrt=False, add_quiet_zones=False)) < 128
    if symbology not in ("QRCode", "DataMatrix"):
        dark = np.repeat(dark[:1], round(9.0 / module_mm), axis=0)
    edges = [np.rint(np.arange(size + 1) * module_mm / page.pixel_mm).astype(int) for size in dark.shape]
    pattern = np.repeat(np.repeat(dark, np.diff(edges[0]), axis=0), np.diff(edges[1]), axis=1)
    cmyk = page.cmyk.copy()
    quiet, first = round(2.5 / page.pixel_mm), round(4.0 / page.pixel_mm)
    rows, columns = pattern.shape
    cmyk[first - quiet : first + rows + quiet, first - quiet : first + columns + quiet] = 0
    cmyk[first : first + rows, first : first + columns, ink] = np.where(pattern, 255, 0)
    return replace(page, cmyk=cmyk)


def found(page: Page, press: Press) -> tuple[PageCode, ...]:
    return page_codes(PlannedPage(page, press.press_context(threads=1)), press.sensors, press.geometry)


def scanned(page: Page, press: Press, seed: int = 3) -> NDArray[np.uint16]:
    return ideal_scan(press.press_context(threads=1).predict(page), press, stream(seed, "print", 1))


@pytest.mark.parametrize("symbology", ["QRCode", "DataMatrix", "Code128", "Code39", "ITF"])
def test_a_code_is_found_with_its_text_and_its_place(press: Press, page: Page, symbology: str) -> None:
    text = "12345678" if symbology == "ITF" else "PRF12"
    module_mm = {"Code39": 0.25, "Code128": 0.3, "ITF": 0.3}.get(symbology, MODULE_MM)
    (code,) = found(with_code(page, symbology=symbology, text=text, module_mm=module_mm), press)
    assert code.symbol.text == text
    assert code.sure
    assert code.box_mm[:2] == pytest.approx((4.0, 4.0), abs=0.5)  # readers say corners to a module or so


def test_a_page_without_codes_has_none(press: Press, page: Page) -> None:
    assert found(page, press) == ()


def test_codes_are_listed_from_top_to_bottom(press: Press, make_page: MakePage) -> None:
    page = make_page(7, height_mm=60.0)
    upper = with_code(page)
    both = replace(page, cmyk=np.concatenate([upper.cmyk, with_code(page, text="SECOND").cmyk]))
    assert [code.symbol.text for code in found(both, press)] == [TEXT, "SECOND"]


def test_a_code_too_fine_for_the_camera_is_not_asked_of_scans(press: Press, page: Page) -> None:
    """0.15 mm is 1.4 pixels: whether such a code reads hangs on where its squares fall."""
    codes = found(with_code(page, module_mm=0.15), press)
    assert not any(code.sure for code in codes)


def test_a_good_print_reads(press: Press, page: Page) -> None:
    inspector = Inspector.of(press, "chi-square")
    printed = with_code(page)
    verdict = inspector.inspect(printed, scanned(printed, press)).verdict
    assert verdict.verdict == "good"
    (code,) = verdict.codes
    assert code.read == code.text == TEXT
    assert code.grade is not None
    assert code.grade >= 3


def test_a_code_in_a_colour_that_only_the_second_sensor_sees_well_reads(
    two_sensor_press: Press, page: Page
) -> None:
    printed = with_code(page, ink=2, module_mm=0.6)  # yellow
    codes = found(printed, two_sensor_press)
    read = read_codes(
        codes,
        scanned(printed, two_sensor_press),
        IN_PLACE,
        page=printed,
        sensors=two_sensor_press.sensors,
        geometry=two_sensor_press.geometry,
    )
    assert [code.read for code in read] == [TEXT]


def test_a_code_is_read_where_the_page_lies(press: Press, page: Page) -> None:
    """Off its place by more than the margin that is read with a code."""
    printed, off = with_code(page), Placement(shift_mm=(2.2, 4.1))
    dn = np.rint(press.press_context(threads=1).predict(printed, off).expected_dn).astype(np.uint16)
    codes = found(printed, press)
    where = {"page": printed, "sensors": press.sensors, "geometry": press.geometry}
    (there,) = read_codes(codes, dn, off, **where)
    (elsewhere,) = read_codes(codes, dn, IN_PLACE, **where)
    assert there.read == TEXT
    assert elsewhere.read is None


class Passing:
    """Stands in for what a detector prepared: finds every page good."""

    def __init__(self, known: object) -> None:
        self._known = known

    def inspect(self, scan: object, *, seed: int = 0) -> object:
        done = self._known.inspect(scan, seed=seed)  # type: ignore[attr-defined]
        good = replace(done.verdict, verdict="good", kind=None, reason="", regions=(), score=0.0)
        return replace(done, verdict=good)


def passing(inspector: Inspector, page: Page) -> object:
    prepared = inspector.prepare(page)
    return replace(prepared, prepared_page=Passing(prepared.prepared_page))


def test_a_code_that_does_not_read_is_a_misprint_by_name(press: Press, page: Page) -> None:
    inspector = Inspector.of(press, "chi-square")
    printed = with_code(page)
    spoilt = replace(printed, cmyk=printed.cmyk.copy())
    middle = slice(round(6.0 / page.pixel_mm), round(11.0 / page.pixel_mm))
    spoilt.cmyk[middle, middle, 3] = 0
    done = inspector.inspect(passing(inspector, printed), scanned(spoilt, press))  # type: ignore[arg-type]
    verdict = done.verdict
    assert (verdict.verdict, without_gate(verdict)[0], verdict.kind) == ("misprint", "stop", KIND)
    assert verdict.reason == f"QR Code '{TEXT}' at x = 4 mm, y = 4 mm does not read"
    assert [region.kind for region in verdict.regions] == [KIND]
    assert verdict.codes[0].grade == 0
    kept = evidence_to_store(done, printed, press)
    assert failed_again(kept)


def test_another_text_in_the_same_place_is_a_misprint_that_says_both(press: Press, page: Page) -> None:
    inspector = Inspector.of(press, "chi-square")
    printed, other = with_code(page), with_code(page, text="PROOF-1235")
    prepared = passing(inspector, printed)
    verdict = inspector.inspect(prepared, scanned(other, press)).verdict  # type: ignore[arg-type]
    assert verdict.verdict == "misprint"
    assert verdict.reason.endswith("reads 'PROOF-1235'")
    assert verdict.codes[0].read == "PROOF-1235"


def test_a_detector_s_own_misprint_keeps_its_kind(press: Press, page: Page) -> None:
    inspector = Inspector.of(press, "chi-square")
    printed = with_code(page)
    spoilt = replace(printed, cmyk=printed.cmyk.copy())
    spoilt.cmyk[: spoilt.cmyk.shape[0] // 2, :, 3] = 0
    verdict = inspector.inspect(printed, scanned(spoilt, press)).verdict
    assert verdict.verdict == "misprint"
    assert verdict.kind != KIND
    if verdict.kind != "wrong-page":
        assert verdict.codes[0].failed
        assert verdict.regions[-1].kind == KIND


def test_a_verdict_by_a_code_is_made_again_from_evidence(press: Press, page: Page) -> None:
    inspector = Inspector.of(press, "chi-square")
    printed = with_code(page)
    done = inspector.inspect(printed, scanned(printed, press))
    unread = replace(done.verdict, verdict="misprint", kind=KIND)
    grey = np.full((40, 40), 220, np.uint8)
    kept = {
        **evidence_to_store(done, printed, press),
        "code0": grey,
        "code0_text": np.frombuffer(TEXT.encode(), np.uint8),
        "code0_symbology": np.frombuffer(b"QR Code", np.uint8),
    }
    assert all(figure.same for figure in replayed(unread, kept, press))
    assert not all(figure.same for figure in replayed(done.verdict, kept, press))


def test_where_a_page_was_not_inspected_its_codes_are_not_asked(press: Press, page: Page) -> None:
    inspector = Inspector.of(press, "chi-square")
    printed = with_code(page)
    dark = (scanned(printed, press) // 8).astype(np.uint16)
    verdict = inspector.inspect(printed, dark).verdict
    assert verdict.verdict == "not-inspected"
    assert verdict.codes == ()
