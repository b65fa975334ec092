"""Simulated drum: scans rendered in advance pass the camera one after the other, with requested faults."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import TYPE_CHECKING, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import RequestError
from prooflight.scans.lines import BLOCK_LINES, LineBlock
from prooflight.scans.pacing import Pacer

if TYPE_CHECKING:
    from prooflight.press.artefact import Press

OrderFault = Literal["blank", "repeated", "missing", "out-of-order", "unknown"]
LineFault = Literal["slip", "stretch", "lost-lines", "extra-lines", "splice"]
ORDER_FAULTS: Final[tuple[OrderFault, ...]] = get_args(OrderFault)
LINE_FAULTS: Final[tuple[LineFault, ...]] = get_args(LineFault)
AMOUNTS: Final = {
    "slip": (2.5, 15.0),
    "stretch": (0.3, 1.0),
    "lost-lines": (15.0, 60.0),
    "extra-lines": (15.0, 60.0),
    "splice": (12.0, 40.0),
    "missing": (0.0, 1.0),
}
"""Least and greatest amount drawn, in the units of ``DrumFault.amount``.

Assumed: the range that an operator calls a fault.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrumFault:
    """Fault at one sheet."""

    kind: OrderFault | LineFault
    amount: float = 0.0
    """Amount of the fault.

    slip: delay [mm]. stretch: additional length [%]. lost-lines, extra-lines: number of lines. splice: the
    tape's height [mm]. missing: 1 leaves the sheet's room empty.
    """
    at: float = 0.5
    """Position on the sheet, as a share of its scan. [-]"""
    counted: bool = True
    """Whether the camera's count shows lost or extra lines; otherwise the transport's encoder erred."""

    @classmethod
    def draw(cls, kind: OrderFault | LineFault, rng: np.random.Generator) -> DrumFault:
        """Draw a fault of a kind, its amount of ``AMOUNTS``, anywhere in the sheet's inner 60 %."""
        sign = 1.0 if rng.random() < 0.5 else -1.0
        low, high = AMOUNTS.get(kind, (0.0, 0.0))
        amount = float(rng.uniform(low, high)) * (sign if kind == "stretch" else 1.0)
        if kind in ("lost-lines", "extra-lines", "missing"):
            amount = float(round(amount))
        return cls(
            kind=kind, amount=amount, at=float(rng.uniform(0.2, 0.8)), counted=bool(rng.random() < 0.5)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """Next object that passes the camera."""

    page: int | None
    """Index of the job's sheet; None: none of them."""
    fault: DrumFault | None = None
    """Fault of the lines; also ``blank``, ``unknown`` and ``missing``, where no page is shown."""


def turns(sheets: int, faults: Mapping[int, DrumFault]) -> list[Turn]:
    """Return the sheets 0 to ``sheets`` - 1 of a job in the order of their passing, with faults at some of them.

    blank, unknown: another sheet comes in this one's place. repeated: it comes twice. missing: it does not
    come. out-of-order: it comes after the one that follows. RequestError: a fault at a sheet that is not
    there, or at two sheets of which one has the other's place.
    """
    order = list(range(sheets))
    for sheet, fault in faults.items():
        swapped = fault.kind == "out-of-order"
        if not 0 <= sheet < sheets - swapped or (swapped and sheet + 1 in faults):
            what = f"{fault.kind} at sheet {sheet} of {sheets}"
            raise RequestError("drum", what, remedy="place faults without overlap, and on the job's sheets")
        if swapped:
            order[sheet], order[sheet + 1] = sheet + 1, sheet
    passing = []
    for sheet in order:
        of_sheet = faults.get(sheet)
        if of_sheet is None or of_sheet.kind == "out-of-order":
            passing.append(Turn(page=sheet))
        elif of_sheet.kind in ("blank", "unknown", "missing"):
            passing.append(Turn(page=None, fault=of_sheet))
        elif of_sheet.kind == "repeated":
            passing += [Turn(page=sheet), Turn(page=sheet)]
        else:
            passing.append(Turn(page=sheet, fault=of_sheet))
    return passing


class Drum:
    """``LineSource`` that plays scans; blocks are views of them, so that playing costs next to nothing."""

    def __init__(
        self,
        scans: Sequence[NDArray[np.uint16]],
        *,
        press: Press,
        passing: Iterable[Turn],
        pages_per_s: float | None = None,
        blank: NDArray[np.uint16] | Callable[[], NDArray[np.uint16]] | None = None,
        foreign: NDArray[np.uint16] | Callable[[], NDArray[np.uint16]] | None = None,
        scan_lines: float | None = None,
        gap_lines: int = 0,
        block_lines: int = BLOCK_LINES,
        waits: bool = False,
        pacer: Pacer | None = None,
    ) -> None:
        """Prepare to play scans (sensors, lines, pixels); sheet i of the job shows scan i modulo their number. [DN]

        passing: as ``turns`` makes it, or without end. pages_per_s: at the scans' mean length, since a web runs at one
        speed; None: as fast as they are read. blank, foreign: scans of such sheets, for faults, or functions that
        return them. scan_lines: mean number of lines of a scan; None: of all, which are there. gap_lines: of backing
        between scans, besides their own. waits: whether the drum stands still while nobody takes lines, or while a
        scan is not there yet. pacer: replaces the own one.
        """
        if not scans:
            raise RequestError("drum", "there are no scans", remedy="give at least one")
        self.sensors, _, self.pixels = scans[0].shape
        self._scans, self._press, self._passing = scans, press, passing
        self._other = {"blank": blank, "unknown": foreign}
        backing = np.stack([s.column_offset_dn + s.column_gain * s.backing_dn for s in press.sensors])
        self._backing = np.rint(backing).clip(0).astype(np.uint16)[:, None]
        self._gap_lines, self._block_lines, self._closed = gap_lines, block_lines, False
        if scan_lines is None:
            scan_lines = fmean(scan.shape[1] for scan in scans)
        self.page_lines = scan_lines + gap_lines
        """Mean number of lines from page to page."""
        rate_hz = None if pages_per_s is None else pages_per_s * self.page_lines
        self._pacer = pacer or Pacer(rate_hz, waits=waits)

    def blocks(self) -> Iterator[LineBlock]:
        """Yield blocks until nothing more passes."""
        count = 0
        for turn in self._passing:
            for jump, lines in self._pieces(turn):
                count += jump
                for start in range(0, lines.shape[1], self._block_lines):
                    if self._closed:
                        return
                    part = lines[:, start : start + self._block_lines]
                    time_s = self._pacer.read(part.shape[1] + max(jump, 0))
                    if self._closed:
                        return
                    block = LineBlock(first_line=count, lines=part, time_s=time_s)
                    count, jump = count + part.shape[1], 0
                    yield block

    def close(self) -> None:
        """Stop playing."""
        self._closed = True
        self._pacer.stop()

    def _pieces(self, turn: Turn) -> Iterator[tuple[int, NDArray[np.uint16]]]:
        """Yield the lines of a turn, each piece with the jump of the camera's count before it."""
        if self._gap_lines:
            yield 0, self._empty(self._gap_lines)
        if turn.page is not None:
            scan = self._scans[turn.page % len(self._scans)]
            yield from ((0, scan),) if turn.fault is None else self._faulty(scan, turn.fault)
        elif turn.fault is not None and turn.fault.kind != "missing":
            yield 0, self._other_sheet(turn.fault.kind)
        elif turn.fault is not None and turn.fault.amount:
            yield 0, self._empty(self._scans[0].shape[1])

    def _faulty(self, scan: NDArray[np.uint16], fault: DrumFault) -> Iterator[tuple[int, NDArray[np.uint16]]]:
        """Yield the pieces of a scan with a fault of its lines."""
        cut, kind = round(fault.at * scan.shape[1]), fault.kind
        if kind == "slip":
            yield 0, self._empty(round(fault.amount / self._press.geometry.line_pitch_mm))
            yield 0, scan
        elif kind == "stretch":
            yield 0, stretched(scan, fault.amount)
        elif kind == "splice":
            yield 0, taped(scan, fault, self._press, self._backing)
        elif kind == "lost-lines":
            yield 0, scan[:, :cut]
            lost = round(fault.amount)
            yield lost if fault.counted else 0, scan[:, cut + lost :]
        elif kind == "extra-lines":
            yield 0, scan[:, :cut]
            extra = round(fault.amount)
            again = (
                scan[:, cut - extra : cut] if fault.counted else np.repeat(scan[:, cut - 1 : cut], extra, 1)
            )
            yield -extra if fault.counted else 0, again
            yield 0, scan[:, cut:]

    def _other_sheet(self, kind: str) -> NDArray[np.uint16]:
        given = self._other.get(kind)
        scan = given() if callable(given) else given
        if scan is None:
            what = f"a fault {kind} without a scan of such a sheet"
            raise RequestError("drum", what, remedy="give `blank` and `foreign`")
        return scan

    def _empty(self, lines: int) -> NDArray[np.uint16]:
        return np.repeat(self._backing, lines, axis=1)


def stretched(scan: NDArray[np.uint16], percent: float) -> NDArray[np.uint16]:
    """Return a scan of paper that ran too slow or too fast: lines read twice, or skipped, at even distances."""
    lines = scan.shape[1]
    read = np.arange(round(lines * (1 + percent / 100))) / (1 + percent / 100)
    return scan[:, np.minimum(read.astype(np.intp), lines - 1)]


TAPE_LIGHT: Final = 0.62
"""assumed: brown paper tape, between paper white and solid inks. [white]"""


def taped(
    scan: NDArray[np.uint16], fault: DrumFault, press: Press, backing_dn: NDArray[np.uint16]
) -> NDArray[np.uint16]:
    """Return a scan of a sheet with a splice's tape across it, which hides the print.

    backing_dn: (sensors, 1, pixels).
    """
    half = round(fault.amount / press.geometry.line_pitch_mm / 2)
    middle = round(fault.at * scan.shape[1])
    taped_scan = scan.copy()
    rows = slice(max(middle - half, 0), middle + half)
    seen = np.abs(scan[0, middle].astype(np.int32) - backing_dn[0, 0]) > backing_dn[0, 0] // 2
    columns = np.flatnonzero(seen)
    across = slice(int(columns[0]), int(columns[-1]) + 1) if columns.size else slice(0, 0)
    for image, sensor in zip(taped_scan, press.sensors, strict=True):
        level = sensor.column_offset_dn + sensor.column_gain * (TAPE_LIGHT * sensor.white_dn)
        image[rows, across] = np.rint(level[across]).astype(np.uint16)
    return taped_scan
