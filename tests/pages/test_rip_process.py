"""PDFs made to exhaust time or memory, or to bring the renderer down, cost their page and nothing else."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from prooflight.errors import InputError, JobError, RequestError
from prooflight.pages.job import JobSource
from prooflight.pages.pdf import process as rip_process
from prooflight.pages.pdf.rip import PdfJob

if TYPE_CHECKING:
    from collections.abc import Callable

    WritePdf = Callable[..., Path]

SQUARE = "0 0 0 1 k 0 0 50 50 re f"


def stream(data: bytes, entries: str) -> bytes:
    return f"<<{entries}/Length {len(data)}>>stream\n".encode() + data + b"\nendstream"


def child() -> subprocess.Popen[bytes]:
    return rip_process._running[0]._process


def nested_forms(write_pdf: WritePdf) -> Path:
    """Ten forms in a form, nine deep: a thousand million squares."""
    box = "/Subtype/Form/BBox[0 0 100 100]"
    more = [
        stream(b"/F Do " * 10, f"{box}/Resources<</XObject<</F {6 + depth} 0 R>>>>") for depth in range(9)
    ]
    more.append(stream(SQUARE.encode(), box))
    return write_pdf("/F Do", resources="/XObject<</F 5 0 R>>", more=more)


def tiny_cells(write_pdf: WritePdf) -> Path:
    cell = "/PatternType 1/PaintType 1/TilingType 2/BBox[0 0 1 1]/XStep 0.0001/YStep 0.0001/Resources<<>>"
    return write_pdf(
        "/Pattern cs /P scn 0 0 100 100 re f",
        resources="/Pattern<</P 5 0 R>>",
        more=[stream(SQUARE.encode(), cell)],
    )


def much_content(write_pdf: WritePdf) -> Path:
    """A few kilobytes that become a hundred megabytes of squares."""
    squares = zlib.compress(b"0 0 100 100 re f\n" * 6_000_000, 9)
    form = "/Subtype/Form/BBox[0 0 100 100]/Filter/FlateDecode"
    return write_pdf("/F Do", resources="/XObject<</F 5 0 R>>", more=[stream(squares, form)])


def long_function(write_pdf: WritePdf) -> Path:
    function = b"{" + b"dup mul " * 200_000 + b" dup dup }"
    shading = (
        "<</ShadingType 1/ColorSpace/DeviceCMYK/Function 5 0 R/Domain[0 1 0 1]/Matrix[100 0 0 100 0 0]>>"
    )
    entries = "/FunctionType 4/Domain[0 1 0 1]/Range[0 1 0 1 0 1 0 1]"
    return write_pdf("/H sh", resources=f"/Shading<</H {shading}>>", more=[stream(function, entries)])


@pytest.mark.parametrize("make", [nested_forms, tiny_cells, much_content, long_function])
def test_a_page_that_takes_too_long_is_named_and_the_next_is_ripped(
    tmp_path: Path, write_pdf: WritePdf, monkeypatch: pytest.MonkeyPatch, make: Callable[[WritePdf], Path]
) -> None:
    bomb = make(write_pdf).rename(tmp_path / "bomb.pdf")
    with PdfJob(write_pdf(SQUARE)) as good:
        monkeypatch.setenv(rip_process.SECONDS, "0.5")
        with PdfJob(bomb) as job, pytest.raises(JobError) as caught:
            job.page(1, 72)
        assert str(caught.value) == (
            f"{bomb}: page 1 takes longer than 0.5 s; simplify it, or set PROOFLIGHT_RIP_SECONDS above 0.5"
        )
        assert good.page(1, 72).cmyk[75, 25, 3] == 255  # although its process is gone


def test_a_page_that_takes_too_much_memory_is_named(
    write_pdf: WritePdf, monkeypatch: pytest.MonkeyPatch
) -> None:
    tints = 60_000_000  # MuPDF holds each as four bytes
    packer = zlib.compressobj(1)
    packed = b"".join(packer.compress(bytes(tints // 60)) for _ in range(60)) + packer.flush()
    function = f"/FunctionType 0/Domain[0 1]/Range[0 1]/Size[{tints}]/BitsPerSample 8/Filter/FlateDecode"
    job = write_pdf(
        "/S cs 0.5 scn " + SQUARE,
        resources="/ColorSpace<</S[/Separation/Gold/DeviceGray 5 0 R]>>",
        more=[stream(packed, function)],
    )
    monkeypatch.setenv(rip_process.GIGABYTES, "0.1")
    with PdfJob(job) as opened, pytest.raises(JobError, match=r"page 1 takes more than 0.1 GB of memory"):
        opened.page(1, 72)
    monkeypatch.delenv(rip_process.GIGABYTES)
    with PdfJob(job) as opened:
        assert opened.page(1, 72).cmyk.any()


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGKILL])
def test_a_renderer_that_dies_is_told_with_its_page(
    write_pdf: WritePdf, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    monkeypatch.setenv(rip_process.SECONDS, "20")
    with PdfJob(nested_forms(write_pdf)) as job:
        process = child()
        timer = threading.Timer(0.3, process.send_signal, [number])
        timer.start()
        with pytest.raises(
            JobError, match=r"page 1 (makes the renderer fail \(SIGSEGV\)|is ended by the system)"
        ):
            job.page(1, 72)
        timer.join()
    assert process.poll() is not None
    with PdfJob(write_pdf(SQUARE)) as job:
        assert job.page(1, 72).cmyk.any()


def test_opening_and_measuring_have_limits_as_well(
    write_pdf: WritePdf, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = 10_000
    path = write_pdf("", more=[b"<</Type/Page/Parent 2 0 R/MediaBox[0 0 9 9]>>"] * (pages - 1))
    kids = b" ".join(b"%d 0 R" % number for number in (3, *range(5, pages + 4)))
    path.write_bytes(path.read_bytes().replace(b"[3 0 R]/Count 1", b"[%s]/Count %d" % (kids, pages)))
    with PdfJob(path) as job:
        assert len(job.page_sizes_mm) == pages
    monkeypatch.setenv(rip_process.SECONDS, "0.02")
    with pytest.raises(JobError, match=r"(opening it|measuring its pages) takes longer than 0.02 s"):
        _ = PdfJob(path).page_sizes_mm


@pytest.mark.parametrize("text", ["soon", "0", "-1", "nan", "inf"])
def test_a_limit_that_is_none(write_pdf: WritePdf, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv(rip_process.SECONDS, text)
    with pytest.raises(
        RequestError, match=r"PROOFLIGHT_RIP_SECONDS: .* is not a limit; give a number above 0"
    ):
        PdfJob(write_pdf(SQUARE))


def test_one_process_rips_all_pages_and_files(tmp_path: Path, write_pdf: WritePdf) -> None:
    paths = [write_pdf(f"0 0 0 {n / 20} k 0 0 100 100 re f").rename(tmp_path / f"{n}.pdf") for n in range(12)]
    jobs = [PdfJob(path) for path in paths]
    first = child().pid
    pages = [job.page(1, dpi).cmyk for dpi in (36, 144, 72) for job in jobs]
    for n, cmyk in enumerate(pages):  # a page is its own: the next ones are not drawn over it
        assert (cmyk == [0, 0, 0, round(255 * (n % 12) / 20)]).all()
    assert child().pid == first
    for job in jobs:
        job.close()


def test_a_file_that_is_replaced_is_not_mistaken(tmp_path: Path, write_pdf: WritePdf) -> None:
    path = write_pdf(SQUARE).rename(tmp_path / "a.pdf")
    with PdfJob(path) as job:
        job.page(1, 72)
        rip_process._running[0].end()
        write_pdf("").rename(path)
        with pytest.raises(JobError, match="changed while it was in use"):
            job.page(1, 72)


def test_names_that_are_not_utf_8(tmp_path: Path, write_pdf: WritePdf) -> None:
    path = tmp_path / os.fsdecode(b"F\xe4rbe\n.pdf")
    write_pdf(SQUARE).rename(path)
    with JobSource(path=path, dpi=72).open() as job:
        assert job.page(1).cmyk.any()


def _ripped(path: Path, found: multiprocessing.Queue[int]) -> None:
    with PdfJob(path) as job:
        found.put(int(job.page(1, 72).cmyk.sum()))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_daemons_and_forks_rip_too(write_pdf: WritePdf, method: str) -> None:
    path = write_pdf(SQUARE)
    with PdfJob(path) as job:
        wanted = int(job.page(1, 72).cmyk.sum())
        first = child().pid
        context = multiprocessing.get_context(method)
        found = context.Queue()
        process = context.Process(target=_ripped, args=(path, found), daemon=True)
        process.start()
        assert found.get(timeout=60) == wanted
        process.join(60)
        assert int(job.page(1, 72).cmyk.sum()) == wanted
        assert child().pid == first  # the fork left it alone


@pytest.mark.skipif(
    not Path("/proc/self/maps").exists(), reason="the system does not say what a process has loaded"
)
def test_the_compiler_is_loaded_for_the_first_page_that_is_drawn_finer(
    write_pdf: WritePdf, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And takes none of that page's memory: its limit is less than loading needs."""
    rip_process._running.clear()  # another one, that has drawn nothing
    job = PdfJob(write_pdf(SQUARE))
    once = job.page(1, 72).cmyk
    maps = Path(f"/proc/{child().pid}/maps")
    assert "llvmlite" not in maps.read_text()
    monkeypatch.setenv(rip_process.GIGABYTES, "0.02")
    finer = job.page(1, 72, drawn_dpi=144).cmyk
    assert "llvmlite" in maps.read_text()
    np.testing.assert_array_equal(finer, once)


