"""Presses and journals of the time when the matched filter was `ours`, labels `told` and page features `portrait`."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.journal.journals import facts, record
from safetensors.numpy import save

from prooflight.detectors.base import StoredArrays
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.registry import detector
from prooflight.detectors.verdict import Verdict
from prooflight.detectors.weighted_conformal import LabelledPages
from prooflight.errors import PressError
from prooflight.inspection.inspector import Inspector
from prooflight.press.artefact import KIND, Press, _digest
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.raster import Page


@pytest.fixture(scope="module")
def labelled(trained_press: Press) -> Press:
    """The press, recalibrated by 60 labelled pages."""
    rng, count = np.random.default_rng(1), 60
    pages = LabelledPages(
        score=rng.standard_normal(count),
        weight=np.full(count, 2.0),
        run=np.ones(count, np.int64),
        sheet=np.arange(count),
        passed=np.ones(count, bool),
        rate=0.1,
        passed_weight=2.0,
        alarms_from=3.0,
        replaces=trained_press.digest,
    )
    return trained_press.with_detector("matched_filter", model_of(trained_press).recalibrated(pages))


def of_schema_10(press: Press, path: Path) -> str:
    """Write a press as schema 10 had it; return its digest."""
    arrays, document = press._parts()
    begins = "detectors.matched_filter."
    former = {
        "ours." + name.removeprefix(begins).replace("labelled0.", "told0.")
        if name.startswith(begins)
        else name: one
        for name, one in arrays.items()
    }
    raw: dict[str, Any] = json.loads(document)
    ours = raw["detectors"].pop("matched_filter")
    if "labelled" in ours:
        ours["told"] = ours.pop("labelled")
    raw["detectors"]["ours"] = ours
    text = json.dumps(raw, sort_keys=True)
    digest = _digest(former, text)
    path.write_bytes(save(former, {"kind": KIND, "schema": "10", "digest": digest, "document": text}))
    return digest


def test_a_press_of_schema_10_is_read_and_known_by_its_digest(labelled: Press, tmp_path: Path) -> None:
    digest = of_schema_10(labelled, tmp_path / "old.press")
    press = Press.load(tmp_path / "old.press")
    assert press.digest == labelled.digest != digest
    assert digest in press.digests
    assert press.digest in press.digests
    assert "0" * 64 not in press.digests
    assert len(model_of(press).told) == 1
    press.save(tmp_path / "new.press")
    assert Press.load(tmp_path / "new.press").digest == labelled.digest


def test_a_damaged_press_of_schema_10_is_refused(labelled: Press, tmp_path: Path) -> None:
    path = tmp_path / "old.press"
    of_schema_10(labelled, path)
    content = path.read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(PressError, match="its digest does not match"):
        Press.load(path)


def test_evidence_of_that_time_is_decided_again(trained_press: Press, page: Page) -> None:
    inspector = Inspector.of(trained_press, "ours")  # which a user may still say
    assert inspector.detector.name == "matched_filter"
    day = (
        np.random.default_rng(2).integers(100, 200, (1, 700, trained_press.geometry.pixels)).astype(np.uint16)
    )
    kept = dict(inspector.inspect(page, day).stored_arrays)
    score = inspector.detector.decided_again(StoredArrays(kept, "matched_filter")).score
    before = {"portrait" if name == "page_features" else name: array for name, array in kept.items()}
    assert "page_features" not in before
    assert (
        detector("matched-filter", trained_press).decided_again(StoredArrays(before, "ours")).score == score
    )


def test_rows_of_that_time_name_the_detector_as_it_is_named_today(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    verdict = Verdict(page="p0001", verdict="good", score=0.5, threshold=1.0, detector="ours")
    with Journal.open(str(path)) as journal:
        run_id = journal.begin_run(facts(detector="ours"))
        journal.record(run_id, replace(record(3, kept=False), verdict=verdict))
        journal.commit()
    with Journal.open(str(path), read_only=True) as journal:
        assert journal.run(run_id).facts.detector == "matched_filter"
        assert journal.page(run_id, 3).verdict.detector == "matched_filter"
