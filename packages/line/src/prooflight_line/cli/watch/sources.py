"""``--source`` of ``prooflight watch``: the sources of lines."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING

from prooflight.errors import RequestError
from prooflight_line.cli.watch.options import REMEDY

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from prooflight.pages.job import JobSource
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.press.artefact import Press
    from prooflight.press.gate import PlcSettings
    from prooflight.scans.camera_settings import CameraSettings
    from prooflight.scans.lines import LineSource
    from prooflight.simulation.drum import Turn
    from prooflight.simulation.scans import SimulatedScan
    from prooflight_line.cameras.several import SeveralCameras
    from prooflight_line.cameras.source import CameraLines
    from prooflight_line.cli.watch.options import DrumOptions

FIRST_PRINTS = 1
"""Prints of the drum before the first sheet passes, of a run that starts at once.

This process makes them, since other processes take longer to start."""
SLOWEST, FASTEST = 0.001, 1000.0
"""Slowest and fastest speed of the drum. [pages/s]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrumWishes:
    """Requested content of the simulated drum."""

    pages: int
    sheets: int
    """Number of sheets that pass in all."""
    options: DrumOptions
    seed: int
    fed: PlcSettings | None = None
    """Simulated controller that receives the sheets on its belt."""
    plan: SheetPlan | None = None
    """Imposition of the job on sheets; its pages then are sides."""
    passed: int = 0
    """Number of sheets that have passed before, of a run that is resumed."""
    at_once: bool = False
    """Whether sheets pass as soon as some are printed; the drum then waits for prints and for the inspection."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """A source, and whether it has a pace of its own."""

    source: LineSource
    waits: bool
    """Whether the source can be made to wait."""
    camera: CameraLines | SeveralCameras | None = None
    """The source, if it consists of cameras: it reports when one is away, and their health."""


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
    """Open the source that ``--source`` names; RequestError if there is none of that name.

    ``settings`` is the press file by which a camera is set up. ``shown`` shows the progress of rendering.
    """
    kind, _, rest = text.partition(":")
    sensors, pixels = len(press.sensors), press.geometry.pixels
    if kind == "drum":
        rate = drum_rate(text, rest) if rest else None
        waits = rate is None or (wishes.at_once and wishes.fed is None)
        return Opened(source=_drum(press, job, wishes, rate=rate, shown=shown), waits=waits)
    if kind == "replay" and rest:
        from prooflight.scans.recorded import Replay, recorded_scans

        scans = recorded_scans(Path(rest), sensors=sensors)
        return Opened(source=Replay(scans, sensors=sensors, pixels=pixels), waits=True)
    if (kind == "raw" and rest) or kind in ("tcp", "unix"):
        from prooflight.scans.raw import open_raw

        address = rest if kind == "raw" else text
        return Opened(source=open_raw(address, sensors=sensors, pixels=pixels, framed=framed), waits=True)
    if kind == "camera" and (rest or settings is not None):
        lines = camera_lines(rest, settings)
        try:
            _refuse_other(text, lines, press)
            _refuse_unaligned(settings, press)
        except RequestError:
            lines.close()
            raise
        return Opened(source=lines, waits=False, camera=lines)
    raise RequestError("source", f"there is no {text!r}", remedy=REMEDY)


def _refuse_other(text: str, lines: CameraLines | SeveralCameras, press: Press) -> None:
    """Raise RequestError if a camera's lines are not those that the press was made for."""
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


def _refuse_unaligned(settings: Path | None, press: Press) -> None:
    """Raise RequestError if a press was built for other sensor offsets than those of its press file."""
    from prooflight.press.press_file import PressFile
    from prooflight.scans.alignment import disagreement

    if settings is None:
        return
    offsets = PressFile.read(settings).sensor_offsets()
    if len(offsets) != len(press.sensors):
        what = f"has {len(offsets)} sensors, press {press.name} has {len(press.sensors)}"
        raise RequestError(settings, what, remedy="give the press file from which the press was built")
    mismatch = disagreement([sensor.footprint for sensor in press.sensors], offsets, press.geometry)
    if mismatch is not None:
        place, built, stated = mismatch
        what = f"states that sensor {place + 1} is offset by {stated:+.2f} from whole lines or pixels"
        remedy = f"press {press.name} was built for {built:+.2f}: build it again from this file"
        raise RequestError(settings, what, remedy=remedy)


def camera_lines(name: str, settings: Path | None) -> CameraLines | SeveralCameras:
    """Open cameras by ID, serial number or address, with + between them, set up as in a press file.

    ``name`` empty: the cameras that the press file names. RequestError: it does not state which, or for how
    many.
    """
    from prooflight.press.press_file import PressFile
    from prooflight.scans.camera_settings import CameraSettings
    from prooflight_line.cameras.several import SeveralCameras

    stated = () if settings is None else PressFile.read(settings).cameras()
    names = name.split("+") if name else [one.id for one in stated if one.id]
    if not names or "" in names:
        raise RequestError("camera", "none is named", remedy="write camera:ID, or id under [camera]")
    wanted = _settings_of(names, stated, settings) if stated else [CameraSettings()] * len(names)
    offsets = [one.offsets() for one in wanted]
    cameras: list[CameraLines] = []
    try:
        for of, one in zip(names, wanted, strict=True):
            cameras.append(_one_camera(of, one, settings))
    except BaseException:
        for camera in cameras:
            camera.close()
        raise
    if len(cameras) == 1 and all(offset.whole == (0, 0) for offset in offsets[0]):
        return cameras[0]
    of_sensors = [one.offsets(camera.sensors) for one, camera in zip(wanted, cameras, strict=True)]
    return SeveralCameras(cameras, of_sensors)


