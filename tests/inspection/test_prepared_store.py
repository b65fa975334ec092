"""Prepared designs in files: the same verdicts, refusal of what is damaged, and bounds."""

from __future__ import annotations

import os
import pickle
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import tifffile

from prooflight.inspection.inspector import Inspector
from prooflight.inspection.job import InspectPage
from prooflight.inspection.packed_design import PackedDesign
from prooflight.inspection.prepared_store import MAGIC, PreparedStore, _Unpickler, clean
from prooflight.press.pages import job_source
from prooflight.rng import stream
from prooflight.scans.scan import Scan
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@pytest.fixture(scope="module")
def inspector(trained_press: Press) -> Inspector:
    return Inspector(trained_press).with_threads(1)


@pytest.fixture(scope="module")
def known(inspector: Inspector, page: Page) -> PackedDesign:
    return PackedDesign.of(inspector.prepare(page), {"light": np.arange(6.0)})


@pytest.fixture
def store(inspector: Inspector, page: Page, tmp_path: Path) -> PreparedStore:
    job = tmp_path / "job.tif"
    tifffile.imwrite(job, page.cmyk, photometric="separated")
    store = PreparedStore.of(inspector, job_source(job, inspector.press), folder=tmp_path / "prepared")
    assert store is not None
    return store


def test_a_stored_design_gives_the_same_values(store: PreparedStore, known: PackedDesign, page: Page) -> None:
    store.save(3, known)
    loaded = store.load(3)
    assert loaded is not None
    press = store.inspector.press
    scan = ideal_scan(press.press_context(1).predict(page), press, stream(301, "print", 1))
    scan[:, 200:230, 100:130] //= 2
    one, other = (store.inspector.inspect(one.unpacked(), scan) for one in (known, loaded))
    assert one.verdict.verdict == "misprint"
    assert replace(one.verdict, milliseconds=0) == replace(other.verdict, milliseconds=0)
    np.testing.assert_array_equal(one.stored_arrays["values"], other.stored_arrays["values"])
    np.testing.assert_array_equal(known.additional["light"], loaded.additional["light"])
    assert store.load(4) is None
    # As after a cluster's press has come to a worker: the same types of numbers, in other objects.
    light = known.additional["light"]
    light = light.view(pickle.loads(pickle.dumps(light.dtype)))
    assert light.dtype is not known.additional["light"].dtype
    assert store.content(replace(known, additional={"light": light})) == store.content(known)


def test_a_recorded_scan_is_inspected_by_what_is_stored(
    store: PreparedStore, known: PackedDesign, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither is the page drawn again nor prepared."""
    press = store.inspector.press
    scan = Scan(
        dn=ideal_scan(press.press_context(1).predict(page), press, stream(301, "print", 2)), name="scan"
    )
    fresh = store.inspector.inspect(page, scan)
    store.save(page.number, known)
    monkeypatch.setattr("prooflight.inspection.job.read_scan", lambda *_: scan)
    monkeypatch.setattr(Inspector, "prepare", lambda *_: pytest.fail("the page was prepared again"))
    work = InspectPage(job=None, inspector=store.inspector, stored=store)  # type: ignore[arg-type]
    found = work.inspection(work.design(page.number), None)  # type: ignore[arg-type]
    assert replace(found.verdict, milliseconds=0) == replace(fresh.verdict, milliseconds=0)


@pytest.mark.parametrize("at", [0, len(MAGIC) + 3, 2000, -1])
def test_a_damaged_design_is_refused_in_one_line_and_removed(
    store: PreparedStore, known: PackedDesign, at: int, caplog: pytest.LogCaptureFixture
) -> None:
    store.save(1, known)
    (path,) = store.folder.iterdir()
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)
    assert store.load(1) is None
    assert not path.exists()
    assert [record.message.count("\n") for record in caplog.records] == [0]


def test_nothing_is_left_of_a_design_that_could_not_be_written(
    store: PreparedStore, known: PackedDesign, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(self: Path, target: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pathlib.Path.replace", killed)
    with pytest.raises(KeyboardInterrupt):
        store.save(1, known)
    assert not list(store.folder.iterdir())


def test_another_job_has_a_store_of_its_own(store: PreparedStore, page: Page, tmp_path: Path) -> None:
    job = tmp_path / "job.tif"
    tifffile.imwrite(job, page.cmyk[::-1], photometric="separated")
    other = PreparedStore.of(
        store.inspector, job_source(job, store.inspector.press), folder=store.folder.parent
    )
    assert other is not None
    assert other.folder != store.folder


def test_files_make_no_objects_but_designs() -> None:
    import io

    for harmful in (os.system, eval, MemoryError):
        with pytest.raises(pickle.UnpicklingError, match="is not part of a design"):
            _Unpickler(io.BytesIO(pickle.dumps(harmful)), {}, [], "prooflight").load()


def test_the_least_recently_used_jobs_are_removed(tmp_path: Path) -> None:
    for age, name in enumerate(("new", "middle", "old")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "000001.design").write_bytes(bytes(100))
        os.utime(tmp_path / name, (1000 - age, 1000 - age))
    assert clean(tmp_path, most_bytes=200) == 200
    assert sorted(one.name for one in tmp_path.iterdir()) == ["middle", "new"]
    assert clean(tmp_path, most_bytes=0, keep=tmp_path / "middle") == 100
