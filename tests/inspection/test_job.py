from __future__ import annotations

import pickle
from typing import TYPE_CHECKING

import numpy as np
import pytest
import tifffile

from prooflight.detectors.matched_filter.calibrated import score_of
from prooflight.detectors.matched_filter.detector import MatchedFilterPage
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.errors import ScanError
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.job import InspectPage, ScanPage, paired
from prooflight.pages.files import write_tiff
from prooflight.pages.job import JobSource
from prooflight.scans.recorded import write_scan
from prooflight.simulation.files import ScanToFile
from prooflight.simulation.scans import MisprintRequest

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

PAGES = 3


@pytest.fixture
def source(tmp_path: Path, make_page: Callable[..., Page]) -> JobSource:
    """A job of three small pages."""
    folder = tmp_path / "job"
    folder.mkdir()
    for number in range(1, PAGES + 1):
        write_tiff(make_page(number, width_mm=20, height_mm=18, number=number), folder / f"{number}.tif")
    return JobSource(path=folder, dpi=300.0)


@pytest.fixture
def scans(tmp_path: Path) -> Path:
    folder = tmp_path / "scans"
    folder.mkdir()
    return folder


def scan_files(folder: Path, *names: str) -> None:
    for number, name in enumerate(names):
        write_scan(folder / f"{name}.tif", np.full((1, 4, 5), number, np.uint16), facts={})


def names_of(source: JobSource, scans: Path, *, sensors: int = 1) -> list[tuple[int, str | None]]:
    with source.open() as job:
        return [
            (number, None if scan is None else scan.name)
            for number, scan in paired(job, scans, sensors=sensors)
        ]


def test_files_named_after_pages_belong_to_them(source: JobSource, scans: Path) -> None:
    scan_files(scans, "p0003", "p0001")
    assert names_of(source, scans) == [(1, "p0001"), (2, None), (3, "p0003")]


def test_other_names_follow_the_pages_in_order(source: JobSource, scans: Path) -> None:
    scan_files(scans, "b", "a")
    assert names_of(source, scans) == [(1, "a"), (2, "b"), (3, None)]


def test_numbers_in_names_count_as_numbers_as_they_do_in_a_job(source: JobSource, scans: Path) -> None:
    scan_files(scans, "scan9", "scan10", "scan11")
    assert names_of(source, scans) == [(1, "scan9"), (2, "scan10"), (3, "scan11")]


def test_gaps_in_the_numbers_of_names_are_pages_without_a_scan(source: JobSource, scans: Path) -> None:
    scan_files(scans, "scan-3", "scan-2")
    assert names_of(source, scans) == [(1, None), (2, "scan-2"), (3, "scan-3")]


def test_the_reason_says_where_a_missing_scan_was_looked_for(
    source: JobSource, scans: Path, press: Press
) -> None:
    inspect = InspectPage(job=source, inspector=Inspector.of(press, "chi-square"), scans=scans)
    assert inspect((2, None)).verdict.reason == f"the scan is missing (looked for p0002.tif in {scans})"


def test_a_file_that_is_no_tiff_keeps_its_place(source: JobSource, scans: Path) -> None:
    scan_files(scans, "a", "c")
    (scans / "b.tif").write_bytes(b"no TIFF")
    assert names_of(source, scans) == [(1, "a"), (2, "b"), (3, "c")]


def test_a_multi_page_file_is_in_page_order(source: JobSource, scans: Path) -> None:
    tifffile.imwrite(scans / "run.tif", np.zeros((PAGES, 4, 5), np.uint16), photometric="minisblack")
    with source.open() as job:
        pairs = paired(job, scans / "run.tif", sensors=1)
    assert [(number, None if scan is None else scan.first_image) for number, scan in pairs] == [
        (1, 0),
        (2, 1),
        (3, 2),
    ]


def test_a_scan_of_no_page_is_named(source: JobSource, scans: Path) -> None:
    scan_files(scans, "p0001", "p0004")
    with pytest.raises(ScanError, match=r"p0004\.tif is not in the job"):
        names_of(source, scans)


def test_all_scans_of_no_page_are_named_or_counted(source: JobSource, scans: Path) -> None:
    scan_files(scans, "p0001", "p0004", *[f"x{number}" for number in range(6)])
    with pytest.raises(ScanError) as refusal:
        names_of(source, scans)
    assert "p0004.tif, x0.tif, x1.tif, x2.tif, x3.tif and 2 more are not in the job" in str(refusal.value)
    assert "p0003" in str(refusal.value)


def test_more_scans_than_pages_are_refused(source: JobSource, scans: Path) -> None:
    scan_files(scans, "a", "b", "c", "d")
    with pytest.raises(ScanError) as refusal:
        names_of(source, scans)
    assert "4 scans" in str(refusal.value)
    assert "3 pages" in str(refusal.value)


def test_from_job_to_verdicts_by_way_of_files(source: JobSource, scans: Path, press: Press) -> None:
    """Print, scan, write, read, inspect; as worker processes would, through pickles."""
    for number, request in ((1, None), (3, MisprintRequest(kind="missing-plane", severity=1.0))):
        task = ScanToFile(job=source, press=press, out=scans, request=request, seed=5, job_pages=PAGES)
        pickle.loads(pickle.dumps(task))(number)
    inspect = pickle.loads(pickle.dumps(InspectPage(job=source, inspector=Inspector.of(press, "chi-square"))))
    with source.open() as job:
        verdicts = [inspect(pair).verdict for pair in paired(job, scans, sensors=1)]
    assert [verdict.page for verdict in verdicts] == ["p0001", "p0002", "p0003"]
    assert [verdict.verdict for verdict in verdicts] == ["good", "not-inspected", "misprint"]


def test_a_good_page_is_learned_from_by_what_its_scan_says(
    source: JobSource, scans: Path, trained_press: Press
) -> None:
    """As worker processes look at it; the same print once more is another scan, the same file is not."""
    for seed, name in ((5, "a"), (6, "b")):
        folder = scans / name
        folder.mkdir()
        ScanToFile(job=source, press=trained_press, out=folder, request=None, seed=seed, job_pages=PAGES)(1)
    matched_filter = model_of(trained_press)
    assert matched_filter is not None
    inspector = Inspector.of(trained_press, "matched_filter")
    look = pickle.loads(pickle.dumps(ScanPage(InspectPage(job=source, inspector=inspector))))
    with source.open() as job:
        first, again, other = (
            look((1, paired(job, scans / name, sensors=1)[0][1])) for name in ("a", "a", "b")
        )
        known = inspector.prepare(trained_press.geometry.lay(job.page(1))).prepared_page
    assert isinstance(known, MatchedFilterPage)
    assert first.name == "p0001"
    assert not first.another
    values = first.evidence["values"]
    assert values.shape == (len(matched_filter.model.statistics),)
    assert np.isfinite(values).all()
    asked = score_of(known.model, values, first.evidence["page_features"], another=False)
    assert first.score == pytest.approx(asked, rel=1e-5)
    assert first.digest == again.digest != other.digest


def test_a_bad_scan_is_named_by_its_path(source: JobSource, scans: Path, press: Press) -> None:
    scan_files(scans, "p0002")  # five pixels wide
    inspect = InspectPage(job=source, inspector=Inspector.of(press, "chi-square"))
    with source.open() as job:
        pairs = paired(job, scans, sensors=1)
    with pytest.raises(ScanError, match=r"p0002\.tif: .*5 pixels"):
        inspect(pairs[1])