def _settings_of(
    names: Sequence[str], stated: Sequence[CameraSettings], settings: Path | None
) -> list[CameraSettings]:
    """Return the settings in the press file for each named camera: by its ID, or in the file's order."""
    by_id = {one.id: one for one in stated if one.id}
    if set(names) <= set(by_id):
        return [by_id[name] for name in names]
    if len(names) != len(stated):
        what = f"sets up {len(stated)} cameras, and {len(names)} are named"
        raise RequestError(str(settings), what, remedy="give a [[camera]] block for each of them")
    return list(stated)


def _one_camera(name: str, wanted: CameraSettings, settings: Path | None) -> CameraLines:
    from prooflight_line.cameras.backends import camera_named, ready
    from prooflight_line.cameras.source import CameraLines

    camera = camera_named(name)
    again = partial(ready, camera, wanted, where=str(settings))
    return CameraLines(again, name=camera.id, settings=wanted)


def drum_rate(text: str, rest: str) -> float:
    """Return the speed of ``drum:...`` [pages/s]; RequestError if it is not a speed."""
    try:
        rate = float(rest)
    except ValueError:
        rate = float("nan")
    if not SLOWEST <= rate <= FASTEST:
        remedy = f"write e.g. drum:5 [pages/s], from {SLOWEST:g} to {FASTEST:g}"
        raise RequestError("source", f"{text!r} is not a speed", remedy=remedy)
    return rate


def _drum(
    press: Press,
    job: JobSource,
    wishes: DrumWishes,
    *,
    rate: float | None,
    shown: Callable[[Iterator[SimulatedScan], int], Iterable[SimulatedScan]],
) -> LineSource:
    from prooflight.pages.parallel import FEWEST_FOR_PROCESSES
    from prooflight.simulation.drum import Drum
    from prooflight.simulation.ring import OTHER_SHEETS, GrowingRing, RingPrint, rendered, ring_size
    from prooflight.simulation.scans import MisprintRequest
    from prooflight.simulation.worlds import world_named

    kinds = (wishes.options.misprint or "").split(",") if wishes.options.misprint else []
    prints = RingPrint(
        job=job,
        press=press,
        pages=wishes.pages,
        world=world_named(wishes.options.world),
        requests=tuple(MisprintRequest.parse(kind.strip()) for kind in kinds),
        every=wishes.options.every,
        seed=wishes.seed,
        urgent=FIRST_PRINTS if wishes.at_once else None,
    )
    count = ring_size(wishes.pages, wishes.sheets)
    # Whoever feeds a controller must know of each print whether it is a misprint; one processor prints in this process.
    grows = wishes.at_once and wishes.fed is None and count >= FEWEST_FOR_PROCESSES and os.cpu_count() != 1
    first = FIRST_PRINTS if grows else 0
    in_turn = rendered(prints, count, first=first, other_sheets=bool(wishes.options.fault_every))
    waited = map(prints, range(first)) if grows else islice(in_turn, count)
    drawn = list(shown(waited, first or count))
    scan_lines = fmean(one.dn.shape[1] for one in drawn)
    blank: NDArray[np.uint16] | Callable[[], NDArray[np.uint16]] | None
    foreign: NDArray[np.uint16] | Callable[[], NDArray[np.uint16]] | None
    if grows:
        scans: Sequence[NDArray[np.uint16]] = GrowingRing(drawn, in_turn, count)
        blank, foreign = (partial(scans.__getitem__, count + at) for at in range(len(OTHER_SHEETS)))
    else:
        scans, others = [one.dn for one in drawn], [one.dn for one in in_turn]
        blank, foreign = others or (None, None)
    # The drum is part of the process that watches it: it stopped when that ended.
    passing = islice(_passing(wishes), wishes.passed, None)
    if wishes.fed is None or rate is None:
        return Drum(
            scans,
            press=press,
            passing=passing,
            pages_per_s=rate,
            blank=blank,
            foreign=foreign,
            scan_lines=scan_lines,
            waits=wishes.at_once,
        )
    from prooflight_line.plant.simulator.feed import FedDrum

    fed = FedDrum(
        wishes.fed,
        press.geometry,
        passing,
        misprints=lambda sheet: drawn[sheet % count].misprint is not None,
        sides=1 if wishes.plan is None else wishes.plan.layout.sides,
        first_serial=wishes.passed,
        speed_mm_s=rate * scan_lines * press.geometry.line_pitch_mm,
    )
    drum = Drum(scans, press=press, passing=fed.turns(), pages_per_s=rate, blank=blank, foreign=foreign)
    return fed.of(drum)


def _passing(wishes: DrumWishes) -> Iterable[Turn]:
    """Return the turns that pass; a turn's page is the side of the run that it shows, at any position."""
    plan = wishes.plan
    if plan is None:
        return _in_turn(wishes)
    return (
        turn if turn.page is None else replace(turn, page=plan.side_at(turn.page))
        for turn in _in_turn(wishes)
    )


def _in_turn(wishes: DrumWishes) -> Iterable[Turn]:
    """Return the turns by position, with faults of all kinds in turn if they are requested."""
    from prooflight.rng import stream
    from prooflight.simulation.drum import LINE_FAULTS, ORDER_FAULTS, DrumFault, Turn, turns

    if not wishes.options.fault_every:
        return (Turn(page=sheet) for sheet in range(wishes.sheets))
    faults = {}
    rng = stream(wishes.seed, "drum-faults")
    kinds = (*ORDER_FAULTS, *LINE_FAULTS)
    for turn, start in enumerate(
        range(wishes.options.fault_every, wishes.sheets - 2, wishes.options.fault_every)
    ):
        faults[start] = DrumFault.draw(kinds[turn % len(kinds)], rng)
    return turns(wishes.sheets, faults)
