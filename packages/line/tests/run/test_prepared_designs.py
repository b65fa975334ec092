"""Designs prepared elsewhere: the same file as here, stored only where it came whole."""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING

import pytest

from prooflight.inspection.inspector import Inspector
from prooflight.inspection.prepared_store import PreparedStore
from prooflight.pages.files import write_tiff
from prooflight.press.pages import job_source
from prooflight_line.run.sheet_inspector import PrepareDesign

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@pytest.fixture
def work(trained_press: Press, page: Page, tmp_path: Path) -> PrepareDesign:
    job = tmp_path / "job.tif"
    write_tiff(page, job)
    source = job_source(job, trained_press)
    store = PreparedStore.of(Inspector(trained_press), source, folder=tmp_path / "prepared")
    assert store is not None
    return PrepareDesign(source=source, store=store)


def test_a_design_prepared_elsewhere_has_the_same_bytes(work: PrepareDesign) -> None:
    here, elsewhere = work(1), pickle.loads(pickle.dumps(work))(1)
    assert here == elsewhere
    assert not work.store.holds(1)
    work.store.put(1, elsewhere)
    assert work.store.holds(1)
    assert work.store.load(1) is not None


def test_a_design_that_was_damaged_on_the_way_is_not_stored(work: PrepareDesign) -> None:
    content = bytearray(work(1))
    content[-100] ^= 1
    with pytest.raises(ValueError, match="its digest does not match"):
        work.store.put(1, bytes(content))
    assert not work.store.holds(1)


def test_a_file_that_was_cut_off_is_prepared_again(work: PrepareDesign) -> None:
    work.store.put(1, work(1))
    (path,) = work.store.folder.iterdir()
    for length in (path.stat().st_size - 64, 40, 0):
        path.write_bytes(path.read_bytes()[:length])
        assert not work.store.holds(1)
