"""``prooflight camera view``: live view of a line camera's measurements, while a person turns the lens."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from prooflight.cli import show
from prooflight.cli.options import Json
from prooflight_line.cli.camera.line_cameras import CameraId

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.press.press_file import PressFile
    from prooflight_line.camera_set_up.line_reader import CameraLineReader, LastLines
    from prooflight_line.reporting.camera_live import CameraShown

WINDOW_LINES: Final = 4096
"""Lines that are analysed: a group of a ruler page, 92 mm, at 0.022 mm a line."""
FIRST_LINES: Final = 256
"""Lines before the first analysis."""
VIEW_S: Final = 0.5
"""Time between two analyses."""


def view(
    name: CameraId,
    press: Annotated[
        Path | None, typer.Option(metavar="PRESS.toml", help="Press file whose [camera] sets it up.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(metavar="F.png", help="Draw the last view.")] = None,
    frames: Annotated[int | None, typer.Option(help="Number of views; default until Ctrl-C.", min=1)] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Duration in seconds; default until Ctrl-C.", min=0)
    ] = None,
    json: Json = False,
) -> None:
    """Show a camera live: profile along the line, saturation, black, light, focus, lines/s, loss, temperature.

    Focus is the frequency at which half of the contrast is left (MTF50), from a ruler page (`chart make
    --ruler`) that passes, or from edges that do not move.
    """
    from rich.live import Live

    from prooflight.press.press_file import PressFile
    from prooflight.scans.camera_settings import CameraSettings
    from prooflight_line.camera_set_up.line_reader import CameraLineReader
    from prooflight_line.cameras.backends import camera_named, ready
    from prooflight_line.reporting.camera_live import draw_camera, live_camera

    file = None if press is None else PressFile.read(press)
    settings = CameraSettings() if file is None else file.camera_settings()
    camera = camera_named(name)
    opened = ready(camera, settings, where=str(press))
    shown: CameraShown | None = None
    try:
        reader = CameraLineReader(opened, names=settings.names.get(camera.model))
        live = not json and show.people.is_terminal
        with ExitStack() as stack:
            screen = stack.enter_context(Live(console=show.people, auto_refresh=False)) if live else None
            try:
                for shown in _views(reader, file, frames=frames, seconds=seconds):
                    if json:
                        show.print_json(shown.facts())
                    elif screen is not None:
                        screen.update(live_camera(shown), refresh=True)
                    elif frames is not None or seconds is not None:
                        show.people.print(live_camera(shown))
            except KeyboardInterrupt:
                pass  # a person has seen enough
    finally:
        opened.close()
    if picture is not None and shown is not None:
        draw_camera(picture, shown)
        if not json:
            show.written(picture)


def _views(
    reader: CameraLineReader, file: PressFile | None, *, frames: int | None, seconds: float | None
) -> Iterator[CameraShown]:
    """Yield one analysis after another, as lines come."""
    begun_s = shown_s = time.monotonic()
    count = 0
    for last in reader.endless(WINDOW_LINES, fresh=False):
        now_s = time.monotonic()
        ends = seconds is not None and now_s - begun_s >= seconds
        if not ends and (last.count < FIRST_LINES or (count and now_s - shown_s < VIEW_S)):
            continue
        yield _current_view(reader, last, file)
        count, shown_s = count + 1, time.monotonic()
        if ends or count == frames:
            return


def _current_view(reader: CameraLineReader, last: LastLines, file: PressFile | None) -> CameraShown:
    from prooflight_line.camera_set_up.page_steps import lens_mtf50
    from prooflight_line.camera_set_up.seen import sensor_views
    from prooflight_line.reporting.camera_live import CameraShown

    camera = None if file is None else file.camera()
    top = reader.top_code_dn
    if camera is not None and reader.form.bits == 16:
        top = 2 ** camera.sensors[0].bits - 1
    lines = last.lines()
    return CameraShown(
        camera=reader.name,
        form=f"{reader.sensors} x {reader.pixels} pixels, {reader.form.name}",
        top_code_dn=top,
        lines=lines,
        views=sensor_views(lines, top_code_dn=top, where=reader.name),
        health=reader.health(),
        lens_mtf50=None if camera is None else lens_mtf50(camera, camera.sensors[0]),
    )
