"""Worker processes that inspect: the same verdicts, death of a worker, and nothing left behind."""

from __future__ import annotations

import gc
import os
import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.registry import detector
from prooflight.errors import ProoflightError, ScanError
from prooflight.inspection.inspector import Inspector
from prooflight.rng import stream
from prooflight.simulation.scans import ideal_scan
from prooflight_line.run.inspection_workers import InspectionWorkers, worker_count
from prooflight_line.run.shared_designs import SharedDesigns, read_design
from prooflight_line.run.sheet_inspector import SheetInspector

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Verdict
    from prooflight.inspection.packed_design import PackedDesign
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "prooflight" / "workers"


@pytest.fixture
def workers(cache: Path) -> Iterator[InspectionWorkers]:
    made = InspectionWorkers(2, processors=2)
    yield made
    made.close()


@pytest.fixture(scope="module")
def alone(trained_press: Press) -> SheetInspector:
    """Inspector in this process."""
    return SheetInspector(inspector=Inspector(trained_press).with_threads(1), keep="all")


@pytest.fixture(scope="module")
def ready(alone: SheetInspector, page: Page) -> PackedDesign:
    return alone.prepare(page)


def scan_of(page: Page, press: Press, number: int, *, hole: bool) -> NDArray[np.uint16]:
    scan = ideal_scan(press.press_context(1).predict(page), press, stream(301, "print", number))
    if hole:
        scan[:, 200:230, 100:130] //= 2
    return scan


def test_workers_give_the_verdicts_of_this_process(
    alone: SheetInspector, ready: PackedDesign, page: Page, workers: InspectionWorkers, cache: Path
) -> None:
    press, by_workers = alone.inspector.press, replace(alone, workers=workers)
    scans = [scan_of(page, press, number, hole=number % 2 == 1) for number in range(4)]
    with ThreadPoolExecutor(4) as threads:  # more than there are workers: they wait for one that is free
        results = list(
            threads.map(
                lambda at: by_workers.inspect(ready, scans[at], name="it", seed=at, sheet=at), range(4)
            )
        )
    for at, (result, scan) in enumerate(zip(results, scans, strict=True)):
        expected = alone.inspect(ready, scan, name="it", seed=at, sheet=at)
        assert replace(result.verdict, milliseconds=0) == replace(expected.verdict, milliseconds=0)
        assert result.evidence.values == expected.evidence.values
        assert result.stored_evidence is not None
        assert expected.stored_evidence is not None
        for name, array in expected.stored_evidence.items():
            np.testing.assert_array_equal(result.stored_evidence[name], array)
    assert results[1].verdict.verdict == "misprint"
    assert len(list(cache.glob("*/*/*.design"))) == 1


def test_workers_with_two_threads_give_the_verdicts_of_one(
    alone: SheetInspector, ready: PackedDesign, page: Page, workers: InspectionWorkers
) -> None:
    """Whether they run depends on what other workers do; no value may."""
    in_two = replace(alone, inspector=alone.inspector.with_threads(2), workers=workers)
    for number, hole in ((1, True), (2, False)):
        scan = scan_of(page, alone.inspector.press, number, hole=hole)
        in_parts = in_two.inspect(ready, scan, name="it", seed=number, sheet=number)
        expected = alone.inspect(ready, scan, name="it", seed=number, sheet=number)
        assert replace(in_parts.verdict, milliseconds=0) == replace(expected.verdict, milliseconds=0)
        assert in_parts.evidence.values == expected.evidence.values


def test_workers_know_how_many_are_at_work(workers: InspectionWorkers) -> None:
    assert workers.at_work == 0
    with workers._reserved():
        assert workers.at_work == 1
        with workers._reserved():
            assert workers.at_work == 2
        assert workers.at_work == 1
    assert workers.at_work == 0


def test_a_misprint_is_known_before_its_worker_has_explained_it(
    alone: SheetInspector, ready: PackedDesign, page: Page, workers: InspectionWorkers
) -> None:
    known: list[Verdict] = []
    scan = scan_of(page, alone.inspector.press, 3, hole=True)
    by_workers = replace(alone, workers=workers)
    verdict = by_workers.inspect(ready, scan, name="it", seed=3, decided=known.append).verdict
    assert [(one.verdict, one.kind, one.score) for one in known] == [("misprint", None, verdict.score)]
    assert verdict.kind is not None


def test_light_that_is_followed_reaches_the_workers(
    alone: SheetInspector, ready: PackedDesign, page: Page, workers: InspectionWorkers
) -> None:
    press = alone.inspector.press
    darker = replace(
        press,
        sensors=tuple(
            replace(one, column_gain=(one.column_gain * 0.99).astype(one.column_gain.dtype))
            for one in press.sensors
        ),
    )
    scan = scan_of(page, press, 7, hole=False)
    by_workers = replace(alone, workers=workers)
    first = by_workers.inspect(ready, scan, name="it", seed=1)
    following = by_workers.following(darker)
    renewed = following.renewed(ready)
    second = following.inspect(renewed, scan, name="it", seed=1)
    expected = alone.following(darker).inspect(renewed, scan, name="it", seed=1)
    assert second.evidence.values == expected.evidence.values
    assert second.evidence.values != first.evidence.values


