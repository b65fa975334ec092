"""Pictures of sheets: expected pages are made once and cached within a bound, the rest on request."""

from __future__ import annotations

import hashlib
import logging
import multiprocessing
import os
import re
import shutil
import threading
from collections import OrderedDict
from concurrent.futures import CancelledError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from prooflight.errors import ProoflightError
from prooflight.pages.layout.plan import facts_plan
from prooflight.pages.raster import MM_PER_INCH
from prooflight_console.pictures.expected import TILE, Pyramid, levels_of, make, yielding
from prooflight_console.pictures.seen import WHOLE, make_seen
from prooflight_console.pictures.tiles import (
    LAYERS,
    SheetPicture,
    aligned,
    drawn,
    thumbnail,
)
from prooflight_console.problems import Problem, not_found
from prooflight_line.journal.arrays import NAME
from prooflight_line.journal.cuts import Cut, cuts_of, whole_cut
from prooflight_line.journal.labels import run_key

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Future
    from pathlib import Path

    from prooflight_console.reading.stations import Stations
    from prooflight_line.journal.records import PageRecord, RunRow

Result = TypeVar("Result")

_log = logging.getLogger(__name__)

VERSION: Final = "3"
"""Version of the rendering, a part of cache keys: with a new one browsers load pictures again."""
MOST_AHEAD: Final = 4
MOST_CACHED: Final = 64
"""Number of sheets with cuts in memory, a quarter of a megabyte each."""
MOST_THUMBNAILS: Final = 1000
"""Number of thumbnails in memory, some kilobytes each."""
PITCH_MM: Final = MM_PER_INCH / 240
"""Pixel pitch of pictures of unknown pages; assumed: the prototype's."""
A4_MM: Final = (210.0, 297.0)
THUMBNAIL: Final = 224
MAKING: Final = (ProoflightError, OSError, ValueError, RuntimeError, MemoryError, CancelledError)
"""Errors that end the making of a page."""
NOT_STARTED: Final = "no process can be started that draws pages"
PROCESS_ENDED: Final = (
    "the process that draws pages ended before this was done, perhaps because memory ran out"
)
AGAIN: Final = "close other programs on this machine, and try again"
_NAME = re.compile(r"p([0-9]{4,7})")


