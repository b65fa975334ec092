"""Pages drawn by another engine than MuPDF: within the same limits, of the same size, and checked on a page of ours."""

from __future__ import annotations

import re
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from tests.stand_ins import cmyk_profile

from prooflight.errors import JobError
from prooflight.pages.job import JobSource
from prooflight.pages.pdf import process as rip_process
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.engine_check import PATCHES, differences, sentence
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.pdf.rip_model import FillRule, RipModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    WritePdf = Callable[..., Path]

NAMED = ("{pdf}", "{page}", "{dpi}", "{out}")
GHOSTSCRIPT = RipEngine(name="ghostscript")
needs_ghostscript = pytest.mark.skipif(shutil.which("gs") is None, reason="Ghostscript is not installed")
SHAPES = "0 0 0 1 k 30 40 33.3 25.7 re f 1 0 0 0 k 60 80 20 15 re f"
TRIM = "/MediaBox[0 0 150 150]/TrimBox[10.3 9.6 120.7 131.9]"
FRONT_END = """
import sys, time
import numpy as np, tifffile
from prooflight.errors import JobError
from prooflight.pages.files import write_tiff
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.pdf.rip_model import FillRule, RipModel
from pathlib import Path
from dataclasses import replace
pdf, number, dpi, out = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), Path(sys.argv[4])
with PdfJob(pdf) as job:
    page = job.page(number, dpi)
"""


def draws(tmp_path: Path, then: str = "write_tiff(page, out)", first: str = "") -> RipEngine:
    """A front end that draws as MuPDF does, and then writes what it is told to write."""
    path = tmp_path / "front-end.py"
    path.write_text(first + FRONT_END + then + "\n")
    return RipEngine(name="command", command=(sys.executable, str(path), *NAMED))


def quick(tmp_path: Path, text: str) -> RipEngine:
    """A front end of a few lines that draws nothing."""
    path = tmp_path / "front-end.sh"
    path.write_text(text)
    return RipEngine(name="command", command=("sh", str(path), *NAMED))


def rip(path: Path, engine: RipEngine | None = None, dpi: float = 72, **how: Any) -> NDArray[np.uint8]:
    profile = how.pop("profile", None)
    with PdfJob(path, engine=engine, profile=profile) as job:
        return job.page(1, dpi, **how).cmyk


@pytest.mark.parametrize(
    ("name", "command", "said"),
    [
        ("mupdf", ("rip", *NAMED), 'goes with engine = "command"'),
        ("command", (), 'goes with engine = "command"'),
        ("command", ("rip", "{pdf}", "{page}", "{out}"), "must contain {dpi}"),
        ("command", ("rip", *NAMED, "{size}"), "names {size}"),
        ("command", ("", *NAMED), "must be a program"),
        ("command", ("rip", "a\0b", *NAMED), "zero byte"),
        ("harlequin", (), "engine must be mupdf, ghostscript, command"),
    ],
)
def test_an_engine_that_cannot_be_meant_is_refused(name: Any, command: tuple[str, ...], said: str) -> None:
    with pytest.raises(ValueError, match=said.replace("{", r"\{").replace("}", r"\}")):
        RipEngine(name=name, command=command)


def test_a_command_is_filled_without_a_shell() -> None:
    engine = RipEngine(name="command", command=("rip", "--in={pdf}", "-p{page}", "{dpi}", "{out}", "$(x)"))
    values = {"pdf": "a b;{page}.pdf", "page": "3", "dpi": "600", "out": "o.tif"}
    assert engine.filled(values) == ["rip", "--in=a b;{page}.pdf", "-p3", "600", "o.tif", "$(x)"]


def test_a_front_end_that_draws_as_mupdf_gives_its_pages(tmp_path: Path, write_pdf: WritePdf) -> None:
    job = write_pdf(SHAPES, page=TRIM)
    for how in ({}, {"drawn_dpi": 250.0}):
        np.testing.assert_array_equal(rip(job, draws(tmp_path), 100, **how), rip(job, None, 100, **how))


