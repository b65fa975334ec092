"""Reading of scans as people have them: pages of PDF, TIFF, JPEG and PNG files, one scan a page, as linear light.

What bounds files of jobs bounds these as well: PDFs are opened in the process that rips (``pages.pdf.process``),
pictures by ``scans.pictures``.

A scanner stores numbers for the eye or for a screen. The curve is that of the file's ICC profile where it has one,
else sRGB's (IEC 61966-2-1), unless the user states another. Clipped numbers are marked.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms

from prooflight.errors import JobError, RequestError, ScanError
from prooflight.pages.files import DPI_MAX
from prooflight.pages.job import files_in
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.tiff_images import TIFF_SUFFIXES
from prooflight.scans.pictures import SUFFIXES, PictureFile, picture_files
from prooflight.spectra import srgb_light

LEAST_GAMMA, MOST_GAMMA = 0.2, 5.0
BAND_ROWS: Final = 256
"""Rows that are converted at a time."""
EIGHT_BITS: Final = 255
_REMEDY: Final = "give srgb, linear or a gamma such as 2.2, and where needed black and white, as 2.2:3:98"


@dataclass(frozen=True, slots=True, kw_only=True)
class Tone:
    """Curve from a file's numbers to light, as a user states it."""

    gamma: float | None = None
    """Exponent of the curve; None: sRGB's curve. [-]"""
    black: float = 0.0
    """Number that stands for no light, as a share of the greatest. [-]"""
    white: float = 1.0
    """Number that stands for full light, likewise; what is at it or above is clipped. [-]"""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``srgb``, ``linear`` or a gamma, then optionally ``:BLACK:WHITE`` in per cent of the greatest number.

        RequestError: the text is nothing of the kind.
        """
        curve, *points = text.strip().lower().split(":")
        try:
            black, white = (float(point) / 100 for point in points) if points else (0.0, 1.0)
            gamma = {"srgb": None, "linear": 1.0}[curve] if curve in ("srgb", "linear") else float(curve)
        except ValueError:
            raise RequestError("--tone", f"there is no tone {text!r}", remedy=_REMEDY) from None
        if gamma is not None and not LEAST_GAMMA <= gamma <= MOST_GAMMA:
            remedy = f"give a gamma of {LEAST_GAMMA} to {MOST_GAMMA}, srgb or linear"
            raise RequestError("--tone", f"{curve} is not a gamma of a scan", remedy=remedy)
        if not (0 <= black < white <= 1 and math.isfinite(white)):
            raise RequestError("--tone", f"{text!r} has no black below its white", remedy=_REMEDY)
        return cls(gamma=gamma, black=black, white=white)

    def light(self, numbers: NDArray[np.float32], full: float) -> NDArray[np.float32]:
        """Return the light of a file's numbers up to ``full``, 0 to 1 of its white point, as a new array."""
        shares = (numbers / np.float32(full) - np.float32(self.black)) / np.float32(self.white - self.black)
        shares = np.clip(shares, 0, 1, dtype=np.float32)
        if self.gamma is None:
            return srgb_light(shares)
        return shares if self.gamma == 1 else np.power(shares, np.float32(self.gamma))

    def clipped(self, numbers: NDArray[np.float32], full: float) -> NDArray[np.bool_]:
        """Return which samples are at the greatest number or at the white point: of their light the least is known."""
        return np.asarray(numbers >= np.float32(full * self.white))


SRGB: Final = Tone()


def by_profile(
    where: object, numbers: NDArray[np.float32], full: float, profile: bytes
) -> NDArray[np.float32]:
    """Return the light of a file's numbers (channels, lines, pixels) by its ICC profile, 0 to 1 of sRGB's white.

    The profile is applied to 8 bits. ScanError: it is broken, or of other colours than the file.
    """
    grey = len(numbers) == 1
    remedy = "save the scan without its profile, or state its curve by --tone srgb"
    try:
        source = ImageCms.getOpenProfile(io.BytesIO(profile))
        space = source.profile.xcolor_space.strip()
        if space != ("GRAY" if grey else "RGB"):
            what = f"its ICC profile is of {space}, the scan is {'grey' if grey else 'RGB'}"
            raise ScanError(where, what, remedy=remedy)
        link = ImageCms.buildTransform(source, ImageCms.createProfile("sRGB"), "L" if grey else "RGB", "RGB")
        light = np.empty_like(numbers)
        for top in range(0, numbers.shape[1], BAND_ROWS):
            band = numbers[:, top : top + BAND_ROWS]
            eight = np.rint(band * np.float32(EIGHT_BITS / full)).clip(0, EIGHT_BITS).astype(np.uint8)
            seen = Image.fromarray(eight[0] if grey else np.ascontiguousarray(np.moveaxis(eight, 0, -1)))
            srgb = ImageCms.applyTransform(seen, link)
            assert srgb is not None
            samples = np.moveaxis(np.asarray(srgb), -1, 0)[: len(numbers)]
            light[:, top : top + BAND_ROWS] = srgb_light(samples.astype(np.float32) / np.float32(EIGHT_BITS))
    except (ImageCms.PyCMSError, OSError) as error:
        raise ScanError(where, f"its ICC profile cannot be used ({error})", remedy=remedy) from None
    return light


