"""``prooflight camera list``, ``features`` and ``record``: commands for a connected camera."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.table import Table

from prooflight.cli import faults, show
from prooflight.cli.options import Json
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight_line.cameras.camera import Feature, Health

MOST_LINES: Final = 1_000_000_000
CameraId = Annotated[
    str, typer.Argument(metavar="ID", help="ID as in `camera list`, serial number or address.")
]


def list_cameras(
    backend: Annotated[
        str | None, typer.Option(metavar="NAME", help="Backend: aravis or viva; default all.")
    ] = None,
    json: Json = False,
) -> None:
    """List the cameras that answer."""
    from prooflight_line.cameras.backends import list_cameras

    cameras = list_cameras(backend)
    if json:
        show.print_json([asdict(one) for one in cameras])
        return
    table = Table("ID", "maker", "model", "serial number", "address", "by")
    for one in cameras:
        table.add_row(one.id, one.maker, one.model, one.serial, one.address, one.backend)
    show.people.print(table if cameras else "no camera answers: check cable, power and network address")


def features(
    name: CameraId,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="Set a feature; - runs a command.")
    ] = None,
    json: Json = False,
) -> None:
    """List a camera's features from its own description, and set some of them."""
    from prooflight_line.cameras.backends import camera_named, opened

    wanted = [_wanted(text) for text in set_ or ()]
    camera = opened(camera_named(name))
    try:
        for feature, value in wanted:
            camera.set(feature, value)
        available = camera.features()
    finally:
        camera.close()
    if json:
        show.print_json([asdict(one) for one in available.values()])
        return
    table = Table("feature", "value", "takes", "of")
    for one in available.values():
        table.add_row(one.name, one.value, _takes(one), one.category)
    show.people.print(table)


def record(
    name: CameraId,
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FILE", help="File of framed raw lines to write.")
    ],
    lines: Annotated[
        int | None,
        typer.Option(help="Number of lines to record; default until Ctrl-C.", min=1, max=MOST_LINES),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(metavar="PRESS.toml", help="Press file whose [camera] sets it up.")
    ] = None,
    json: Json = False,
) -> None:
    """Record a camera's lines, with their count, their times and their faults.

    `prooflight watch --source raw:FILE --framed` plays them.
    """
    from prooflight.files.atomic import whole_file
    from prooflight.scans.raw import write_block
    from prooflight_line.cli.watch.sources import camera_lines

    source = camera_lines(name, camera)
    source.tell = lambda _kind, text: faults.report(text)
    begun_s = time.monotonic()
    messages: list[str] = []
    with whole_file(out) as unfinished, unfinished.open("wb") as file, closing(source.blocks()) as blocks:
        try:
            for block in blocks:
                write_block(file, block)
                messages += [fault.detail for fault in block.faults]
                if not json:
                    for fault in block.faults:
                        faults.report(fault.detail)
                if lines is not None and block.next_line >= lines:
                    break
        except KeyboardInterrupt:
            pass  # what has come is kept
        finally:
            healths = source.healths()
            source.close()
    took_s = time.monotonic() - begun_s
    if json:
        facts = total(healths.values()) | {"seconds": round(took_s, 3), "faults": messages}
        facts |= {"cameras": {one: asdict(health) for one, health in healths.items()}}
        show.print_json(facts | {"sensors": source.sensors, "pixels": source.pixels})
        return
    for one, health in healths.items():
        show.people.print(
            show.strong(out),
            f"{one}: {health.lines} lines in {took_s:.1f} s, {health.lines_lost} lost, {health.resends} packets sent"
            " again",
        )
    show.people.print(f"{source.sensors} sensors x {source.pixels} pixels")


def total(healths: Iterable[Health]) -> dict[str, float]:
    """Return the totals of what several cameras have sent and lost."""
    added = ("lines", "lines_lost", "blocks", "blocks_broken", "resends", "away")
    every = list(healths)
    return {name: sum(getattr(one, name) for one in every) for name in added}


def _wanted(text: str) -> tuple[str, str]:
    name, mark, value = text.partition("=")
    if not name or not mark:
        raise RequestError(
            "--set", f"{text!r} is not a feature and its value", remedy="write e.g. --set Height=64"
        )
    return name, value


def _takes(one: Feature) -> str:
    if not one.writable:
        return "cannot be set now"
    if one.choices:
        return ", ".join(one.choices)
    if one.least is not None and one.greatest is not None:
        return f"{one.least:g} to {one.greatest:g}"
    return "a command: --set NAME=-" if one.kind == "command" else one.kind