BUSY = """
import signal, sys
from pathlib import Path
from prooflight.pages.pdf import process
from prooflight.pages.pdf.rip import PdfJob
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell started the tests with &
job = PdfJob(Path(sys.argv[1]))
print(process._running[0]._process.pid, flush=True)
job.page(1, 72)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_behind(write_pdf: WritePdf, number: signal.Signals) -> None:
    command = [sys.executable, "-c", BUSY, str(nested_forms(write_pdf))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        ripping = int(process.stdout.readline())
        time.sleep(0.3)  # in the midst of its page
        process.send_signal(number)
        assert process.wait(20) == -number  # the signal, not its page's limit of time
    for _ in range(100):
        state = Path(f"/proc/{ripping}/stat")
        if not state.exists() or state.read_text().rsplit(")", 1)[1].split()[0] == "Z":
            return
        time.sleep(0.1)
    os.kill(ripping, signal.SIGKILL)
    pytest.fail("the process that rips outlives the one that asked")


BOXES = {
    "none": ("", "page 1 has no MediaBox"),
    "words": ("/MediaBox[a b c d]", "page 1 has a MediaBox that is not of numbers"),
    "three": ("/MediaBox[0 0 100]", "page 1 has a MediaBox that is not of four numbers"),
    "a name": ("/MediaBox/A4", "page 1 has a MediaBox that is not of four numbers"),
    "flat": ("/MediaBox[0 0 100 0]", "page 1 has a MediaBox of 100 x 0 points"),
    "huge": ("/MediaBox[0 0 99999999 100]", r"page 1 has a MediaBox of 1e\+08"),
    "crop beside": ("/MediaBox[0 0 9 9]/CropBox[50 50 60 60]", "page 1 has a CropBox outside its MediaBox"),
    "crop of words": ("/MediaBox[0 0 9 9]/CropBox[(0)(0)(9)(9)]", "CropBox that is not of numbers"),
    "turned by 45": ("/MediaBox[0 0 9 9]/Rotate 45", "page 1 is to be turned by 45 degrees"),
    "unit": ("/MediaBox[0 0 9 9]/UserUnit 0", "page 1 has a UserUnit of 0"),
    "unit of words": ("/MediaBox[0 0 9 9]/UserUnit/Two", "page 1 has a UserUnit that is not of numbers"),
}


@pytest.mark.parametrize("kind", BOXES)
def test_boxes_that_make_no_sense_are_named(write_pdf: WritePdf, kind: str) -> None:
    page, what = BOXES[kind]
    with PdfJob(write_pdf("", page=page)) as job:
        with pytest.raises(JobError, match=what):
            job.page(1, 72)
        with pytest.raises(JobError, match=what):
            _ = job.page_sizes_mm


def test_boxes_that_are_legal_though_odd(write_pdf: WritePdf) -> None:
    for page, shape in (
        ("/MediaBox[100 90 0 0]", (90, 100)),  # corners in any order
        ("/MediaBox[-50 -20 50 20]", (40, 100)),
        ("/MediaBox[0 0 100 90]/CropBox[-10 -10 50 200]", (90, 50)),
        ("/MediaBox[0 0 100 90]/Rotate -90", (100, 90)),
        ("/MediaBox[0 0 100 90]/Rotate 450", (100, 90)),
        ("/MediaBox[0 0 10 9]/UserUnit 3.5", (32, 35)),
        ("/MediaBox[0 0 1 1]", (1, 1)),
    ):
        with PdfJob(write_pdf(SQUARE, page=page)) as job:
            assert job.page(1, 72).cmyk.shape[:2] == shape, page


def test_resolutions_that_are_none(write_pdf: WritePdf) -> None:
    path = write_pdf(SQUARE)
    for dpi in (float("inf"), float("nan"), 0.0, -1.0, 1e9, 1e-300):
        with pytest.raises(RequestError, match="give a dpi above 0: from 1 to 100000"):
            JobSource(path=path, dpi=dpi).open()
    with JobSource(path=path, dpi=100_000).open() as job, pytest.raises(InputError, match="megapixels"):
        job.page(1)


def test_a_pipe_is_no_job(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "p0001.pdf")
    for path in (tmp_path / "p0001.pdf", tmp_path):
        with pytest.raises(JobError, match=r"p0001\.pdf: is not a file"):
            JobSource(path=path, dpi=72).open()


def test_a_link_to_nothing_is_not_passed_over(tmp_path: Path, write_pdf: WritePdf) -> None:
    folder = tmp_path / "job"
    folder.mkdir()
    write_pdf(SQUARE).rename(folder / "p0001.pdf")
    (folder / "p0002.pdf").symlink_to(tmp_path / "gone.pdf")
    (folder / "more.pdf").mkdir()  # folders are no pages
    with pytest.raises(JobError, match=r"p0002\.pdf: is a broken link"):
        JobSource(path=folder, dpi=72).open()
