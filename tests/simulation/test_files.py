from __future__ import annotations

import json
import pickle
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.errors import RequestError
from prooflight.pages.files import write_tiff
from prooflight.pages.job import JobSource
from prooflight.rng import stream
from prooflight.scans.recorded import recorded_scans
from prooflight.simulation.files import ScanToFile, stored_truths, write_truth
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight.simulation.worlds import worlds_digest

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@pytest.fixture
def task(tmp_path: Path, make_page: Callable[..., Page], two_sensor_press: Press) -> ScanToFile:
    folder = tmp_path / "job"
    folder.mkdir()
    write_tiff(make_page(1, width_mm=20, height_mm=18), folder / "1.tif")
    write_tiff(make_page(2, width_mm=60, height_mm=25), folder / "2.tif")  # lies across the field of 42 mm
    out = tmp_path / "scans"
    out.mkdir()
    return ScanToFile(
        job=JobSource(path=folder, dpi=300.0),
        press=two_sensor_press,
        out=out,
        request=MisprintRequest(kind="streak", severity=0.7),
        seed=9,
        job_pages=2,
    )


def test_the_file_holds_what_was_simulated_and_the_truth_says_what_was_done(task: ScanToFile) -> None:
    truth = pickle.loads(pickle.dumps(task))(1)
    (scan,) = recorded_scans(task.out, sensors=2)
    assert scan.name == truth["page"] == "p0001"
    assert truth["file"] == str(scan.path)
    with task.job.open() as job:
        page = job.page(1)
        again = scan_page(
            page,
            press=task.press,
            request=task.request,
            others=(2,),
            fetch=job.page,
            rng=stream(9, "print", 1),
        )
    np.testing.assert_array_equal(scan.read(), again.dn)
    assert truth["misprint"]["kind"] == "streak"
    assert truth["misprint"]["severity"] == 0.7
    assert again.misprint is not None
    assert tuple(truth["misprint"]["region_mm"]) == again.misprint.region_mm
    json.dumps(truth, allow_nan=False)


def test_a_page_that_fits_only_the_other_way_round_is_printed_turned(task: ScanToFile) -> None:
    task(2)
    (scan,) = recorded_scans(task.out, sensors=2)
    lines = task.press.geometry.lines(60.0)
    assert abs(scan.read().shape[1] - lines) <= 1


def test_truth_names_world_seed_and_press(task: ScanToFile, tmp_path: Path) -> None:
    truths = [task(1)]
    write_truth(tmp_path / "truth.json", truths, world="ideal", seed=9, press=task.press)
    read = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert read["world"] == "ideal"
    assert read["seed"] == 9
    assert read["press_digest"] == task.press.digest
    assert read["worlds_sha256"] == worlds_digest()
    assert [scan["page"] for scan in read["scans"]] == ["p0001"]
    assert {file.name for file in tmp_path.iterdir()} == {"job", "scans", "truth.json"}


def test_in_the_press_world_truth_tells_session_and_prints(task: ScanToFile, tmp_path: Path) -> None:
    pressed = replace(task, world="press", request=None)
    truths = [pressed(1), pickle.loads(pickle.dumps(pressed))(2)]
    write_truth(tmp_path / "truth.json", truths, world="press", seed=9, press=task.press)
    read = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert read["world"] == "press"
    assert len(read["session"]["sensors"]) == 2
    assert read["session"]["amounts"]["register"]["plane_um"] == 48.0
    placed = [scan["print"]["shift_mm"] for scan in read["scans"]]
    assert placed[0] != placed[1]
    assert np.abs(placed).max() <= 0.76
    before = [scan.read() for scan in recorded_scans(task.out, sensors=2)]
    again = pressed(1)  # whatever came before
    assert again == truths[0]
    np.testing.assert_array_equal(recorded_scans(task.out, sensors=2)[0].read(), before[0])


def test_in_the_ideal_world_truth_has_neither(task: ScanToFile, tmp_path: Path) -> None:
    write_truth(tmp_path / "truth.json", [task(1)], world="ideal", seed=9, press=task.press)
    read = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert read["session"] is None
    assert read["scans"][0]["print"] is None


def test_pages_printed_again_replace_theirs_and_leave_the_truth_of_all_others(
    task: ScanToFile, tmp_path: Path
) -> None:
    path, press = tmp_path / "truth.json", task.press
    first = [task(1), task(2)]
    write_truth(path, first, world="ideal", seed=9, press=press)
    assert stored_truths(path, {"p0001", "p0002"}, world="press", seed=4, press=press) == []
    kept = stored_truths(path, {"p0001"}, world="ideal", seed=9, press=press)
    assert [truth["page"] for truth in kept] == ["p0002"]
    again = replace(task, request=MisprintRequest(kind="spots-voids", severity=0.5))(1)
    write_truth(path, [*kept, again], world="ideal", seed=9, press=press)
    read = json.loads(path.read_text(encoding="utf-8"))["scans"]
    assert [scan["page"] for scan in read] == ["p0001", "p0002"]
    assert read[0]["misprint"]["kind"] == "spots-voids"
    assert read[1] == json.loads(json.dumps(first[1]))


@pytest.mark.parametrize("other", [{"world": "press"}, {"seed": 10}])
def test_scans_of_another_world_or_seed_are_not_mixed(
    task: ScanToFile, tmp_path: Path, other: dict[str, Any]
) -> None:
    path = tmp_path / "truth.json"
    write_truth(path, [task(1), task(2)], world="ideal", seed=9, press=task.press)
    same: dict[str, Any] = {"world": "ideal", "seed": 9, "press": task.press}
    with pytest.raises(RequestError, match="describes 1 scans of another world, seed or press"):
        stored_truths(path, {"p0001"}, **(same | other))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"scans": 3}', '{"scans": [{}]}', "\x00"])
def test_a_truth_that_is_none_is_refused_in_one_line(task: ScanToFile, tmp_path: Path, text: str) -> None:
    path = tmp_path / "truth.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RequestError) as refused:
        stored_truths(path, set(), world="ideal", seed=9, press=task.press)
    assert "\n" not in str(refused.value)
    assert stored_truths(tmp_path / "none.json", set(), world="ideal", seed=9, press=task.press) == []
