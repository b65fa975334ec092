"""Damaged jobs, scans and pictures: sound files that the project writes itself, ways to spoil them, and their readers.

Every function is plain, so that a harness of any kind can call it: ``samples`` gives a sound file of each kind,
``mutated`` spoils one, ``read`` reads it as the program does. A reader must refuse with an InputError, or accept.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import TYPE_CHECKING, Final

import numpy as np
import pymupdf
import tifffile
from PIL import Image
from tests.stand_ins import write_jpeg

from prooflight.commissioning.chart.scan import read_chart_scan
from prooflight.pages.files import write_tiff
from prooflight.pages.job import JobSource
from prooflight.pages.raster import Page
from prooflight.scans.pictures import picture_files
from prooflight.scans.recorded import recorded_scans, write_scan
from prooflight.scans.scanner.reading import ScannerSettings, scanned_pages

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Mutation = Callable[[bytes, np.random.Generator], bytes]

EXTREMES: Final = (0, 1, 2, 3, 8, 127, 255, 256, 32767, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
SENSORS: Final = 2
KINDS: Final = (
    *("job.tif", "tiles-job.tif", "jpeg-job.tif", "big-job.tif", "job.jpg", "job.pdf", "scan.tif"),
    *("picture.tif", "picture.png", "picture.jpg", "chart.tif", "chart.png", "chart.jpg"),
    *("scanned.tif", "scanned.png", "scanned.jpg", "scanned.pdf"),
)
"""Names of ``samples``: what reads them, and their suffix."""


def samples(folder: Path) -> dict[str, bytes]:
    """A sound file of each kind, by kind; ``folder``: to write in meanwhile."""
    rng = np.random.default_rng(1)
    page = Page(cmyk=rng.integers(0, 255, (40, 30, 4), np.uint8), dpi=200.0, name="p0001", number=1)
    grey, wide = rng.integers(0, 255, (40, 30), np.uint8), rng.integers(0, 65535, (40, 30), np.uint16)
    rgb = rng.integers(0, 255, (40, 30, 3), np.uint8)
    path = folder / "sample"
    write_tiff(page, path)
    made = {"job.tif": path.read_bytes()}
    write_jpeg(page, path)
    made["job.jpg"] = path.read_bytes()
    write_scan(path, np.stack([wide] * SENSORS), facts={"page": "p0001"})
    made["scan.tif"] = path.read_bytes()
    cmyk = {"photometric": "separated", "resolution": (200, 200), "metadata": None}
    made["tiles-job.tif"] = _tiff(page.cmyk.astype(np.uint16) * 257, tile=(16, 16), compression="lzw", **cmyk)
    made["jpeg-job.tif"] = _tiff(page.cmyk, compression="jpeg", rowsperstrip=16, **cmyk)
    made["big-job.tif"] = _tiff(page.cmyk, compression="zstd", predictor=True, bigtiff=True, **cmyk)
    made["picture.tif"] = _tiff(rgb, photometric="rgb", compression="zlib", resolution=(300, 300))
    made["picture.png"] = _pillow(Image.fromarray(wide), "PNG")
    made["picture.jpg"] = _pillow(Image.fromarray(rgb), "JPEG")
    made["chart.tif"] = _tiff(np.stack([wide] * 3), photometric="minisblack", metadata=None)
    made["chart.png"] = _pillow(Image.fromarray(rgb), "PNG")
    made["chart.jpg"] = _pillow(Image.fromarray(grey), "JPEG")
    made["job.pdf"] = _pdf(rgb)
    made["scanned.tif"] = _tiff(wide, photometric="minisblack", resolution=(300, 300))
    made["scanned.png"] = _pillow(Image.fromarray(rgb), "PNG")
    made["scanned.jpg"] = _pillow(Image.fromarray(grey), "JPEG")
    made["scanned.pdf"] = _scanned_pdf(grey)
    return made


def read(kind: str, path: Path) -> None:
    """Read a file as the program reads one of this kind; InputError: it is refused."""
    thing = kind.split(".")[0].split("-")[-1]
    if thing == "job":
        with JobSource(path=path, dpi=100.0).open() as job:
            assert len(job.page_sizes_mm) == len(job)
            for number in range(1, min(len(job), 3) + 1):
                assert job.page(number).cmyk.size
    elif thing == "scan":
        for scan in recorded_scans(path, sensors=SENSORS)[:3]:
            assert scan.read().ndim == 3
    elif thing == "scanned":
        for page in scanned_pages(path)[:3]:
            assert np.isfinite(page.read(ScannerSettings(dpi=300.0)).light).all()
    elif thing == "picture":
        for picture in picture_files(path)[:3]:
            assert np.isfinite(picture.read().light).all()
    else:
        assert read_chart_scan(path).dn.ndim == 3


def mutated(kind: str, data: bytes, rng: np.random.Generator) -> bytes:
    """A spoiled copy of a file: of what every file has, or of what its kind has."""
    suffix = kind.rpartition(".")[2]
    ways = (*ANY, *OF_KIND[suffix] * 2)  # twice, because they reach deeper
    for _ in range(int(rng.integers(1, 4))):
        data = ways[rng.integers(len(ways))](data, rng)
    return data


def flipped(data: bytes, rng: np.random.Generator) -> bytes:
    """Up to eight bits turned over."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 9)) if out else 0):
        out[rng.integers(len(out))] ^= 1 << int(rng.integers(8))
    return bytes(out)


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    """The file's end missing, or a part of it."""
    start = int(rng.integers(len(data) + 1))
    end = len(data) if rng.random() < 0.5 else min(len(data), start + int(rng.integers(1, 64)))
    return data[:start] + data[end:]


