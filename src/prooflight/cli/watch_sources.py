"""``--source`` of ``prooflight watch``: where lines come from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from prooflight.pages.job import JobSource
    from prooflight.press.artefact import Press
    from prooflight.scans.cameras.source import CameraLines
    from prooflight.scans.lines import LineSource
    from prooflight.simulation.drum import Turn
    from prooflight.simulation.scans import SimulatedScan

REMEDY = "write drum[:PAGES_PER_S], replay:PATH, raw:PATH (- is standard input), tcp:HOST:PORT or camera:ID"

SLOWEST, FASTEST = 0.001, 1000.0
"""Of the drum. [pages/s]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrumWishes:
    """What the simulated drum should show."""

    pages: int
    """Of the job."""
    sheets: int
    """That pass in all."""
    world: str
    misprint: str | None
    every: int
    """Every so many prints is a misprint."""
    fault_every: int | None
    """A fault of the paper path or the camera about every so many sheets."""
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """A source, and whether it has a clock of its own pace."""

    source: LineSource
    waits: bool
    """Whether it can be made to wait."""
    camera: CameraLines | None = None
    """The source, where it is a camera: it says when it is away."""


def open_source(
    text: str,
    *,
    press: Press,
    job: JobSource,
    framed: bool,
    settings: Path | None = None,
    wishes: DrumWishes,
    shown: Callable[[Iterator[SimulatedScan], int], Iterable[SimulatedScan]],
) -> Opened:
    """What ``--source`` names; RequestError if there is no such thing.

    settings: the press file by which a camera is set up. shown: shows how rendering goes on.
    """
    kind, _, rest = text.partition(":")
    sensors, pixels = len(press.sensors), press.geometry.pixels
    if kind == "drum":
        rate = _rate(text, rest)
        drum = _drum(press, job, wishes, rate=rate, shown=shown)
        return Opened(source=drum, waits=rate is None)
    if kind == "replay" and rest:
        from prooflight.scans.recorded import Replay, recorded_scans

        scans = recorded_scans(Path(rest), sensors=sensors)
        return Opened(source=Replay(scans, sensors=sensors, pixels=pixels), waits=True)
    if (kind == "raw" and rest) or kind in ("tcp", "unix"):
        from prooflight.scans.raw import open_raw

        address = rest if kind == "raw" else text
        return Opened(source=open_raw(address, sensors=sensors, pixels=pixels, framed=framed), waits=True)
    if kind == "camera" and rest:
        lines = camera_lines(rest, settings)
        try:
            _refuse_other(text, lines, press)
        except RequestError:
            lines.close()
            raise
        return Opened(source=lines, waits=False, camera=lines)
    raise RequestError("source", f"there is no {text!r}", remedy=REMEDY)


def _refuse_other(text: str, lines: CameraLines, press: Press) -> None:
    """RequestError: a camera's lines are not those that the press was made for."""
    sensors, pixels = len(press.sensors), press.geometry.pixels
    if (lines.sensors, lines.pixels) != (sensors, pixels):
        what = f"sends {lines.sensors} sensors x {lines.pixels} pixels"
        remedy = f"press {press.name} has {sensors} sensors x {pixels} pixels: set Width and PixelFormat"
        raise RequestError(text, what, remedy=remedy)
    top_dn = max(sensor.top_code_dn for sensor in press.sensors)
    # 16 bits may hold the numbers of a converter of fewer.
    if lines.form.top_code_dn != top_dn and lines.form.bits < 16:
        what = f"sends {lines.form.name}, numbers up to {lines.form.top_code_dn}"
        remedy = f"those of press {press.name} go up to {top_dn}: set PixelFormat, or sensor bits"
        raise RequestError(text, what, remedy=remedy)


def camera_lines(name: str, settings: Path | None) -> CameraLines:
    """The lines of a camera by ID, serial number or address, set up as a press file says."""
    from prooflight.press.press_file import PressFile
    from prooflight.scans.cameras.backends import found_camera, ready
    from prooflight.scans.cameras.setting_up import CameraSettings
    from prooflight.scans.cameras.source import CameraLines

    wanted = CameraSettings() if settings is None else PressFile.read(settings).camera_settings()
    camera = found_camera(name)
    again = partial(ready, camera, wanted, where=str(settings))
    return CameraLines(again, name=camera.id, runs_free=wanted.trigger == "free")


def _rate(text: str, rest: str) -> float | None:
    try:
        rate = float(rest) if rest else None
    except ValueError:
        rate = float("nan")
    if rate is not None and not SLOWEST <= rate <= FASTEST:
        remedy = f"write e.g. drum:5 [pages/s], from {SLOWEST:g} to {FASTEST:g}"
        raise RequestError("source", f"{text!r} names no speed", remedy=remedy)
    return rate


def _drum(
    press: Press,
    job: JobSource,
    wishes: DrumWishes,
    *,
    rate: float | None,
    shown: Callable[[Iterator[SimulatedScan], int], Iterable[SimulatedScan]],
) -> LineSource:
    from prooflight.simulation.drum import Drum
    from prooflight.simulation.ring import RingPrint, rendered, ring_size
    from prooflight.simulation.scans import MisprintRequest
    from prooflight.simulation.worlds import known_world

    request = MisprintRequest.parse(wishes.misprint) if wishes.misprint else None
    prints = RingPrint(
        job=job,
        press=press,
        pages=wishes.pages,
        world=known_world(wishes.world),
        request=request,
        every=wishes.every,
        seed=wishes.seed,
    )
    count = ring_size(wishes.pages, wishes.sheets)
    scans = [one.dn for one in shown(rendered(prints, count), count)]
    blank, foreign = prints.strangers() if wishes.fault_every else (None, None)
    passing = _passing(wishes)
    return Drum(scans, press=press, passing=passing, pages_per_s=rate, blank=blank, foreign=foreign)


def _passing(wishes: DrumWishes) -> Iterable[Turn]:
    """The sheets as they pass, with faults of all kinds in turn where they are wished for."""
    from prooflight.rng import stream
    from prooflight.simulation.drum import LINE_FAULTS, ORDER_FAULTS, DrumFault, Turn, turns

    if not wishes.fault_every:
        return (Turn(page=sheet) for sheet in range(wishes.sheets))
    faults = {}
    rng = stream(wishes.seed, "drum-faults")
    kinds = (*ORDER_FAULTS, *LINE_FAULTS)
    for turn, start in enumerate(range(wishes.fault_every, wishes.sheets - 2, wishes.fault_every)):
        faults[start] = DrumFault.draw(kinds[turn % len(kinds)], rng)
    return turns(wishes.sheets, faults)
