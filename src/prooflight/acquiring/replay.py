"""Recorded scans: TIFF files of raw digital numbers, uint16 (sensors, lines, pixels); also played as lines."""

from __future__ import annotations

import contextlib
import json
import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import tifffile

from prooflight.acquiring.lines import BLOCK_LINES, LineBlock
from prooflight.acquiring.pacing import Pacer
from prooflight.atomic import whole_file
from prooflight.errors import ScanError
from prooflight.pages.job import natural_order

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

SUFFIXES = (".tif", ".tiff")


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedScan:
    """Where one page's scan is stored; read only when its turn comes."""

    path: Path
    first_image: int
    """Place of its first sensor's image in the file."""
    sensors: int

    @property
    def name(self) -> str:
        """The file's stem, which names the page in a folder of scans."""
        return self.path.stem

    def read(self) -> NDArray[np.uint16]:
        """The scan, (sensors, lines, pixels) [DN]; ScanError if it is truncated or of another form."""
        try:
            with _opened(self.path) as file:
                wanted = range(self.first_image, self.first_image + self.sensors)
                images = [file.pages[index].asarray() for index in wanted]
        except Exception as error:  # decoders raise whatever damage leads them to, MemoryError included
            raise ScanError(self.path, "is damaged or not a TIFF", remedy="scan the page again") from error
        shapes = {(image.dtype.name, image.shape) for image in images}
        if len(shapes) > 1 or images[0].dtype != np.uint16 or images[0].ndim != 2 or not images[0].size:
            what = f"holds images of {' and '.join(f'{name} {shape}' for name, shape in sorted(shapes))}"
            remedy = "give raw digital numbers, one uint16 (lines, pixels) image for each sensor"
            raise ScanError(self.path, what, remedy=remedy)
        return np.stack(images)


def write_scan(path: Path, dn: NDArray[np.uint16], *, facts: Mapping[str, object]) -> None:
    """Write one page's scan (sensors, lines, pixels) with ``facts`` as JSON in its description; atomic."""
    with whole_file(path) as unfinished:
        tifffile.imwrite(
            unfinished,
            dn,
            photometric="minisblack",
            metadata=None,
            description=json.dumps(facts, sort_keys=True),
        )


def recorded_scans(path: Path, *, sensors: int, damaged: bool = False) -> list[RecordedScan]:
    """Scans in page order: a folder's TIFF files in natural order of their names, or one multi-page file.

    A file holds one image for each of ``sensors`` sensors, page after page. damaged: whether a file of a folder that
    cannot even be counted is one scan, which says so when it is read. ScanError if there is nothing to read, or else.
    """
    if path.is_dir():
        files = sorted(
            (
                file
                for file in path.iterdir()
                if file.suffix.lower() in SUFFIXES and not file.name.startswith(".")
            ),
            key=lambda file: natural_order(file.name),
        )
        if not files:
            raise ScanError(
                path, "holds no TIFF files", remedy="give the folder that `prooflight simulate` wrote"
            )
        return [scan for file in files for scan in _scans_of(file, sensors, damaged=damaged)]
    if not path.is_file():
        raise ScanError(
            path, "there is no such file or folder", remedy="give a folder of scans or a TIFF file"
        )
    return _scans_of(path, sensors)


class Replay:
    """Recorded scans played one after the other, as a camera would have seen them."""

    def __init__(
        self,
        scans: Sequence[RecordedScan],
        *,
        sensors: int,
        pixels: int,
        line_rate_hz: float | None = None,
        block_lines: int = BLOCK_LINES,
        pacer: Pacer | None = None,
    ) -> None:
        """line_rate_hz: None: as fast as they are taken."""
        self.sensors, self.pixels = sensors, pixels
        self._scans, self._block_lines, self._closed = scans, block_lines, False
        self._pacer = pacer or Pacer(line_rate_hz)

    def blocks(self) -> Iterator[LineBlock]:
        """All lines of all scans. ScanError: one is damaged or of another camera."""
        first = 0
        for scan in self._scans:
            lines = scan.read()
            if lines.shape[::2] != (self.sensors, self.pixels):
                what = f"is of {lines.shape[0]} sensors x {lines.shape[2]} pixels"
                remedy = f"the press has {self.sensors} sensors x {self.pixels} pixels"
                raise ScanError(scan.path, what, remedy=remedy)
            for start in range(0, lines.shape[1], self._block_lines):
                block = lines[:, start : start + self._block_lines]
                time_s = self._pacer.read(block.shape[1])
                if self._closed:
                    return
                yield LineBlock(first_line=first, lines=block, time_s=time_s)
                first += block.shape[1]

    def close(self) -> None:
        """Play no more."""
        self._closed = True
        self._pacer.stop()


class _Complaints(logging.Handler):
    """What tifffile would only log: tags or images that lie beyond the end of the file."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.first: str | None = None

    def emit(self, record: logging.LogRecord) -> None:
        self.first = self.first or record.getMessage()


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[tifffile.TiffFile]:
    """A TIFF file; what tifffile complains of is an error, for a scan that is damaged is not to be judged."""
    complaints = _Complaints()
    tifffile.logger().addHandler(complaints)
    try:
        with tifffile.TiffFile(path) as file:
            yield file
            list(file.pages)
    finally:
        tifffile.logger().removeHandler(complaints)
    if complaints.first:
        raise ValueError(complaints.first)


def _scans_of(path: Path, sensors: int, *, damaged: bool = False) -> list[RecordedScan]:
    try:
        with _opened(path) as file:
            count = len(file.pages)
    except Exception as error:  # as above
        if damaged:
            return [RecordedScan(path=path, first_image=0, sensors=sensors)]
        raise ScanError(path, "is damaged or not a TIFF", remedy="scan the page again") from error
    if not count or count % sensors:
        what = f"holds {count} images where the press has {sensors} sensors"
        raise ScanError(path, what, remedy="give one image for each sensor of each page")
    return [RecordedScan(path=path, first_image=first, sensors=sensors) for first in range(0, count, sensors)]
