"""Traces of sheets for OpenTelemetry: one trace a sheet, over all processes that touch it.

    sheet
      lines       the sheet passes the camera
      placed      it is cut from the lines, and its page identified
      waited      it waits for a thread
      inspected
      gate        its disposition is decided and handed to the gate
      journalled  until its row is on the disk
      shipped     its row goes into the database of records, by another process

Spans are made of times that the run keeps anyway, when the sheet has its verdict: tracing changes nothing before, and
costs nothing when it is off. A trace's number is a digest of the sheet's name in the journal, so that the shipper goes
on with a trace that another process began. It is on where the standard variable ``OTEL_EXPORTER_OTLP_ENDPOINT`` (or
that of traces alone) names a collector.
"""

from __future__ import annotations

import hashlib
import os
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, Self

from prooflight import __version__
from prooflight.errors import RequestError
from prooflight_line.journal.labels import key_of, sheet_id

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from opentelemetry.sdk.trace import ReadableSpan, SpanProcessor

    from prooflight_line.journal.records import RunFacts
    from prooflight_line.run.outcomes import Outcome
    from prooflight_line.run.recording import Recorder

VARIABLES: Final = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
SERVICE: Final = "prooflight"

Interval = tuple[float, float]
"""Begin and end, in Unix time. [s]"""


def exporter_of_environment() -> SpanProcessor | None:
    """Return what exports spans to the collector that the environment names; None: it names none.

    RequestError: a collector is named, and the extra [otel] is not installed.
    """
    if not any(os.environ.get(name) for name in VARIABLES):
        return None
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError as error:
        remedy = "pip install 'prooflight-line[otel]', or unset it"
        raise RequestError(VARIABLES[0], "needs the extra otel", remedy=remedy) from error
    return BatchSpanProcessor(OTLPSpanExporter())


@dataclass(frozen=True, slots=True, kw_only=True)
class Traces:
    """Spans of sheets, handed to a processor."""

    processor: SpanProcessor
    attributes: Mapping[str, Any]

    @classmethod
    def of_environment(cls, **attributes: Any) -> Self | None:
        """Return the traces that the environment asks for, as ``exporter_of_environment``; None: it asks for none."""
        processor = exporter_of_environment()
        return None if processor is None else cls(processor=processor, attributes=attributes)

    def sheet(self, name: str, parts: Mapping[str, Interval], attributes: Mapping[str, Any]) -> None:
        """Hand over a sheet's trace. name: the sheet's, by ``labels.sheet_id``; parts: its spans but the first."""
        whole = min(begin for begin, _ in parts.values()), max(end for _, end in parts.values())
        self._hand_over(name, None, whole, attributes)
        for part, interval in parts.items():
            self._hand_over(name, part, interval, {})

    def shipped(self, names: Iterable[str], interval: Interval) -> None:
        """Add the span of being shipped to the traces of sheets."""
        for name in names:
            self._hand_over(name, "shipped", interval, {})

    def close(self) -> None:
        """Export what waits, within the exporter's own time limit."""
        self.processor.shutdown()

    def _hand_over(
        self, name: str, part: str | None, interval: Interval, attributes: Mapping[str, Any]
    ) -> None:
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import ReadableSpan
        from opentelemetry.sdk.util.instrumentation import InstrumentationScope

        begin, end = interval
        span: ReadableSpan = ReadableSpan(
            name=part or "sheet",
            context=_context(name, part),
            parent=None if part is None else _context(name, None),
            resource=Resource.create({"service.name": os.environ.get("OTEL_SERVICE_NAME", SERVICE)}),
            attributes={**self.attributes, "prooflight.id": name, **attributes},
            start_time=int(1e9 * begin),
            end_time=int(1e9 * max(begin, end)),
            instrumentation_scope=InstrumentationScope("prooflight", __version__),
        )
        self.processor.on_end(span)


@dataclass(kw_only=True)
class RunTraces:
    """Traces of the sheets of one run, which wait until their rows are on the disk."""

    traces: Traces
    facts: RunFacts
    recorder: Recorder | None
    """None: the run is in no journal, and no sheet waits."""
    clock: Callable[[], float] = time.monotonic
    _guard: threading.Lock = field(default_factory=threading.Lock, init=False)
    _waiting: deque[tuple[int, Outcome, dict[str, Interval]]] = field(default_factory=deque, init=False)
    _gate: dict[int, Interval] = field(default_factory=dict, init=False)
    _recorded: int = field(default=0, init=False)

    def deciding(self, decide: Callable[[Outcome], Outcome]) -> Callable[[Outcome], Outcome]:
        """Return the gate's function, timed."""

        def timed(outcome: Outcome) -> Outcome:
            begun = time.time()
            try:
                return decide(outcome)
            finally:
                self._gate[outcome.record.sheet] = begun, time.time()

        return timed

    def observe(self, outcome: Outcome) -> None:
        """Note a sheet that was handed to the journal."""
        now, times = time.time(), outcome.times
        parts: dict[str, Interval] = {}
        if times is not None:
            to_unix = now - self.clock()
            marks = (
                times.last_line_s - times.lines_s,
                times.last_line_s,
                times.placed_s,
                times.begun_s,
                times.decided_s,
            )
            unix = [to_unix + mark for mark in marks]
            names = ("lines", "placed", "waited", "inspected")
            parts = dict(zip(names, pairwise(unix), strict=True))
        if (gate := self._gate.pop(outcome.record.sheet, None)) is not None:
            parts["gate"] = gate
        parts["journalled"] = now, now
        self._recorded += 1
        self._waiting.append((self._recorded, outcome, parts))
        if self.recorder is None:
            self.committed(self._recorded)

    def committed(self, rows: int) -> None:
        """Hand over the traces of the first ``rows`` sheets of the run, which are on the disk now."""
        now = time.time()
        with self._guard:  # both the thread that writes the journal and that which ends the run come here
            ready = []
            while self._waiting and self._waiting[0][0] <= rows:
                ready.append(self._waiting.popleft())
        for _, outcome, parts in ready:
            if self.recorder is None:
                del parts["journalled"]
            else:
                parts["journalled"] = parts["journalled"][0], now
            record = outcome.record
            name = sheet_id(
                key_of(0 if self.recorder is None else self.recorder.run_id, self.facts.started_s),
                record.sheet,
            )
            attributes = {
                "prooflight.press": self.facts.press,
                "prooflight.sheet": record.sheet,
                "prooflight.page": record.verdict.page,
                "prooflight.verdict": record.verdict.verdict,
                "prooflight.disposition": record.disposition,
                "prooflight.late": record.late,
            }
            self.traces.sheet(name, parts or {"sheet": (now, now)}, attributes)

    def close(self) -> None:
        """Hand over what waits, also where it could not be recorded, and export all."""
        self.committed(self._recorded)
        self.traces.close()


def _context(name: str, part: str | None) -> Any:
    """Return the numbers of a span: its trace's are of the sheet's name, its own of its part as well."""
    from opentelemetry.trace import SpanContext, TraceFlags

    trace = hashlib.sha256(name.encode()).digest()
    own = hashlib.sha256(f"{name}/{part or ''}".encode()).digest()
    return SpanContext(
        trace_id=int.from_bytes(trace[:16]) or 1,
        span_id=int.from_bytes(own[:8]) or 1,
        is_remote=False,
        trace_flags=TraceFlags(TraceFlags.SAMPLED),
    )