@pytest.mark.parametrize("begin", ["load", "rehearse"])
def test_every_worker_is_ready_before_the_first_sheet(
    alone: SheetInspector, ready: PackedDesign, page: Page, workers: InspectionWorkers, begin: str
) -> None:
    by_workers, scan = replace(alone, workers=workers), scan_of(page, alone.inspector.press, 3, hole=True)
    if begin == "load":
        by_workers.load(ready)
    else:
        by_workers.rehearse(ready, [scan])
    assert len(workers.processes) == 2


@pytest.mark.parametrize("room", [0.5, 1.5])
def test_designs_are_shared_written_out_while_there_is_room(
    alone: SheetInspector, ready: PackedDesign, tmp_path: Path, room: float
) -> None:
    """The second of two designs stays packed, and takes the place of the first once that is gone."""
    shared, first, second = (
        SharedDesigns(room_bytes=room * ready.written_bytes),
        replace(ready),
        replace(ready),
    )
    files = [shared.file(one, alone.inspector, tmp_path) for one in (first, second)]
    read = [read_design(file, alone.inspector) for file in files]
    assert [one.written_bytes == 0 for one in read] == [room > 1, False]
    for one in read:
        np.testing.assert_array_equal(one.unpacked().page.cmyk, ready.unpacked().page.cmyk)
    del first
    gc.collect()
    assert not files[0].exists()
    third = replace(ready)
    again = read_design(shared.file(third, alone.inspector, tmp_path), alone.inspector)
    assert (again.written_bytes == 0) == (room > 1)
    shared.close()
    assert list(tmp_path.iterdir()) == []


def test_designs_stay_packed_where_memory_cannot_be_shared(
    alone: SheetInspector, ready: PackedDesign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.getpid", lambda: 0)  # no process has this number, and so the link leads nowhere
    shared = SharedDesigns(room_bytes=10 * ready.written_bytes)
    for one in (ready, replace(ready)):
        read = read_design(shared.file(one, alone.inspector, tmp_path), alone.inspector)
        assert read.written_bytes == ready.written_bytes
    shared.close()
    assert list(tmp_path.iterdir()) == []


def test_a_worker_that_is_killed_costs_one_sheet(
    alone: SheetInspector, ready: PackedDesign, page: Page, cache: Path
) -> None:
    scan = scan_of(page, alone.inspector.press, 1, hole=False)
    workers = InspectionWorkers(1, processors=1)
    by_workers = replace(alone, workers=workers)
    first = by_workers.inspect(ready, scan, name="it", seed=1)
    (worker,) = workers.processes
    os.kill(worker, signal.SIGKILL)
    with pytest.raises(ProoflightError, match="worker process was killed"):
        by_workers.inspect(ready, scan, name="it", seed=1)
    again = by_workers.inspect(ready, scan, name="it", seed=1)
    assert replace(again.verdict, milliseconds=0) == replace(first.verdict, milliseconds=0)
    workers.close()
    assert list(cache.iterdir()) == []


def test_a_scan_that_does_not_fit_is_refused_as_in_this_process(
    alone: SheetInspector, ready: PackedDesign, page: Page, workers: InspectionWorkers
) -> None:
    scan = scan_of(page, alone.inspector.press, 1, hole=False)[:, :-40]
    with pytest.raises(ScanError) as expected:
        alone.inspect(ready, scan[:, :100], name="it", seed=1)
    with pytest.raises(ScanError) as refused:
        replace(alone, workers=workers).inspect(ready, scan[:, :100], name="it", seed=1)
    assert str(refused.value) == str(expected.value)


def test_designs_that_the_run_uses_no_more_leave_the_disk(
    alone: SheetInspector, page: Page, workers: InspectionWorkers, cache: Path
) -> None:
    scan = scan_of(page, alone.inspector.press, 1, hole=False)
    by_workers, own = replace(alone, workers=workers), alone.prepare(page)
    by_workers.inspect(own, scan, name="it", seed=1)
    assert len(list(cache.glob("*/*/*.design"))) == 1
    del own
    gc.collect()
    assert list(cache.glob("*/*/*.design")) == []


def test_what_a_killed_run_has_left_is_removed(cache: Path) -> None:
    (cache / "abc").mkdir(parents=True)
    (cache / "abc.lock").touch()
    running = InspectionWorkers(1, processors=1)
    second = InspectionWorkers(1, processors=1)
    assert len([one for one in cache.iterdir() if one.is_dir()]) == 2  # those of the two, not the old one
    running.close()
    second.close()


def test_few_threads_and_other_detectors_need_no_workers(alone: SheetInspector, press: Press) -> None:
    counts = [0, 2, 2, 2, 8]
    assert [worker_count(threads, alone.inspector) for threads in (1, 2, 3, 4, 16)] == counts
    waiting = [worker_count(threads, alone.inspector, source_waits=True) for threads in (1, 2, 3, 4, 16)]
    assert waiting == [0, 0, 0, 2, 8]
    assert worker_count(16, Inspector(press, detector("chi-square", press))) == 0
