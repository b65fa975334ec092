"""Set-up of the running study: designs, prints stored on disk, and sequences of sheets over them."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.files.atomic import whole_file
from prooflight.pages.parallel import in_order
from prooflight.pages.raster import Page
from prooflight.rng import stream
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.corpus.corpus import BLACK_ALONE, IN_BLACK, IN_COLOUR, design_name, design_page
from prooflight.simulation.corpus.designs.chance import often, pick_weighted
from prooflight.simulation.corpus.designs.design_style import DesignStyle
from prooflight.simulation.corpus.designs.sheet import Sheet
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.prints import Print
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

DESIGN_SEED: Final = 90_000
"""Seed of designs that no other study draws."""
PIECE_MM: Final = (36.0, 44.0)
"""Size of small sheets, for parts that need many of them."""
PIECES_TRIED: Final = 6
SYSTEM_PAGE: Final = 4096
"""Greatest number of bytes that the system reads at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class A4Designs:
    """Composed designs, all of A4."""

    seed: int
    dpi: float

    def page(self, index: int) -> Page:
        """Return design ``index``, from 0."""
        rng = stream(self.seed, "a4-design", index)
        black_alone = often(rng, BLACK_ALONE)
        layout = pick_weighted(rng, IN_BLACK if black_alone else IN_COLOUR)
        style = DesignStyle.draw(rng, black_alone=black_alone)
        sheet = Sheet(width_mm=210.0, height_mm=297.0, dpi=self.dpi)
        layout(sheet, rng, style)
        return Page(cmyk=sheet.cmyk, dpi=self.dpi, name=design_name(index), number=index + 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pieces:
    """Small pages, cropped from composed designs where these are busiest."""

    seed: int
    dpi: float

    def page(self, index: int) -> Page:
        """Return design ``index``, from 0."""
        whole = design_page(self.seed, index, dpi=self.dpi).cmyk
        columns, rows = (round(extent * self.dpi / 25.4) for extent in PIECE_MM)
        rng = stream(self.seed, "piece-places", index)
        places = [
            (
                int(rng.integers(0, whole.shape[0] - rows + 1)),
                int(rng.integers(0, whole.shape[1] - columns + 1)),
            )
            for _ in range(PIECES_TRIED)
        ]
        cuts = [whole[top : top + rows, left : left + columns] for top, left in places]
        busiest = max(cuts, key=lambda cut: float(np.abs(np.diff(cut[::4, ::4].astype(int), axis=1)).mean()))
        return Page(
            cmyk=np.ascontiguousarray(busiest), dpi=self.dpi, name=design_name(index), number=index + 1
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintWork:
    """Prints of the press world, written to disk; small and picklable."""

    press: Press
    designs: A4Designs
    folder: Path
    count: int
    """Number of designs."""
    seed: int
    wrong_every: int
    """One in this many prints is a misprint, of every kind in turn."""

    def __call__(self, index: int) -> None:
        """Print ``index``, of design index modulo their number, unless it is stored already."""
        scan_file = self.folder / f"scan{index:04}.npy"
        if scan_file.exists():
            return
        design = index % self.count
        page_file = self.folder / f"page{design:04}.npy"
        page = self.press.geometry.lay(self.designs.page(design))
        if not page_file.exists():
            _save(page_file, page.cmyk)
        if index % self.wrong_every == self.wrong_every - 1:
            _save(scan_file, self._wrong(page, index))
            return
        session = day(self.press, self.seed)
        rng = stream(self.seed, "running-print", index)
        print_ = Print.draw(session, self.press, page, rng)
        _save(scan_file, fast_scan(page, self.press, session, print_, rng=rng))

    def _wrong(self, page: Page, index: int) -> NDArray[np.uint16]:
        """Return a misprint of a page, its severity drawn evenly.

        If a kind does not have the least effect that counts, the next one is taken.
        """
        rng = stream(self.seed, "running-misprint", index)
        today = SimulatedDay(press=self.press, session=day(self.press, self.seed))
        others = [one for one in range(self.count) if one != index % self.count]
        for turn in range(len(KINDS)):
            wrong = today.wrong(
                today.good(page),
                KINDS[(index // self.wrong_every + turn) % len(KINDS)],
                others=others,
                fetch=lambda one: self.press.geometry.lay(self.designs.page(one)),
                rng=rng,
            )
            if wrong is not None:
                return today.recorded(today.seen(wrong, rng), rng)
        raise RuntimeError(f"design {index % self.count}: no misprint of any kind reaches the gate")


def _save(path: Path, array: NDArray[Any]) -> None:
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.save(file, array)


@lru_cache(maxsize=1)
def day(press: Press, seed: int) -> Session:
    """Return the session of all prints of a seed, one object a process."""
    return Session.draw(amounts_of(press), press, stream(seed, "session"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ring:
    """Prints ready to be played, and the pages that they are of; a ``PageStore``."""

    scans: list[NDArray[np.uint16]]
    pages: tuple[Page, ...]
    sheets: int = 1
    repeated: bool
    """Whether sheets of one page are one design; False: every sheet is new to the inspection."""
    wrong: frozenset[int] = frozenset()
    """Indices of the prints that are misprints."""

    def is_wrong(self, sheet: int) -> bool:
        """Return whether a sheet is a misprint."""
        return sheet % len(self.scans) in self.wrong

    def with_fewer_wrong(self, keep: int) -> Ring:
        """Return the same with ``keep`` of its misprints; the others are replaced by good prints of their designs."""
        wrong, designs, count = sorted(self.wrong), len(self.pages), len(self.scans)
        remaining = frozenset(wrong[:: -(-len(wrong) // keep)][:keep]) if keep else frozenset[int]()
        scans = list(self.scans)
        for print_ in self.wrong - remaining:
            of_design = range(print_ % designs, count, designs)
            scans[print_] = self.scans[next(one for one in of_design if one not in self.wrong)]
        return replace(self, scans=scans, wrong=remaining)

    def __len__(self) -> int:
        return self.sheets

    def design(self, sheet: int) -> int:
        """See ``PageStore``."""
        return sheet % len(self.pages) if self.repeated else sheet

    def page(self, sheet: int) -> Page:
        """See ``PageStore``."""
        return self.pages[sheet % len(self.pages)]


def ring(
    press: Press,
    designs: A4Designs,
    folder: Path,
    *,
    count: int,
    prints: int,
    repeated: bool,
    seed: int,
    shown: Callable[[Iterator[None], int], Iterator[None]],
    wrong_every: int,
) -> Ring:
    """Return ``prints`` prints of ``count`` designs, rendered where they are not on disk yet; scans are in memory."""
    folder.mkdir(parents=True, exist_ok=True)
    _same_press(folder / "press.json", press)
    work = PrintWork(
        press=press, designs=designs, folder=folder, count=count, seed=seed, wrong_every=wrong_every
    )
    todo = [index for index in range(prints) if not (folder / f"scan{index:04}.npy").exists()]
    for _ in shown(in_order(work, todo), len(todo)):
        pass
    pages = []
    for index in range(count):
        cmyk = np.asarray(np.load(folder / f"page{index:04}.npy", mmap_mode="r"))
        # In memory before the run begins: no press renders from a cold disk.
        cmyk.ravel()[::SYSTEM_PAGE].max()
        pages.append(Page(cmyk=cmyk, dpi=designs.dpi, name=design_name(index), number=index + 1))
    scans = [np.load(folder / f"scan{index:04}.npy") for index in range(prints)]
    wrong = frozenset(range(wrong_every - 1, prints, wrong_every))
    return Ring(scans=scans, pages=tuple(pages), repeated=repeated, wrong=wrong)


def _same_press(path: Path, press: Press) -> None:
    """Delete prints of another press. Training of a press changes no print."""
    digest = replace(press, detectors={}).digest
    if path.exists() and json.loads(path.read_text())["press"] != digest:
        for file in path.parent.glob("*.npy"):
            file.unlink()
    path.write_text(json.dumps({"press": digest}))