def extreme(data: bytes, rng: np.random.Generator) -> bytes:
    """A number of two or four bytes, wherever, as large or small as numbers get."""
    form = "<>"[rng.integers(2)] + "HI"[rng.integers(2)]
    size = struct.calcsize(form)
    if len(data) <= size:
        return data
    out = bytearray(data)
    value = EXTREMES[rng.integers(len(EXTREMES))] % 256**size
    struct.pack_into(form, out, int(rng.integers(len(out) - size)), value)
    return bytes(out)


def repeated(data: bytes, rng: np.random.Generator) -> bytes:
    """A part of the file copied over another, or put in between."""
    if len(data) < 16:
        return data
    start, place = (int(rng.integers(len(data) - 8)) for _ in range(2))
    part = data[start : start + int(rng.integers(1, 200))]
    return data[:place] + part + data[place + len(part) * int(rng.integers(2)) :]


def tiff_entry(data: bytes, rng: np.random.Generator) -> bytes:
    """One field of one tag changed: its code, type, count, or the value or place it gives."""
    form, places = _tiff_entries(data)
    if not places:
        return data
    place = places[rng.integers(len(places))]
    code, count, size = ("H", "Q", 20) if form[1] == "Q" else ("H", "I", 12)
    out = bytearray(data)
    field = int(rng.integers(4))
    if field < 2:
        struct.pack_into(
            form[0] + code, out, place + 2 * field, int(rng.integers(0, 350 if field == 0 else 20))
        )
    else:
        near = int(rng.integers(len(data) + 64))
        value = near if rng.random() < 0.5 else EXTREMES[rng.integers(len(EXTREMES))]
        struct.pack_into(
            form[0] + count, out, place + (4 if field == 2 else size - struct.calcsize(count)), value
        )
    return bytes(out)


def tiff_link(data: bytes, rng: np.random.Generator) -> bytes:
    """A directory that leads to itself, to another one, or to any place."""
    form, places = _tiff_entries(data)
    if not places:
        return data
    step = 20 if form[1] == "Q" else 12
    head = 8 if form[1] == "Q" else 2
    ends = [place + step for place in places if place + step not in places]
    starts = [place - head for place in places if place - step not in places]
    end = ends[rng.integers(len(ends))]
    target = starts[rng.integers(len(starts))] if rng.random() < 0.7 else int(rng.integers(len(data)))
    out = bytearray(data)
    if end + struct.calcsize(form) <= len(out):
        struct.pack_into(form, out, end, max(target, 0))
    return bytes(out)


