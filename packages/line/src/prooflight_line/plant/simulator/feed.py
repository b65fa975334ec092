"""Link by which the simulated press reports its sheets to the simulated controller; a real plant has no such link.

``watch --source drum:...`` feeds a simulated controller, so that its trays fill with the sheets of the drum,
and a person can see where each misprint went. The gate itself uses the register map only.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Final

from prooflight_line.plant.gate.link import Wire
from prooflight_line.plant.gate.log import PlantError
from prooflight_line.plant.simulator.plc import BeltSheet

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight.press.gate import PlcSettings
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.lines import LineBlock, LineSource
    from prooflight.simulation.drum import Turn
    from prooflight_line.plant.simulator.plc import SimulatedPlc

FEED_AT: Final = 128
FEED_ID: Final = 0x5349
FEED_WORDS: Final = 8
"""Registers of a message: its kind; the belt's speed [um/s] or a front [0.1 mm: 430 km of paper] in two
words; serial in two; truth; two of 0."""
STARTED, LAID = 1, 2
TRUTHS: Final = ("good", "misprint", "blank", "unknown", "repeated")


def feed_shown() -> list[int]:
    """Return the registers that a simulated controller shows at ``FEED_AT``."""
    return [FEED_ID]


def fed(plc: SimulatedPlc, words: Sequence[int]) -> None:
    """Take a message of a simulated press, which has started the belt or put a sheet on it."""
    number, serial = (words[1] << 16) | words[2], (words[3] << 16) | words[4]
    if words[0] == STARTED:
        plc.belt.start(number / 1e3, plc.clock())
    elif words[0] == LAID:
        truth = TRUTHS[min(words[5], len(TRUTHS) - 1)]
        plc.belt.lay(BeltSheet(serial=serial, front_mm=number / 10, truth=truth))


class FedDrum:
    """A drum as a line source that feeds a simulated controller from a thread of its own."""

    def __init__(
        self,
        plc: PlcSettings,
        geometry: ScanGeometry,
        passing: Iterable[Turn],
        *,
        misprints: Callable[[int], bool],
        speed_mm_s: float,
        sides: int = 1,
        first_serial: int = 0,
    ) -> None:
        """Prepare the link.

        Parameters
        ----------
        passing
            Turns that the drum shows; give the drum ``turns()`` instead.
        misprints
            Function that returns whether a side of the run is a misprint.
        sides
            Sides of a sheet, front and back in turn; a sheet goes to the gate only after its last side.
        first_serial
            Number of sheets that the press had put on the belt before.
        """
        self._sides = sides
        self._plc, self._geometry, self._passing = plc, geometry, passing
        self._misprints, self._speed_mm_s = misprints, speed_mm_s
        self._told: queue.SimpleQueue[list[int] | None] = queue.SimpleQueue()
        self._source: LineSource | None = None
        self._lines = 0
        self._serial = first_serial
        self._last_side = sides - 1
        self._moving = threading.Event()
        self._thread = threading.Thread(target=self._feed, name="simulated press", daemon=True)

    def turns(self) -> Iterator[Turn]:
        """Yield the turns; each sheet is put on the belt as it comes."""
        shown: set[int] = set()
        for turn in self._passing:
            kind = None if turn.fault is None else turn.fault.kind
            leaves = self._leaves(turn)
            if kind != "missing" and leaves:
                truth = self._truth(turn, shown)
                late_mm = turn.fault.amount if turn.fault is not None and kind == "slip" else 0.0
                front_mm = self._lines * self._geometry.line_pitch_mm + self._geometry.lead_in_mm + late_mm
                self._serial += 1
                self._tell(LAID, round(10 * front_mm), self._serial, TRUTHS.index(truth))
            yield turn

    def of(self, source: LineSource) -> FedDrum:
        """Return this object as a line source that wraps ``source``."""
        self._source = source
        self.sensors, self.pixels = source.sensors, source.pixels
        return self

    def blocks(self) -> Iterator[LineBlock]:
        """Yield the blocks of the drum; the belt starts with the first."""
        if self._source is None:
            return
        self._tell(STARTED, round(1e3 * self._speed_mm_s), 0, 0)
        self._thread.start()
        self._moving.wait()
        next_line = 0
        try:
            for block in self._source.blocks():
                self._lines += block.lines.shape[1] + max(block.first_line - next_line, 0)
                next_line = block.next_line
                yield block
        finally:
            self._told.put(None)

    def close(self) -> None:
        """Close the drum."""
        if self._source is not None:
            self._source.close()

    def _leaves(self, turn: Turn) -> bool:
        """Return whether a sheet goes on to the gate with this side.

        An unknown page is taken for the side that is due.
        """
        if turn.page is not None:
            self._last_side = turn.page % self._sides
        else:
            self._last_side = (self._last_side + 1) % self._sides
        return self._last_side == self._sides - 1

    def _truth(self, turn: Turn, shown: set[int]) -> str:
        if turn.page is None:
            return "blank" if turn.fault is not None and turn.fault.kind == "blank" else "unknown"
        first = turn.page - turn.page % self._sides
        if any(self._misprints(side) for side in range(first, turn.page + 1)):
            return "misprint"
        again = turn.page in shown
        shown.add(turn.page)
        return "repeated" if again else "good"

    def _tell(self, what: int, number: int, serial: int, truth: int) -> None:
        self._told.put([what, *divmod(number, 1 << 16), *divmod(serial, 1 << 16), truth, 0, 0])

    def _feed(self) -> None:
        try:
            with closing(Wire(self._plc)) as wire:
                while (words := self._told.get()) is not None:
                    with suppress(PlantError):
                        wire.feed(FEED_AT, words)
                    self._moving.set()
        except PlantError:
            return  # the gate's own link says so
        finally:
            self._moving.set()


def is_simulated(plc: PlcSettings) -> bool:
    """Return whether the controller is a simulated one of Prooflight; PlantError if it does not answer."""
    with closing(Wire(plc)) as wire:
        try:
            return wire.words(FEED_AT, 1) == [FEED_ID]
        except PlantError:
            return False
