"""Recorded scans: TIFF files of raw digital numbers, uint16 (sensors, lines, pixels); also played as lines."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray

from prooflight.errors import ScanError
from prooflight.files.atomic import whole_file
from prooflight.pages.job import files_in
from prooflight.pages.tiff_images import TIFF_SUFFIXES, decode_into, image_count, opened_tiff
from prooflight.scans.lines import BLOCK_LINES, LineBlock
from prooflight.scans.pacing import Pacer

_REMEDY = "scan the page again"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedScan:
    """Location of one page's stored scan, which is read later."""

    path: Path
    first_image: int
    """Index of its first sensor's image in the file."""
    sensors: int

    @property
    def name(self) -> str:
        """The file's stem, which names the page in a folder of scans."""
        return self.path.stem

    def read(self, *, pixels: int | None = None, lines_max: int | None = None) -> NDArray[np.uint16]:
        """Read the scan, (sensors, lines, pixels) [DN]; ScanError if it is truncated or in another form.

        pixels, lines_max: of a line, and at most of the scan, where the press is known; other scans are not
        decoded at all.
        """
        with opened_tiff(self.path, ScanError, remedy=_REMEDY) as file:
            images = [file[self.first_image + sensor] for sensor in range(self.sensors)]
            shapes = {(str(image.dtype), image.shape) for image in images}
            if len(shapes) > 1 or images[0].dtype != np.uint16 or len(images[0].shape) != 2:
                what = f"holds images of {' and '.join(f'{name} {shape}' for name, shape in sorted(shapes))}"
                remedy = "give raw digital numbers, one uint16 (lines, pixels) image for each sensor"
                raise ScanError(self.path, what, remedy=remedy)
            lines, wide = images[0].shape
            if (pixels or wide) != wide or lines > (lines_max or lines):
                what = f"is of {self.sensors} sensors x {lines} lines x {wide} pixels"
                limit = "" if lines_max is None else f", at most {lines_max} lines for this page"
                raise ScanError(self.path, what, remedy=f"the press has {pixels or wide} pixels{limit}")
            for image in images:
                file.check(self.path, image, result_bytes=2.0 * self.sensors * lines * wide)
            dn = np.empty((self.sensors, lines, wide), np.uint16)
            for image, out in zip(images, dn, strict=True):
                decode_into(image, out[..., None])
        return dn


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
    """Return scans in page order: a folder's TIFF files in natural order of their names, or one multi-page file.

    A file holds one image for each of ``sensors`` sensors, page after page. damaged: whether a file of a
    folder whose images cannot be counted is one scan, whose error is raised when it is read. ScanError if
    there is nothing to read, or else.
    """
    if path.is_dir():
        files = files_in(path, TIFF_SUFFIXES)
        if not files:
            what = "holds no TIFF files"
            raise ScanError(path, what, remedy="give the folder that `prooflight simulate` wrote")
        return [scan for file in files for scan in _scans_of(file, sensors, damaged=damaged)]
    if not path.is_file():
        what = "there is no such file or folder"
        raise ScanError(path, what, remedy="give a folder of scans or a TIFF file")
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
        """Play scans at a rate; line_rate_hz: None: as fast as lines are taken."""
        self.sensors, self.pixels = sensors, pixels
        self._scans, self._block_lines, self._closed = scans, block_lines, False
        self._pacer = pacer or Pacer(line_rate_hz)

    def blocks(self) -> Iterator[LineBlock]:
        """Yield all lines of all scans. ScanError: one is damaged or of another camera."""
        first = 0
        for scan in self._scans:
            lines = scan.read(pixels=self.pixels)
            for start in range(0, lines.shape[1], self._block_lines):
                block = lines[:, start : start + self._block_lines]
                time_s = self._pacer.read(block.shape[1])
                if self._closed:
                    return
                yield LineBlock(first_line=first, lines=block, time_s=time_s)
                first += block.shape[1]

    def close(self) -> None:
        """Stop playing."""
        self._closed = True
        self._pacer.stop()


def _scans_of(path: Path, sensors: int, *, damaged: bool = False) -> list[RecordedScan]:
    try:
        count = image_count(path, ScanError, remedy=_REMEDY)
    except ScanError:
        if damaged:
            return [RecordedScan(path=path, first_image=0, sensors=sensors)]
        raise
    if not count or count % sensors:
        what = f"holds {count} images where the press has {sensors} sensors"
        raise ScanError(path, what, remedy="give one image for each sensor of each page")
    return [RecordedScan(path=path, first_image=first, sensors=sensors) for first in range(0, count, sensors)]
