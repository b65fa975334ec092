"""``prooflight plant``: check the plant components of a press file, and simulate a controller."""

from __future__ import annotations

import signal
import time
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.live import Live
from rich.text import Text

from prooflight.cli import show
from prooflight.cli.exit_codes import UNUSABLE_INPUT
from prooflight.cli.options import Json
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight_line.plant.outlets.configured import Answer
    from prooflight_line.plant.simulator.plc import SimulatedPlc

REFRESH_S: Final = 0.2
PORT: Final = 5020
"""Default port; unlike 502, it needs no privilege."""

app = typer.Typer(help="Check the plant's gate and outlets; simulate a controller.", no_args_is_help=True)


def register(program: typer.Typer) -> None:
    """Add these commands to the program."""
    program.add_typer(app, name="plant")


@app.command()
def check(
    press_file: Annotated[Path, typer.Argument(metavar="PRESS.toml", help="Press file.")],
    json: Json = False,
) -> None:
    """Check the connections to the gate's controller and to every outlet; exits 2 if one does not answer."""
    from prooflight.press.press_file import PressFile
    from prooflight_line.plant.outlets.configured import answers

    results = answers(PressFile.read(press_file))
    if not results:
        what = "has no gate and no outlet"
        raise RequestError(press_file, what, remedy="add [gate]; see docs/how-to/gate.md")
    if json:
        show.print_json([asdict(one) for one in results])
    else:
        show.people.print(_answers_table(results))
    if not all(one.answers for one in results):
        raise typer.Exit(UNUSABLE_INPUT)


@app.command()
def simulate(
    press_file: Annotated[
        Path | None,
        typer.Argument(
            metavar="PRESS.toml", help="Press file whose [gate] is simulated; default one of 2 m."
        ),
    ] = None,
    listen: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help=f"Address to listen at; default that of [gate.plc], else 127.0.0.1:{PORT}.",
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File for one JSON object a sheet, read by `run reconcile`."),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Duration in seconds; default until Ctrl-C.", min=0.1, max=1e7)
    ] = None,
    json: Json = False,
) -> None:
    """Simulate a controller with a gate and two trays. `watch --source drum:N --plant ...` supplies its sheets."""
    from prooflight.press.gate import GateSettings, PlcSettings
    from prooflight.press.press_file import PressFile
    from prooflight_line.plant.simulator.plc import Belt, SimulatedPlc
    from prooflight_line.plant.simulator.server import PlcServer

    settings = None if press_file is None else PressFile.read(press_file).gate_settings()
    if press_file is not None and settings is None:
        raise RequestError(press_file, "has no [gate]", remedy="add it; see docs/how-to/gate.md")
    settings = settings or GateSettings(distance_mm=2000, plc=PlcSettings(host="127.0.0.1", port=PORT))
    host, port = (settings.plc.host, settings.plc.port) if listen is None else _address(listen)
    with ExitStack() as stack:
        rows = None if log is None else stack.enter_context(log.open("w", encoding="utf-8", buffering=1))
        belt = Belt(distance_mm=settings.distance_mm, counts_per_mm=settings.plc.counts_per_mm)
        heartbeat_s = settings.plc.heartbeat_ms / 1e3
        plc = SimulatedPlc(belt=belt, heartbeat_s=heartbeat_s, log=rows, style=settings.plc.style)
        first, unit = settings.plc.first_register, settings.plc.unit
        server = stack.enter_context(PlcServer(plc, host=host, port=port, first_register=first, unit=unit))
        where = f"{host}:{server.port}"
        if not json:
            show.step(f"a controller answers at {where}, gate {settings.distance_mm:g} mm after the camera")
        _shown(plc, where, seconds, json=json)
    if json:
        show.print_json({"listened": where, **_counts(plc)})


def _shown(plc: SimulatedPlc, where: str, seconds: float | None, *, json: bool) -> None:
    """Show the controller until its time is over, or Ctrl-C."""
    until_s = None if seconds is None else time.monotonic() + seconds
    with ExitStack() as stack:
        view = None
        if not json and show.people.is_terminal:
            live = Live(_line(plc, where), console=show.people, auto_refresh=False)
            view = stack.enter_context(live)
        stack.enter_context(_ended_by_signal())
        try:
            while until_s is None or time.monotonic() < until_s:
                time.sleep(
                    REFRESH_S if until_s is None else min(REFRESH_S, max(until_s - time.monotonic(), 0))
                )
                if view is not None:
                    view.update(_line(plc, where), refresh=True)
        except KeyboardInterrupt:
            pass
        if view is None and not json:
            show.people.print(_line(plc, where))


@contextmanager
def _ended_by_signal() -> Iterator[None]:
    """End on SIGTERM as on Ctrl-C."""

    def stop(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _line(plc: SimulatedPlc, where: str) -> Text:
    """Return the state of the controller in one line; sheets that are bad in truth are counted in the good tray."""
    bad = sum(row.tray == "good" and row.truth != "good" for row in list(plc.rows))
    line = Text.assemble(
        (" HEARTBEAT ", "reverse green") if plc.alive else (" NO HEARTBEAT ", "reverse bold red"),
        f"  controller at {where}, good tray: {plc.counts['good']:,}",
    )
    line.append(f", {bad} of them bad", "bold red" if bad else "")
    line.append(f", reject tray: {plc.counts['reject']:,}, results stored: {len(plc.stored)}")
    return line.append(", press stopped", "bold red") if plc.stopped else line


def _counts(plc: SimulatedPlc) -> dict[str, Any]:
    return {"good": plc.counts["good"], "reject": plc.counts["reject"], "stopped": plc.stopped}


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    try:
        number = int(port)
    except ValueError:
        number = -1
    if not host or not 0 <= number <= 65_535:
        raise RequestError("listen", f"{text!r} is not an address", remedy=f"write e.g. 127.0.0.1:{PORT}")
    return host, number


def _answers_table(results: list[Answer]) -> Any:
    headings = ("what", "where", "answers", "detail")
    table = show.table_of("The plant", headings, text_columns=headings)
    for one in results:
        label = Text("yes", style="green") if one.answers else Text("no", style="bold red")
        table.add_row(one.what, one.where, label, one.says)
    return table
