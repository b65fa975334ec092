"""Traces of sheets: one a sheet, over all processes, and nothing without a collector."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest
from packages.line.tests.cli.test_watch import _few_prints, job, trigger, watch

from prooflight.errors import RequestError
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import run_key
from prooflight_line.reporting import traces
from prooflight_line.reporting.traces import VARIABLES, Traces, exporter_of_environment

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["_few_prints", "job", "trigger"]


@pytest.fixture(autouse=True)
def _no_collector(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)


def test_without_a_collector_nothing_is_loaded() -> None:
    assert Traces.of_environment() is None


def test_a_collector_without_the_extra_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLES[0], "http://127.0.0.1:4318")
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace.export", None)
    with pytest.raises(RequestError, match=r"needs the extra otel.*pip install 'prooflight-line\[otel\]'"):
        exporter_of_environment()


@pytest.mark.parametrize("journalled", [True, False])
def test_a_run_and_its_shipper_make_one_trace_a_sheet(
    press_file: Path,
    job: Path,
    trigger: int,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    journalled: bool,
) -> None:
    pytest.importorskip("opentelemetry.sdk")
    from opentelemetry.sdk.trace.export import SimpleSpanProcessor
    from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter

    memory = InMemorySpanExporter()
    monkeypatch.setattr(traces, "exporter_of_environment", lambda: SimpleSpanProcessor(memory))
    journal = tmp_path / "runs.sqlite" if journalled else "none"
    code, _, err = watch(
        capsys, job, "--press", press_file, "--source", "drum", "--world", "ideal", "--sheets", 3,
        "--trigger", trigger, "--journal", journal, "--json",
    )  # fmt: skip
    assert code == 0, err
    spans = memory.get_finished_spans()
    parts = ["lines", "placed", "waited", "inspected", *(["journalled"] if journalled else [])]
    assert [span.name for span in spans] == ["sheet", *parts] * 3
    for at in range(0, len(spans), len(parts) + 1):
        root, *rest = spans[at : at + len(parts) + 1]
        assert root.attributes["prooflight.sheet"] == at // (len(parts) + 1)
        assert root.attributes["prooflight.verdict"] == "good"
        assert {span.context.trace_id for span in rest} == {root.context.trace_id}
        assert {span.parent.span_id for span in rest} == {root.context.span_id}
        times = [time for span in rest for time in (span.start_time, span.end_time)]
        assert times == sorted(times)
        assert (root.start_time, root.end_time) == (times[0], times[-1])
    assert len({span.context.span_id for span in spans}) == len(spans)
    assert len({span.context.trace_id for span in spans}) == 3
    if not journalled:
        return
    with Journal.open(str(journal), read_only=True) as opened:
        (run,) = opened.runs()
    shipper = Traces(processor=SimpleSpanProcessor(later := InMemorySpanExporter()), attributes={})
    shipper.shipped([f"{run_key(run)}/2"], (2e9, 2e9 + 1))
    (span,) = later.get_finished_spans()
    last = spans[-len(parts) - 1].context
    assert (span.name, span.parent.span_id) == ("shipped", last.span_id)
    assert span.context.trace_id == last.trace_id