def png_header(data: bytes, rng: np.random.Generator) -> bytes:
    """Another size, depth or colour type in a header whose checksum is right."""
    if len(data) < 33:
        return data
    head = bytearray(data[12:29])
    place, form = ((4, ">I"), (8, ">I"), (12, "B"), (13, "B"), (16, "B"))[rng.integers(5)]
    struct.pack_into(form, head, place, EXTREMES[rng.integers(len(EXTREMES))] % 256 ** struct.calcsize(form))
    return data[:12] + bytes(head) + struct.pack(">I", zlib.crc32(head)) + data[33:]


def jpeg_frame(data: bytes, rng: np.random.Generator) -> bytes:
    """Another kind of frame, size, depth or number of components."""
    at = next(
        (data.find(bytes([0xFF, marker])) for marker in (0xC0, 0xC1, 0xC2) if bytes([0xFF, marker]) in data),
        -1,
    )
    if not 0 <= at < len(data) - 10:
        return data
    place, form = ((1, "B"), (4, "B"), (5, ">H"), (7, ">H"), (9, "B"))[rng.integers(5)]
    out = bytearray(data)
    value = int(rng.integers(0xC0, 0xD0)) if place == 1 else EXTREMES[rng.integers(len(EXTREMES))]
    struct.pack_into(form, out, at + place, value % 256 ** struct.calcsize(form))
    return bytes(out)


def pdf_number(data: bytes, rng: np.random.Generator) -> bytes:
    """A number, wherever, changed for another: sizes, references, counts, operands."""
    return _pdf_replaced(
        data, rng, b"0123456789.-", (*(b"%d" % n for n in EXTREMES), b"-1", b"1e30", b"0.5", b"--")
    )


def pdf_word(data: bytes, rng: np.random.Generator) -> bytes:
    """A name or keyword changed for another of the file, or for one that is none."""
    letters = bytes(range(65, 91)) + bytes(range(97, 123))
    words = (
        b"Page",
        b"Pages",
        b"obj",
        b"endobj",
        b"stream",
        b"XObject",
        b"Do",
        b"q",
        b"Kids",
        b"F\xe4rbe",
        b"",
    )
    return _pdf_replaced(data, rng, letters, words)


ANY: Final[tuple[Mutation, ...]] = (flipped, cut, extreme, repeated)
OF_KIND: Final[dict[str, tuple[Mutation, ...]]] = {
    "tif": (tiff_entry, tiff_entry, tiff_link),
    "png": (png_header,),
    "jpg": (jpeg_frame,),
    "pdf": (pdf_number, pdf_number, pdf_word),
}


def _tiff(image: np.ndarray, **options: object) -> bytes:
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, image, **options)
    return buffer.getvalue()


def _pillow(image: Image.Image, form: str) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, form, dpi=(300, 300))
    return buffer.getvalue()


def _scanned_pdf(grey: np.ndarray) -> bytes:
    """One page that is a picture, as scanners write it."""
    document, stream = pymupdf.open(), io.BytesIO()
    Image.fromarray(grey).save(stream, "PNG")
    page = document.new_page(width=72 * grey.shape[1] / 300, height=72 * grey.shape[0] / 300)
    page.insert_image(page.rect, stream=stream.getvalue())
    return bytes(document.tobytes())