def test_a_job_of_a_press_is_drawn_by_its_engine(tmp_path: Path, write_pdf: WritePdf) -> None:
    inverted = draws(tmp_path, "write_tiff(replace(page, cmyk=255 - page.cmyk), out)")
    source = JobSource(path=write_pdf("0 0 0 1 k 0 0 100 100 re f"), dpi=72, drawn_dpi=144, engine=inverted)
    with source.open() as job:
        assert (job.page(1).cmyk[50, 50] == [255, 255, 255, 0]).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("echo the licence has ended; exit 7", "sh ends with exit code 7: the licence has ended"),
        ("true", r"sh writes no file \{out\}"),
        ("echo no TIFF > $4", "what sh writes cannot be used: neither TIFF nor JPEG"),
        ("kill -9 $$", "sh was ended by SIGKILL"),
    ],
)
def test_a_front_end_that_fails_costs_its_page(
    tmp_path: Path, write_pdf: WritePdf, text: str, said: str
) -> None:
    with pytest.raises(JobError, match=f"page 1: {said}"):
        rip(write_pdf(SHAPES), quick(tmp_path, text))


@pytest.mark.parametrize(
    ("then", "said"),
    [
        ("write_tiff(replace(page, dpi=dpi / 2), out)", "writes 36 dpi where 72 was requested"),
        (
            "write_tiff(replace(page, cmyk=page.cmyk[:-3]), out)",
            "writes 100 x 97 pixels where what is printed of the page has 100 x 100",
        ),
        ("tifffile.imwrite(out, page.cmyk[..., 0], resolution=(72, 72))", "not CMYK"),
    ],
)
def test_what_is_no_page_of_the_job_is_refused(
    tmp_path: Path, write_pdf: WritePdf, then: str, said: str
) -> None:
    with pytest.raises(JobError, match=said):
        rip(write_pdf(SHAPES), draws(tmp_path, then))


def test_a_page_rounded_otherwise_is_cut_or_continued(tmp_path: Path, write_pdf: WritePdf) -> None:
    job = write_pdf("0 0 0 1 k 0 0 100 100 re f")
    other = "write_tiff(replace(page, cmyk=np.pad(page.cmyk[:-1], ((0, 0), (0, 1), (0, 0)))), out)"
    cmyk = rip(job, draws(tmp_path, other))
    assert cmyk.shape == (100, 100, 4)
    assert (cmyk[..., 3] == 255).all()


