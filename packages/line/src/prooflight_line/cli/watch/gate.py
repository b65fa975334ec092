"""The gate of ``prooflight watch --plant PRESS.toml``: checks before the run, and notices during it."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from prooflight.errors import JobError, RequestError
from prooflight.reporting.wording import count
from prooflight_line.cli.watch.sources import drum_rate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from prooflight.pages.job import Job
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.press.artefact import Press
    from prooflight.press.gate import GateSettings, PlcSettings
    from prooflight.press.press_file import PressFile
    from prooflight_line.cli.watch.resuming import Resumption
    from prooflight_line.plant.events import SheetAtGate
    from prooflight_line.plant.gate.gate import Gate
    from prooflight_line.plant.gate.handshake import State
    from prooflight_line.run.notices import Notice
    from prooflight_line.run.recording import Recorder


def gate_settings(plant: PressFile | None) -> GateSettings | None:
    """Return ``[gate]`` of a press file; None if there is none.

    PlantError: its controller does not answer as it should.
    """
    settings = None if plant is None else plant.gate_settings()
    if settings is not None:
        from prooflight_line.plant.gate.gate import try_controller

        try_controller(settings)
    return settings


def simulated(settings: GateSettings | None) -> PlcSettings | None:
    """Return the controller of a gate, if it is a simulated one."""
    if settings is None:
        return None
    from prooflight_line.plant.simulator.feed import is_simulated

    return settings.plc if is_simulated(settings.plc) else None


def refuse_unfit(
    plant: PressFile,
    settings: GateSettings,
    source: str,
    press: Press,
    *,
    lengths_mm: list[float],
    deadline_s: float,
) -> None:
    """Raise an error if the gate cannot work with this source and job.

    RequestError: the source keeps no time. PlantError: sheets reach the gate before their verdicts can, or
    are nearer to each other than the gate can distinguish.

    ``source`` is the value of the option. ``lengths_mm`` are the lengths of the job's pages.
    """
    from prooflight_line.plant.gate.gate import Travel, exchange_s, refuse_close, refuse_near

    geometry, shortest_mm, longest_mm = press.geometry, min(lengths_mm), max(lengths_mm)
    kind, _, rest = source.partition(":")
    if kind == "camera":
        camera = plant.camera()
        rate_hz = plant.camera_settings().line_rate_hz or camera.sensors[0].line_rate_hz
        speed_mm_s = camera.line_travel_mm * rate_hz
    elif kind == "drum" and rest:
        speed_mm_s = drum_rate(source, rest) * geometry.lines(longest_mm) * geometry.line_pitch_mm
    else:
        what = "has a gate, and this source has no speed of its own"
        raise RequestError(plant.path, what, remedy="give --source drum:PAGES_PER_S or camera:ID")
    travel = Travel(
        distance_mm=settings.distance_mm,
        speed_mm_s=speed_mm_s,
        sheet_mm=longest_mm + geometry.lead_out_mm,
        deadline_s=deadline_s,
        exchange_s=exchange_s(settings),
    )
    refuse_near(settings, travel, where=plant.path)
    refuse_close(settings, shortest_mm, where=plant.path)


def lengths_mm(job: Job, press: Press) -> list[float]:
    """Return the lengths of the job's pages along the travel, as they enter the press, without unreadable pages."""
    geometry, lengths = press.geometry, list[float]()
    for number in range(1, len(job) + 1):
        with suppress(JobError):
            width_mm, height_mm = job.page_size_mm(number)
            turned = width_mm > geometry.pixels * geometry.pixel_pitch_mm
            lengths.append(width_mm if turned else height_mm)
    return lengths or [0.0]


def with_sets(
    plan: SheetPlan | None, pages_a_set: int, *, pages: int, sheets: int | None, where: object
) -> SheetPlan:
    """Return the plan with the gate's sets, if it has none.

    ``where`` is the press file; the other arguments are those of ``Plant.with_sets``.
    """
    from prooflight.pages.layout.layout import Layout
    from prooflight.pages.layout.plan import SheetPlan

    if plan is None:
        return SheetPlan(layout=Layout(pages_a_set=pages_a_set), sides=pages, sheets=sheets or pages)
    stated = plan.layout.pages_a_set
    if stated is not None and stated != pages_a_set:
        what = f"[gate] pages_a_set = {pages_a_set}, but --layout states pages-a-set={stated}"
        raise RequestError(where, what, remedy="remove it from [gate]: the job determines its sets")
    if pages_a_set % plan.layout.pages_a_sheet:
        what = f"[gate] pages_a_set = {pages_a_set}, but a sheet takes {plan.layout.pages_a_sheet} pages"
        raise RequestError(where, what, remedy="give --layout pages-a-set of whole sheets")
    return replace(plan, layout=replace(plan.layout, pages_a_set=pages_a_set))


@contextmanager
def gate_of(
    settings: GateSettings | None,
    press: Press,
    *,
    job_pages: int,
    plan: SheetPlan | None,
    recorder: Recorder | None,
    resumption: Resumption | None = None,
    notice: Callable[[Notice], None],
    state: Callable[[str, str], None] = lambda _state, _why: None,
    report: Callable[[SheetAtGate], None] = lambda _passed: None,
    progress: Callable[[str], None] = lambda _text: None,
) -> Iterator[Gate | None]:
    """Serve the gate until the last sheets have reached it; None if the press has none.

    ``progress`` is called when they are waited for. ``notice`` is called when the gate becomes ready and when
    it does not stay so; ``state``, with every step of the handshake, and why; ``report``, with every sheet
    that has passed the gate.
    """
    if settings is None:
        yield None
        return
    from prooflight_line.plant.gate.gate import Gate
    from prooflight_line.plant.gate.handshake import State
    from prooflight_line.run.notices import Notice

    ready = False

    def tell(step: State, why: str) -> None:
        nonlocal ready
        state(str(step), why)
        if step is State.READY:
            ready = True
            notice(Notice(kind="gate-ready", text=f"the gate at {settings.plc.where} is ready"))
        elif ready:
            ready = False
            doubt = {"reject": "are rejected", "accept": "pass", "stop": "stop the press"}[settings.policy]
            text = f"the gate at {settings.plc.where} is not ready ({why}): sheets without a result {doubt}"
            notice(Notice(kind="gate-away", text=text))

    journal = None if recorder is None else recorder.journal.path
    run_id = 0 if recorder is None else recorder.run_id
    with Gate(
        settings,
        press.geometry,
        job_pages=job_pages,
        plan=plan,
        journal=journal,
        run_id=run_id,
        past=None if resumption is None else resumption.gate,
        open_sides=() if resumption is None else resumption.open_sides,
        tell=tell,
        report=report,
    ) as gate:
        yield gate
        if left := gate.protocol.waiting:
            progress(f"{count(left, 'sheet')} on the way to the gate")