def _pdf(rgb: np.ndarray) -> bytes:
    """Two pages with a form, a pattern, an image, a gradient and a spot colour."""
    image = zlib.compress(rgb.tobytes())
    blend = "<</FunctionType 2/Domain[0 1]/C0[{}]/C1[{}]/N 1>>"
    spot = f"[/Separation/Gold[/Lab<</WhitePoint[0.96 1 0.82]>>]{blend.format('100 0 0', '60 9 60')}]"
    axial = "<</ShadingType 2/ColorSpace/DeviceCMYK/Coords[0 0 90 0]/Function"
    shading = f"{axial}{blend.format('0 1 0 0', '1 0 0 0')}>>"
    drawn = "<</XObject<</I 7 0 R/F 8 0 R>>/Pattern<</P 9 0 R>>"
    resources = f"{drawn}/ColorSpace<</S {spot}>>/Shading<</H {shading}>>>>"
    content = (
        b"q 50 0 0 50 0 0 cm /I Do Q /F Do /Pattern cs /P scn 50 50 50 50 re f "
        b"/S cs 0.5 scn 0 50 20 20 re f /H sh"
    )
    objects = [
        b"<</Type/Catalog/Pages 2 0 R>>",
        b"<</Type/Pages/Kids[3 0 R 4 0 R]/Count 2/MediaBox[0 0 100 100]>>",
        b"<</Type/Page/Parent 2 0 R/Contents 6 0 R/Resources 5 0 R>>",
        b"<</Type/Page/Parent 2 0 R/Contents 6 0 R/Resources 5 0 R/Rotate 90/CropBox[10 10 90 90]>>",
        resources.encode(),
        _stream(content),
        _stream(
            image,
            f"/Subtype/Image/Width {rgb.shape[1]}/Height {rgb.shape[0]}/ColorSpace/DeviceRGB/BitsPerComponent 8"
            "/Filter/FlateDecode",
        ),
        _stream(b"0 1 0 0 k 30 30 10 10 re f", "/Subtype/Form/BBox[0 0 100 100]"),
        _stream(
            b"1 0 0 0 k 0 0 5 5 re f",
            "/PatternType 1/PaintType 1/TilingType 1/BBox[0 0 10 10]/XStep 10/YStep 10/Resources<<>>",
        ),
    ]
    out, places = bytearray(b"%PDF-1.7\n"), []
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n" % number + body + b"\nendobj\n"
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % place for place in places)
    return bytes(out) + b"trailer<</Size %d/Root 1 0 R>>\nstartxref\n%d\n%%%%EOF\n" % (
        len(objects) + 1,
        start,
    )


def _stream(data: bytes, entries: str = "") -> bytes:
    return f"<<{entries}/Length {len(data)}>>stream\n".encode() + data + b"\nendstream"


def _tiff_entries(data: bytes) -> tuple[str, list[int]]:
    """Format of a TIFF's offsets, and where each tag of each directory lies."""
    order = {b"II": "<", b"MM": ">"}.get(data[:2], "")
    if not order or len(data) < 16:
        return "<I", []
    big = data[2:4] in (b"+\0", b"\0+")
    form, head, step = (order + "Q", order + "Q", 20) if big else (order + "I", order + "H", 12)
    (at,) = struct.unpack_from(form, data, 8 if big else 4)
    places: list[int] = []
    seen = set()
    while 0 < at < len(data) - 8 and at not in seen and len(seen) < 8:
        seen.add(at)
        (count,) = struct.unpack_from(head, data, at)
        first = at + struct.calcsize(head)
        inside = [first + step * n for n in range(min(count, 64)) if first + step * (n + 1) + 8 <= len(data)]
        places += inside
        at = struct.unpack_from(form, data, inside[-1] + step)[0] if inside else 0
    return form, places


def _pdf_replaced(data: bytes, rng: np.random.Generator, letters: bytes, words: tuple[bytes, ...]) -> bytes:
    """A run of ``letters`` near a place that is drawn, replaced by one of ``words``."""
    at = int(rng.integers(max(len(data), 1)))
    while at < len(data) and data[at] not in letters:
        at += 1
    end = at
    while end < len(data) and data[end] in letters:
        end += 1
    return data[:at] + words[rng.integers(len(words))] + data[end:]