def test_a_front_end_that_takes_too_long_is_ended(
    tmp_path: Path, write_pdf: WritePdf, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(rip_process.SECONDS, "1")
    lives = tmp_path / "lives"
    engine = quick(tmp_path, f"while true; do date > {lives}; sleep 0.2; done")
    with pytest.raises(JobError, match="page 1 takes longer than 1 s"):
        rip(write_pdf(SHAPES), engine)
    time.sleep(0.5)  # what was about to be written is written
    lives.unlink(missing_ok=True)
    time.sleep(0.5)
    assert not lives.exists()


def test_a_front_end_is_held_to_the_memory_of_a_page(tmp_path: Path, write_pdf: WritePdf) -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("only Linux limits address space")
    with pytest.raises(JobError, match="takes more than 2 GB of memory"):
        rip(write_pdf(SHAPES), draws(tmp_path, first="bytearray(4_000_000_000)\n"))


def test_a_front_end_cannot_fill_the_disk(tmp_path: Path, write_pdf: WritePdf) -> None:
    with pytest.raises(JobError, match=r"page 1: sh (was ended|ends)"):
        rip(write_pdf(SHAPES), quick(tmp_path, "head -c 100000000 /dev/zero > $4"))


def test_nothing_stays_of_what_was_drawn(tmp_path: Path, write_pdf: WritePdf) -> None:
    job = write_pdf(SHAPES)
    rip(job, draws(tmp_path))
    folder = Path(rip_process._running[0].folder)
    assert not list(folder.iterdir())
    rip_process._running[0].end()
    assert not folder.exists()


def test_an_engine_that_is_not_there_is_said_before_any_work(write_pdf: WritePdf) -> None:
    engine = RipEngine(name="command", command=("no-such-front-end", *NAMED))
    with pytest.raises(JobError, match="there is no program no-such-front-end"):
        PdfJob(write_pdf(SHAPES), engine=engine)


def test_what_a_front_end_prints_is_a_warning(tmp_path: Path, write_pdf: WritePdf) -> None:
    engine = draws(tmp_path, "print('toner is low'); write_tiff(page, out)")
    with PdfJob(write_pdf(SHAPES), engine=engine) as job:
        page = job.page(1, 72)
    assert [(one.page, one.kind) for one in page.warnings] == [(0, "rip-message")]
    assert "toner is low" in page.warnings[0].message


def test_mupdf_draws_the_test_page_as_specified() -> None:
    for dpi in (300, 483.7):
        assert differences(RipEngine(), dpi) == ()
    assert sentence(RipEngine(), 300, ()).endswith("as the PDF specification requires")


@pytest.mark.parametrize(
    ("then", "said"),
    [
        (
            "page.cmyk[..., 0] //= 2; write_tiff(page, out)",
            "cyan prints as 127 0 0 0, and should print as 255 0 0 0",
        ),
        (
            "page = replace(page, cmyk=np.roll(page.cmyk, 5, axis=1)); write_tiff(page, out)",
            r"the left edge of its square is \+[45].[0-9] pixels off",
        ),
        ("raise SystemExit(2)", "ends with exit code 2"),
        (
            "import cv2; page = replace(page, cmyk=cv2.blur(page.cmyk, (3, 3))); write_tiff(page, out)",
            "edges are anti-aliased",
        ),
    ],
)
def test_what_differs_on_the_test_page_is_said(tmp_path: Path, then: str, said: str) -> None:
    engine = draws(tmp_path, then)
    found = differences(engine, 200)
    assert any(re.search(said, one) for one in found)
    assert sentence(engine, 200, found).count("\n") == 0


@needs_ghostscript
def test_ghostscript_draws_all_of_the_test_page_but_one_patch() -> None:
    """It paints Separation All on the plates of spot colours, too, and merges these: ISO 32000-2, 8.6.6.4."""
    found = differences(GHOSTSCRIPT, 300)
    assert len(found) == 1
    assert found[0].startswith("Separation All prints as")
    assert len(PATCHES) > 10


@needs_ghostscript
@pytest.mark.parametrize(
    "page",
    [
        TRIM,
        TRIM.replace("TrimBox", "CropBox"),
        TRIM + "/Rotate 90",
        TRIM + "/Rotate 180",
        TRIM + "/UserUnit 1.5",
        "/MediaBox[-10 -20 150.4 130.2]/Rotate 270",
        "/MediaBox[0 0 100 100]/TrimBox[-20 -30 90 95]",
        "/MediaBox[0 0 100 100]/CropBox[20 10 90 95]/TrimBox[10 5 95 98]",
    ],
)
@pytest.mark.parametrize("dpi", [100, 347.3])
def test_ghostscript_puts_a_page_where_mupdf_puts_it(write_pdf: WritePdf, page: str, dpi: float) -> None:
    """Within a pixel: it inks every pixel that a shape touches."""
    job = write_pdf(SHAPES, page=page)
    by_mupdf, by_ghostscript = rip(job, None, dpi), rip(job, GHOSTSCRIPT, dpi)
    assert by_mupdf.shape == by_ghostscript.shape
    for ink in (0, 3):
        for axis in (0, 1):
            ends = [
                np.nonzero((cmyk[..., ink] > 0).any(axis=axis))[0][[0, -1]]
                for cmyk in (by_mupdf, by_ghostscript)
            ]
            assert np.abs(ends[0] - ends[1]).max() <= 1


FRACTIONS = (
    "0 0 0 1 k 0 0 0 1 K 10.03 10 20.31 15.77 re f 40 10.02 8.4 12 re f 0.5 w 10 60.13 m 90 60.13 l S "
    "0.3 w 75.27 5 m 75.27 55 l S 0 w 5 80.04 m 95 80.04 l S"
)
"""Rectangles and lines at parts of a pixel of 1200 dpi, which is 0.06 points, and on its borders."""


@pytest.mark.parametrize(
    ("fill", "begins", "ends"), [("centre", np.round, np.round), ("any-part", np.floor, np.ceil)]
)
def test_a_rule_fills_the_pixels_that_it_states(
    write_pdf: WritePdf, fill: FillRule, begins: Any, ends: Any
) -> None:
    edges = np.array([[10.03, 33.44], [50.0, 58.32], [70.021, 70.37]])
    paths = " ".join(f"{left} 10 {right - left:.3f} 50 re f" for left, right in edges.tolist())
    how = {"drawn_dpi": 720, "rip": RipModel(fill=fill)}
    filled = rip(write_pdf(f"0 0 0 1 k {paths}"), None, 720, **how)[500, :, 3] > 0
    for left, right in 10 * edges:
        inside = slice(int(begins(left)), int(ends(right)))
        assert filled[inside].all()
        assert not filled[[inside.start - 1, inside.stop]].any()


@needs_ghostscript
def test_any_part_fills_the_pixels_of_paths_that_ghostscript_fills(write_pdf: WritePdf) -> None:
    job = write_pdf(FRACTIONS)
    by_mupdf = rip(job, None, 1200, drawn_dpi=1200, rip=RipModel(fill="any-part"))
    # The line thinner than a pixel ends a pixel later.
    assert (by_mupdf != rip(job, GHOSTSCRIPT, 1200)).sum() <= 1


@needs_ghostscript
def test_ghostscript_leaves_native_cmyk_alone_and_converts_the_rest(
    tmp_path: Path, write_pdf: WritePdf
) -> None:
    profile = tmp_path / "output.icc"
    profile.write_bytes(cmyk_profile())
    job = write_pdf("0.2 0.4 0 0.6 k 0 0 50 100 re f 0.9 0.1 0.1 rg 50 0 50 100 re f")
    cmyk, plain = (rip(job, GHOSTSCRIPT, profile=one) for one in (profile, None))
    assert np.abs(cmyk[50, 25].astype(int) - [51, 102, 0, 153]).max() <= 1
    assert np.abs(cmyk[50, 75].astype(int) - plain[50, 75]).max() > 10


@needs_ghostscript
def test_ghostscript_says_which_font_it_substitutes(write_pdf: WritePdf) -> None:
    font = "/Font<</F<</Type/Font/Subtype/TrueType/BaseFont/NoSuchSans>>>>"
    with PdfJob(write_pdf("BT /F 20 Tf 5 20 Td (Rag) Tj ET", resources=font), engine=GHOSTSCRIPT) as job:
        warnings = job.page(1, 72).warnings
    assert [(one.kind, one.object_name) for one in warnings] == [("font-substituted", "NoSuchSans")]


@needs_ghostscript
def test_ghostscript_that_leaves_an_image_out_refuses_the_page(write_pdf: WritePdf) -> None:
    image = b"<</Type/XObject/Subtype/Image/Width 8/Height 8/ColorSpace/DeviceGray/BitsPerComponent 8/Filter/DCTDecode"
    job = write_pdf(
        "q 50 0 0 50 0 0 cm /I Do Q",
        resources="/XObject<</I 5 0 R>>",
        more=[image + b"/Length 9>>stream\nnot a JPEG\nendstream"],
    )
    with pytest.raises(JobError, match="page 1: Ghostscript leaves something out of it"):
        rip(job, GHOSTSCRIPT)


def test_a_page_too_large_to_be_drawn_at_once_is_refused(tmp_path: Path, write_pdf: WritePdf) -> None:
    huge = write_pdf(SHAPES, page="/MediaBox[0 0 1280 1280]")
    with (
        pytest.raises(JobError, match="has 455 megapixels, which command draws at once"),
        PdfJob(huge, engine=quick(tmp_path, "true")) as job,
    ):
        job.page(1, 150, drawn_dpi=1200)


def test_an_engine_is_part_of_what_a_job_is_made_of(tmp_path: Path) -> None:
    source = JobSource(path=tmp_path / "job.pdf", dpi=72)
    assert hash(replace(source, engine=GHOSTSCRIPT)) != hash(source)