PDF: Final = ".pdf"
REMEDY: Final = "give scans as PDF, TIFF, JPEG or PNG, grey or RGB"
LEAST_DPI: Final = 72.0
"""Least resolution of a scan: below it no letter can be told from another."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScannedPicture:
    """One scanned page in linear light."""

    name: str
    """Name of its file and its place there, for people."""
    light: NDArray[np.float32]
    """Light, 0 to 1 of the file's white point, (1 or 3 channels, lines, pixels)."""
    clipped: NDArray[np.bool_]
    """Samples at the file's greatest number, of whose light only the least is known, of the same shape."""
    dpi: tuple[float, float]
    """Resolution across and along. [pixels/inch]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScannerSettings:
    """A user's statements about scans that their files do not make."""

    tone: Tone | None = None
    """Curve of the scans; None: their ICC profile's, or sRGB's."""
    dpi: float | None = None
    """Resolution of scans whose file states none; None: such scans are refused. [pixels/inch]"""

    def __post_init__(self) -> None:
        if self.dpi is not None and not LEAST_DPI <= self.dpi <= DPI_MAX:
            remedy = f"give {LEAST_DPI:g} to {DPI_MAX:g} pixels per inch"
            raise RequestError("--scan-dpi", f"{self.dpi:g} is not a resolution of a scan", remedy=remedy)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScannedPage:
    """Location of one scanned page, which is read later."""

    path: Path
    number: int
    """Place in its file, from 1."""
    pages: int
    """Number of pages in its file."""

    @property
    def name(self) -> str:
        """Return the file's name, with the page's place in it where there are several."""
        return self.path.name if self.pages == 1 else f"{self.path.name}, page {self.number}"

    def read(self, settings: ScannerSettings) -> ScannedPicture:
        """Read the page; ScanError: it is damaged, neither grey nor RGB, or nothing states its resolution."""
        if self.path.suffix.lower() == PDF:
            return self._read_pdf(settings)
        picture = PictureFile(path=self.path, first_image=self.number - 1, images=1).read()
        numbers, full = picture.light, picture.full
        tone = settings.tone or SRGB
        if settings.tone is None and picture.profile is not None:
            light = by_profile(self.path, numbers, full, picture.profile)
        else:
            light = tone.light(numbers, full)
        dpi = picture.dpi or (None if settings.dpi is None else (settings.dpi, settings.dpi))
        if dpi is None:
            remedy = "state it by --scan-dpi, as --scan-dpi 300"
            raise ScanError(self.path, "states no resolution", remedy=remedy)
        return self._checked(light, tone.clipped(numbers, full), dpi)

    def _read_pdf(self, settings: ScannerSettings) -> ScannedPicture:
        try:
            with PdfJob(self.path) as pdf:
                samples, dpi = pdf.picture(self.number)
        except JobError as error:
            raise ScanError(error.where, error.what, remedy=error.remedy) from None
        numbers, tone = np.moveaxis(samples, -1, 0).astype(np.float32), settings.tone or SRGB
        return self._checked(tone.light(numbers, 255.0), tone.clipped(numbers, 255.0), dpi)

    def _checked(
        self, light: NDArray[np.float32], clipped: NDArray[np.bool_], dpi: tuple[float, float]
    ) -> ScannedPicture:
        if len(light) not in (1, 3):
            raise ScanError(self.path, f"has {len(light)} channels", remedy=REMEDY)
        if not all(LEAST_DPI <= one <= DPI_MAX for one in dpi):
            what = f"states a resolution of {dpi[0]:.4g} x {dpi[1]:.4g} dpi"
            raise ScanError(self.path, what, remedy=f"scan at {LEAST_DPI:g} dpi or more")
        return ScannedPicture(name=self.name, light=light, clipped=clipped, dpi=dpi)


def scanned_pages(path: Path) -> list[ScannedPage]:
    """Return all scanned pages of a file, or of a folder's files in natural order of their names.

    ScanError: there is nothing to read, or a file cannot be opened.
    """
    if not path.is_dir():
        return _pages_of(path)
    inside = files_in(path, (PDF, *SUFFIXES))
    if not inside:
        raise ScanError(path, "holds no scans", remedy=REMEDY)
    return [page for file in inside for page in _pages_of(file)]


def _pages_of(path: Path) -> list[ScannedPage]:
    suffix = path.suffix.lower()
    if not path.is_file():
        raise ScanError(path, "there is no such file or folder", remedy="give a scan or a folder of scans")
    if suffix not in (PDF, *SUFFIXES):
        raise ScanError(path, "is not a scan in a supported format", remedy=REMEDY)
    count = 1
    if suffix == PDF:
        try:
            with PdfJob(path) as pdf:
                count = len(pdf)
        except JobError as error:
            raise ScanError(error.where, error.what, remedy=error.remedy) from None
    elif suffix in TIFF_SUFFIXES:
        count = len(picture_files(path, images=1))
    return [ScannedPage(path=path, number=number, pages=count) for number in range(1, count + 1)]