class Pictures:
    """Pictures of all runs. The methods are thread-safe."""

    version = VERSION

    def __init__(self, folder: Path, *, bound_bytes: int, stations: Stations) -> None:
        self._folder, self._bound_bytes, self._stations = folder, bound_bytes, stations
        self._guard = threading.Lock()
        self._sheets: OrderedDict[tuple[str, int], SheetPicture] = OrderedDict()
        self._thumbnails: OrderedDict[tuple[str, int], bytes | None] = OrderedDict()
        self._making: dict[str, Future[None]] = {}
        self._refused: dict[str, str] = {}
        self._pool: ProcessPoolExecutor | None = None

    def close(self) -> None:
        """End the process that makes pages."""
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(cancel_futures=True)

    def warm(self) -> None:
        """Draw a tile in advance: the first tile of a process takes a sixth of a second more than others."""
        cut = Cut(signal=np.ones((64, 64), np.float32), box_mm=(1.0, 1.0, 6.8, 6.8))
        picture = SheetPicture(
            width=TILE, height=TILE, width_mm=54.0, height_mm=54.0, levels=2, cuts=(cut,), expected=None
        )
        for level in (0, 1):
            picture.tile("scan", level, 0, 0)
        drawn("difference", cut.signal, cut.signal)

    def describe(self, run: RunRow, page: PageRecord, *, wait: bool = True) -> dict[str, Any]:
        """Describe the pictures of a sheet; see ``PictureAnswer``.

        wait: for pictures that are not made yet; otherwise they are begun, and "note" is "coming".
        """
        picture = self._picture(run, page, wait=wait)
        return {
            "width": picture.width,
            "height": picture.height,
            "tile": TILE,
            "levels": picture.levels,
            "width_mm": picture.width_mm,
            "height_mm": picture.height_mm,
            "layers": list(picture.layers),
            "regions": [
                {
                    "x_mm": one.x_mm + moved[0],
                    "y_mm": one.y_mm + moved[1],
                    "width_mm": one.width_mm,
                    "height_mm": one.height_mm,
                    "kind": one.kind,
                }
                for one, moved in zip(
                    page.verdict.regions, picture.moved_mm(len(page.verdict.regions)), strict=True
                )
            ],
            "cuts": [{"box_mm": list(cut.box_mm)} for cut in picture.cuts],
            "whole": picture.seen is not None or any(cut.region is None for cut in picture.cuts),
            "note": self._note(run, page, picture),
        }

    def tile(
        self,
        run: RunRow,
        sheet: int,
        read: Callable[[], PageRecord],
        *,
        layer: str,
        level: int,
        column: int,
        row: int,
    ) -> bytes:
        """Return a tile as WebP; raises ``Problem`` 404.

        read: loads the sheet if its picture is not in memory.
        """
        if layer in LAYERS:
            picture = self._cached(run, sheet) or self._picture(run, read(), wait=True)
            tile = picture.tile(layer, level, column, row)
            if tile is not None:
                return tile
        raise not_found(f"sheet {sheet} has no tile {layer[:20]}/{level}/{column}/{row}")

    def thumbnail(self, run: RunRow, sheet: int, read: Callable[[], PageRecord]) -> bytes | None:
        """Return a small picture of the first region in the scan; None if no scan of it is stored.

        read: loads the sheet if its thumbnail is not in memory. Many browsers ask for the same one at once.
        """
        key = run_key(run), sheet
        with self._guard:
            if key in self._thumbnails:
                self._thumbnails.move_to_end(key)
                return self._thumbnails[key]
        thumbnail = self._thumbnail(run, read())
        with self._guard:
            self._thumbnails[key] = thumbnail
            while len(self._thumbnails) > MOST_THUMBNAILS:
                self._thumbnails.popitem(last=False)
        return thumbnail

    def _thumbnail(self, run: RunRow, page: PageRecord) -> bytes | None:
        number = page_number(run, page)
        size = None if number is None else self._size_mm(run, number)
        placed: Any = {
            "page_width_mm": None if size is None else size[0],
            "shift_mm": page.verdict.shift_mm,
        }
        press = self._stations.press(run)
        cuts = cuts_of(page.evidence, press, **placed) or whole_cut(page.evidence, press, **placed)
        return thumbnail(cuts, page.verdict.regions, side=THUMBNAIL)

    def ahead(self, run: RunRow, page: PageRecord) -> None:
        """Begin the page of a misprint before it is opened, unless many are pending; does not wait."""
        number = page_number(run, page)
        if (
            number is None
            or len(self._making) >= MOST_AHEAD
            or Pyramid.read(self._folder / _key(run, number))
        ):
            return
        self._begun(run, number)

    def aside(self, work: Callable[..., Result], *given: Any) -> Result:
        """Run ``work`` in the process that makes pictures, and wait; raises the errors of ``work``.

        Raises ``Problem`` 503 if no process can be started, or if it ended before this was done.
        """
        with self._guard:
            doing = self._submitted(work, *given)
        try:
            return doing.result()
        except (BrokenProcessPool, CancelledError) as error:
            with self._guard:
                self._pool = None
            raise Problem(503, "no-process", f"{PROCESS_ENDED}; {AGAIN}") from error

    # --- parts ---

    def _cached(self, run: RunRow, sheet: int) -> SheetPicture | None:
        key = run_key(run), sheet
        with self._guard:
            if (picture := self._sheets.get(key)) is not None:
                self._sheets.move_to_end(key)
            return picture

    def _picture(self, run: RunRow, page: PageRecord, *, wait: bool) -> SheetPicture:
        if (cached := self._cached(run, page.sheet)) is not None:
            return cached
        picture = self._make_picture(run, page, wait=wait)
        if picture.coming:
            return picture
        with self._guard:
            self._sheets[run_key(run), page.sheet] = picture
            while len(self._sheets) > MOST_CACHED:
                self._sheets.popitem(last=False)
        return picture

    def _make_picture(self, run: RunRow, page: PageRecord, *, wait: bool) -> SheetPicture:
        number = page_number(run, page)
        expected = None if number is None else self._expected(run, number, wait=wait)
        coming = expected is None and number is not None and not wait and self._begun(run, number) is not None
        size = None if expected is None else (expected.width_mm, expected.height_mm)
        cuts = cuts_of(
            page.evidence,
            self._stations.press(run),
            page_width_mm=None if size is None else size[0],
            shift_mm=page.verdict.shift_mm,
        )
        seen = None
        if not cuts:
            placed: Any = {
                "page_width_mm": None if size is None else size[0],
                "shift_mm": page.verdict.shift_mm,
            }
            if expected is not None:
                seen = self._seen(run, page, expected, wait=wait)
                coming = coming or (seen is None and not wait and NAME in (page.evidence or {}))
            if seen is None and not coming:
                cuts = whole_cut(page.evidence, self._stations.press(run), **placed)
        if expected is not None:
            regions = dict(enumerate(page.verdict.regions))
            cuts = tuple(
                aligned(cut, expected, None if cut.region is None else regions.get(cut.region))
                for cut in cuts
            )
            width, height, levels = expected.width, expected.height, expected.levels
            width_mm, height_mm = expected.width_mm, expected.height_mm
        else:
            boxes = [cut.box_mm for cut in cuts]
            boxes += [(one.x_mm, one.y_mm, one.width_mm, one.height_mm) for one in page.verdict.regions]
            least = (0.0, 0.0) if cuts and cuts[0].region is None else A4_MM  # a whole sheet has its own size
            width_mm = max([least[0], *(x + w for x, _, w, _ in boxes)])
            height_mm = max([least[1], *(y + h for _, y, _, h in boxes)])
            width, height = (
                min(max(round(extent / PITCH_MM), 1), 40_000) for extent in (width_mm, height_mm)
            )
            levels = levels_of(width, height)
        return SheetPicture(
            width=width,
            height=height,
            width_mm=width_mm,
            height_mm=height_mm,
            levels=levels,
            cuts=cuts,
            expected=expected,
            seen=seen,
            coming=coming,
        )

    def _seen(self, run: RunRow, page: PageRecord, expected: Pyramid, *, wait: bool) -> Pyramid | None:
        """Return the whole scan of a sheet on its page's grid, waiting for it with ``wait``.

        Returns None if it is not stored, cannot be read, or is not made yet.
        """
        if page.evidence is None or NAME not in page.evidence:
            return None
        named = f"seen {run_key(run)} {page.sheet} {expected.folder.name} {VERSION}"
        folder = self._folder / hashlib.sha256(named.encode()).hexdigest()[:32]
        if (pyramid := Pyramid.read(folder)) is not None:
            os.utime(folder)
            return pyramid
        if not wait:
            return None
        whole_scan = {name: page.evidence[name] for name in WHOLE if name in page.evidence}
        try:
            self.aside(
                make_seen, whole_scan, self._stations.press_file(run), page.verdict.shift_mm, expected, folder
            )
        except MAKING as error:
            _log.warning("the scan of sheet %d cannot be pictured (%s)", page.sheet, error)
            return None
        tidy(self._folder, self._bound_bytes, keep=folder)
        return Pyramid.read(folder)

    def _note(self, run: RunRow, page: PageRecord, picture: SheetPicture) -> str:
        """Return the reason why something is not shown, a key of the languages; empty if everything is."""
        if page_number(run, page) is None:
            return "no-page"
        if picture.coming:
            return "coming"
        if picture.expected is None:
            return (
                "no-job"
                if self._stations.job(run) is None or self._stations.press(run) is None
                else "no-picture"
            )
        return "" if picture.cuts or picture.seen is not None else "no-cuts"

    def _expected(self, run: RunRow, number: int, *, wait: bool) -> Pyramid | None:
        """Return the expected image of a page, waiting for it with ``wait``; None if it is not made."""
        folder = self._folder / _key(run, number)
        if (pyramid := Pyramid.read(folder)) is not None:
            os.utime(folder)
            return pyramid
        making = self._begun(run, number)
        if making is None or not (wait or making.done()):
            return None
        try:
            making.result()
        except MAKING:  # logged by ``_finish``
            return None
        return Pyramid.read(folder)

    def _begun(self, run: RunRow, number: int) -> Future[None] | None:
        """Return the pending task of a page, begun if it was not.

        Returns None if its job or press is missing, or if the page cannot be made.
        """
        job, press = self._stations.job(run), self._stations.press_file(run)
        if job is None or press is None:
            return None
        key = _key(run, number)
        with self._guard:
            if key in self._refused:
                return None
            if (making := self._making.get(key)) is not None:
                return making
            plan = facts_plan(run.facts.settings)
            layout = None if plan is None else plan.layout
            try:
                making = self._submitted(make, job, number, press, self._folder / key, layout)
            except Problem as error:
                _log.warning("page %d of %s cannot be pictured (%s)", number, job.name, error)
                return None
            self._making[key] = making
        # The callback takes the lock, and a finished task calls it at once; so add it outside the lock.
        making.add_done_callback(partial(self._finish, key, f"page {number} of {job.name}"))
        return making

    def _finish(self, key: str, what: str, making: Future[None]) -> None:
        folder = self._folder / key
        error = None if making.cancelled() else making.exception()
        if error is not None:
            _log.warning("%s cannot be pictured (%s)", what, error)
            shutil.rmtree(folder, ignore_errors=True)
        elif folder.is_dir():
            tidy(self._folder, self._bound_bytes, keep=folder)
        with self._guard:
            self._making.pop(key, None)
            if isinstance(error, BrokenProcessPool):  # ended by the system, as when memory runs out
                self._pool = None
            if error is not None:
                self._refused[key] = str(error)

    def _size_mm(self, run: RunRow, number: int) -> tuple[float, float] | None:
        """Return the size of a page that was pictured before. [mm]"""
        pyramid = Pyramid.read(self._folder / _key(run, number))
        return None if pyramid is None else (pyramid.width_mm, pyramid.height_mm)

    def _submitted(self, work: Callable[..., Result], *given: Any) -> Future[Result]:
        """Submit work to the process, with the lock held; raises ``Problem`` 503 if none can be started."""
        try:
            try:
                return self._workers().submit(work, *given)
            except BrokenProcessPool:  # the process was ended while it was idle
                self._pool = None
                return self._workers().submit(work, *given)
        except (BrokenProcessPool, OSError) as error:
            self._pool = None
            raise Problem(503, "no-process", f"{NOT_STARTED}; {AGAIN}") from error

    def _workers(self) -> ProcessPoolExecutor:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(max_workers=1, mp_context=context, initializer=yielding)
        return self._pool


