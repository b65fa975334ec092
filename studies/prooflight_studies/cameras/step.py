"""Two cameras with a fraction of a line between them and clocks of their own, synchronised over a long run."""

from __future__ import annotations

import heapq
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.prediction.predict import predict
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.rng import stream
from prooflight.scans.alignment import built_fraction
from prooflight_line.cameras.camera import Grab
from prooflight_line.cameras.counting import LineCounter
from prooflight_line.cameras.several import InStep
from prooflight_studies.cameras.camera_offset import camera_offset
from prooflight_studies.running.rig import DESIGN_SEED, Pieces

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

PIXELS: Final = 400
OFFSET_LINES: Final = 3.4
CLOCK_PPM: Final = 50.0
BLOCK_LINES: Final = 64
LINE_HZ: Final = 2770.0
LOST_OF: Final = 500
"""One block in this many is lost, of either camera."""
MEASURED_OF: Final = 4
"""Period of sheets on which the offset between the cameras is measured.

The lines of all sheets are compared with those played.
"""
DESIGNS: Final = 8
CAMERAS: Final = f"""
[[camera]]
id = "A"
[[camera]]
id = "B"
offset_lines = [{OFFSET_LINES}]
"""


def step_figures(*, sheets: int, seed: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """Align the two cameras, and measure the remaining offset between them."""
    progress("building a press of two cameras")
    text = PressFile.preset(TWO_SENSORS).text + CAMERAS
    press_file = PressFile(Path("two-cameras.toml"), text)
    press = build_press(press_file, seed=1, pixels=PIXELS)
    offsets = press_file.sensor_offsets()
    fraction = built_fraction(press.sensors[1].footprint, press.geometry)[0]
    pieces = Pieces(seed=DESIGN_SEED + 6, dpi=press.dpi)
    expected = [
        predict(press.geometry.lay(pieces.page(index)), sensors=press.sensors, geometry=press.geometry)
        for index in range(DESIGNS)
    ]
    lines = expected[0].expected_dn.shape[1]
    rng = stream(seed, "camera-losses", 1)

    @lru_cache(maxsize=32)
    def noisy(sheet: int, sensor: int) -> NDArray[np.uint16]:
        one = expected[sheet % DESIGNS]
        own = stream(seed, "camera-noise", sheet, sensor).standard_normal((lines, PIXELS), np.float32)
        dn = one.expected_dn[sensor] + own * np.sqrt(one.variance_dn2[sensor])
        return np.asarray(np.rint(dn).clip(0, 65535), np.uint16)

    step = InStep([[offset] for offset in offsets], names=("A", "B"))
    counters = [LineCounter(name=name) for name in "AB"]
    depth = deepest = other = 0
    measured: list[float] = []
    aligned: list[NDArray[np.uint16]] = []
    unseen: list[NDArray[np.bool_]] = []
    waiting, at = 0, 0
    streams = [_blocks(noisy, sensor, offsets[sensor].whole[0], lines, sheets, rng) for sensor in range(2)]
    for _, sensor, grab in heapq.merge(*streams, key=lambda one: one[0]):
        for block in counters[sensor].take(grab):
            for out in step.add(sensor, block):
                missing = np.zeros(out.lines.shape[1], bool)
                for fault in out.faults:
                    missing[max(fault.first_line - out.first_line, 0) : fault.next_line - out.first_line] = (
                        True
                    )
                aligned.append(out.lines)
                unseen.append(missing)
                waiting += out.lines.shape[1]
        depth = step.waiting_lines
        deepest = max(deepest, depth)
        while waiting >= lines:
            both, lines_lost = np.concatenate(aligned, axis=1), np.concatenate(unseen)
            sheet, lost = both[:, :lines], lines_lost[:lines]
            aligned, unseen, waiting = [both[:, lines:]], [lines_lost[lines:]], waiting - lines
            for sensor in range(2):
                other += int((sheet[sensor][~lost] != noisy(at, sensor)[~lost]).any(axis=1).sum())
            if at % MEASURED_OF == 0 and not lost.any():
                measured.append(camera_offset(sheet[0], sheet[1]).lines)
            at += 1
            if at % max(sheets // 10, 1) == 0:
                progress(f"two cameras: sheet {at} of {sheets}")
    off = np.array(measured) - fraction
    tenth = max(len(off) // 10, 1)
    means = [float(part.mean()) for part in np.array_split(off, max(len(off) // 50, 1))]
    seconds = sheets * lines / LINE_HZ
    return {
        "sheets": at,
        "measured": len(measured),
        "lines": sheets * lines,
        "offset_lines": OFFSET_LINES,
        "fraction": fraction,
        "clock_ppm": CLOCK_PPM,
        "clock_lines": seconds * CLOCK_PPM * 1e-6 * LINE_HZ,
        "lost_of": LOST_OF,
        "mean_off": float(off.mean()),
        "sd": float(off.std()),
        "most_off": float(np.abs(off).max()),
        "most_off_of_50": float(np.abs(means).max()),
        "first_tenth": float(off[:tenth].mean()),
        "last_tenth": float(off[-tenth:].mean()),
        "other_lines": other,
        "measured_of": MEASURED_OF,
        "most_held": deepest,
        "block_lines": BLOCK_LINES,
    }


def _blocks(
    noisy: Callable[[int, int], NDArray[np.uint16]],
    sensor: int,
    later: int,
    lines: int,
    sheets: int,
    rng: np.random.Generator,
) -> Iterator[tuple[float, int, Grab]]:
    """Yield a camera's blocks in order and at the time of their arrival, by its own clock and random delays."""
    rate = 1 + (CLOCK_PPM * 1e-6 if sensor else 0.0)
    empty = np.zeros((later, PIXELS), np.uint16)
    rest, number, arrived_s = empty, 0, 0.0
    for sheet in range(sheets + 1):
        rest = np.concatenate([rest, noisy(sheet, sensor)])
        while len(rest) >= BLOCK_LINES:
            block, rest = rest[:BLOCK_LINES], rest[BLOCK_LINES:]
            number += 1
            due_s = number * BLOCK_LINES / LINE_HZ * rate
            arrived_s = max(arrived_s, due_s + float(rng.exponential(0.02)))
            if number > 1 and rng.integers(LOST_OF) == 0:
                continue
            yield arrived_s, sensor, _grab(number, block, arrived_s)


def _grab(number: int, block: NDArray[np.uint16], time_s: float) -> Grab:
    return Grab(
        block_id=(65_400 + number) % 65_535 + 1,
        id_wraps=True,
        data=np.ascontiguousarray(block).astype("<u2").view(np.uint8).ravel(),
        missing=(),
        pixel_format="Mono16",
        lines=BLOCK_LINES,
        pixels=PIXELS,
        padding=0,
        time_s=time_s,
    )