def page_number(run: RunRow, page: PageRecord) -> int | None:
    """Return the page, or side, of the job that a sheet shows, from 1; None if it shows none.

    A run prints its job over and over, and ``job_page`` counts on; the page's name identifies the page.
    """
    plan = facts_plan(run.facts.settings)
    if plan is not None:
        return None if page.job_page is None else plan.number_at(page.job_page)
    named = _NAME.fullmatch(page.verdict.page)
    return None if named is None or page.job_page is None else int(named[1])


def _key(run: RunRow, number: int) -> str:
    """Return the name of the folder of a page."""
    plan = facts_plan(run.facts.settings)
    layout = "" if plan is None else plan.layout.text
    named = f"{run.facts.job_digest} {run.facts.press_digest} {number} {layout} {VERSION}"
    return hashlib.sha256(named.encode()).hexdigest()[:32]


def tidy(folder: Path, bound_bytes: int, *, keep: Path) -> None:
    """Remove the folders used longest ago until the rest is within the bound; ``keep`` stays."""
    folders = []
    for each in folder.iterdir():
        if each.is_dir() and not each.is_symlink():
            size = sum(file.stat().st_size for file in each.iterdir() if file.is_file())
            folders.append((each.stat().st_mtime, size, each))
    total = sum(size for _, size, _ in folders)
    for _, size, each in sorted(folders):
        if total <= bound_bytes:
            break
        if each != keep:
            shutil.rmtree(each, ignore_errors=True)
            total -= size
