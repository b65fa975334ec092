"""What is said of a job before it is printed: facts of pages in closed form, and warnings in time."""

from __future__ import annotations

import shutil
import sys
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from dataclasses import replace

from tests.pages.conftest import one_page, pdf_bytes, stream

from prooflight.pages.check import REFUSED, checked_page, early_warnings, plain, warning_text
from prooflight.pages.job import Job, JobSource
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.facts import Font, Layer, Spot
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.warnings import WHOLE_FILE, PageWarning

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight.pages.pdf.facts import PageFacts

    WritePdf = Callable[..., Path]

TINT = "/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 0.2 0.8 0.1]/N 1>>"
SPOTS = f"/ColorSpace<</S[/Separation/Gold{TINT}]/U[/Separation/Unused{TINT}]/A[/Separation/All{TINT}]>>"
STATES = "/ExtGState<</T<</ca .5>>/B<</BM/Multiply>>/O<</op true/OPM 1>>/M<</SMask<</S/Alpha/G 5 0 R>>>>>>"
IMAGE = "/XObject<</I 5 0 R>>"


def facts_of(path: Path) -> PageFacts:
    with PdfJob(path) as job:
        return job.facts(1)[0]


@pytest.mark.parametrize(
    ("page", "box"),
    [
        ("/MediaBox[0 0 100 100]", "MediaBox"),
        ("/MediaBox[0 0 100 100]/CropBox[0 0 90 90]", "CropBox"),
        ("/MediaBox[0 0 100 100]/CropBox[0 0 90 90]/TrimBox[5 5 80 80]", "TrimBox"),
        ("/MediaBox[0 0 100 100]/BleedBox[0 0 90 90]", "MediaBox"),
    ],
)
def test_the_box_that_is_printed_is_named(write_pdf: WritePdf, page: str, box: str) -> None:
    assert facts_of(write_pdf("", page=page)).box == box


def test_a_page_without_anything_says_so(write_pdf: WritePdf) -> None:
    facts = facts_of(write_pdf("0 0 0 1 k 0 0 10 10 re f"))
    empty = (
        facts.output_intent,
        facts.transparency,
        facts.overprint,
        facts.layers,
        facts.fonts,
        facts.images,
    )
    assert empty == ("", (), (), (), (), ())
    assert facts.spots == ()


def test_spots_are_those_of_the_resources_and_say_whether_they_are_painted(write_pdf: WritePdf) -> None:
    path = write_pdf("/S cs 1 scn 0 0 10 10 re f /A cs 1 scn 20 20 10 10 re f", resources=SPOTS)
    with PdfJob(path) as job:
        facts, printed = job.facts(1)
    assert sorted(facts.spots, key=lambda spot: spot.name) == [
        Spot(name="Gold", painted=True),
        Spot(name="Unused", painted=False),
    ]
    assert printed == {"Gold": (0, 51, 204, 26), "Unused": (0, 51, 204, 26)}


def test_any_number_of_spots_has_values(write_pdf: WritePdf) -> None:
    ends = [f"0 0 {i / 100:g} 0" for i in range(1, 71)]
    spaces = "".join(
        f"/S{i}[/Separation/Spot{i}/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[{end}]/N 1>>]"
        for i, end in enumerate(ends, start=1)
    )
    with PdfJob(write_pdf("", resources=f"/ColorSpace<<{spaces}>>")) as job:
        printed = job.facts(1)[1]
    assert len(printed) == 70
    for i in range(1, 71):
        assert printed[f"Spot{i}"] == pytest.approx((0, 0, 2.55 * i, 0), abs=0.51)


@pytest.mark.skipif(shutil.which("gs") is None, reason="Ghostscript is not installed")
def test_values_of_spots_are_those_of_the_press_s_engine(write_pdf: WritePdf) -> None:
    with PdfJob(write_pdf("", resources=SPOTS), engine=RipEngine(name="ghostscript")) as job:
        printed = job.facts(1)[1]
    assert printed["Gold"] == (0, 51, 204, 25)  # it truncates


def test_transparency_and_overprint_are_what_is_in_use(write_pdf: WritePdf) -> None:
    form = b"/Type/XObject/Subtype/Form/BBox[0 0 100 100]/Group<</S/Transparency/CS/DeviceGray>>"
    square = "0 0 0 1 k 0 0 50 50 re f"
    for state, transparency, overprint in (
        ("", (), ()),
        ("/T gs", ("alpha",), ()),
        ("/B gs", ("blend mode Multiply",), ()),
        ("/O gs", (), ("mode 1",)),
        ("/M gs", ("soft mask",), ()),
    ):
        path = write_pdf(
            f"{state} {square}", resources=STATES, more=[stream(b"0 0 0 1 k 0 0 9 9 re f", form)]
        )
        facts = facts_of(path)
        assert set(transparency) <= set(facts.transparency)
        assert bool(facts.transparency) == bool(transparency)
        assert facts.overprint == overprint


def test_fonts_say_whether_they_are_embedded(write_pdf: WritePdf) -> None:
    fonts = (
        "/Font<</A<</Type/Font/Subtype/TrueType/BaseFont/Absent>>"
        "/B<</Type/Font/Subtype/TrueType/BaseFont/Present/FontDescriptor<</FontFile2 5 0 R>>>>>>"
    )
    facts = facts_of(write_pdf("", resources=fonts, more=[stream(b"font")]))
    assert set(facts.fonts) == {
        Font(name="Absent", kind="TrueType", embedded=False),
        Font(name="Present", kind="TrueType", embedded=True),
    }


def test_images_have_their_resolution_on_paper(write_pdf: WritePdf) -> None:
    entries = b"/Type/XObject/Subtype/Image/Width 100/Height 50/ColorSpace/DeviceGray/BitsPerComponent 8"
    path = write_pdf("q 36 0 0 72 10 10 cm /I Do Q", resources=IMAGE, more=[stream(bytes(100 * 50), entries)])
    (image,) = facts_of(path).images
    assert (image.width_px, image.height_px, image.bits, image.colours) == (100, 50, 8, "DeviceGray")
    assert image.dpi == (200.0, 50.0)


@pytest.mark.parametrize(
    ("config", "printed"),
    [
        ("", True),
        ("/OFF[5 0 R]", False),
        ("/BaseState/OFF", False),
        ("/BaseState/OFF/ON[5 0 R]", True),
        ("/AS[<</Event/Print/Category[/Print]/OCGs[5 0 R]>>]", False),
        ("/AS[<</Event/View/Category[/View]/OCGs[5 0 R]>>]", True),
    ],
)
def test_layers_say_whether_they_are_printed(write_pdf: WritePdf, config: str, printed: bool) -> None:
    group = b"<</Type/OCG/Name(Varnish)/Usage<</Print<</Subtype/Print/PrintState/OFF>>>>>>"
    path = write_pdf(
        "/OC /L BDC 0 0 0 1 k 0 0 9 9 re f EMC",
        resources="/Properties<</L 5 0 R>>",
        catalogue=f"/OCProperties<</OCGs[5 0 R]/D<<{config}>>>>",
        more=[group],
    )
    assert facts_of(path).layers == (Layer(name="Varnish", printed=printed),)


def test_the_output_intent_of_inks_is_named_before_others(write_pdf: WritePdf) -> None:
    intent = "<</S/GTS_PDF{}/OutputConditionIdentifier({})/DestOutputProfile {} 0 R>>"
    intents = intent.format("A1", "screen", 5) + intent.format("X", "paper", 6)
    path = write_pdf(
        "", catalogue=f"/OutputIntents[{intents}]", more=[stream(b"", b"/N 3"), stream(b"", b"/N 4")]
    )
    assert facts_of(path).output_intent == "paper (CMYK)"


def three_pages(path: Path, contents: tuple[str, ...]) -> Path:
    """A PDF of pages, each of its own content."""
    count = len(contents)
    kids = " ".join(f"{3 + i} 0 R" for i in range(count))
    pages = [
        f"<</Type/Page/Parent 2 0 R/MediaBox[0 0 100 100]/Contents {3 + count + i} 0 R>>".encode()
        for i in range(count)
    ]
    tree = f"<</Type/Pages/Kids[{kids}]/Count {count}>>".encode()
    streams = [stream(content.encode()) for content in contents]
    path.write_bytes(pdf_bytes([b"<</Type/Catalog/Pages 2 0 R>>", tree, *pages, *streams]))
    return path


def test_a_page_that_cannot_be_drawn_is_checked_as_far_as_it_goes(tmp_path: Path) -> None:
    path = tmp_path / "job.pdf"
    path.write_bytes(one_page("", page="/MediaBox[0 0 100 100]/Rotate 45"))
    with JobSource(path=path, dpi=72).open() as job:
        checked, page = checked_page(job, 1)
    assert page is None
    assert "Rotate is a multiple of 90" in checked.refused
    assert checked.coverage is None


def test_coverage_is_the_mean_of_each_ink(tmp_path: Path) -> None:
    path = tmp_path / "job.pdf"
    path.write_bytes(one_page("1 0 0 0 k 0 0 50 100 re f 0 0 0 0.2 k 50 0 50 100 re f"))
    with JobSource(path=path, dpi=72).open() as job:
        checked, _ = checked_page(job, 1)
    assert checked.coverage == pytest.approx((0.5, 0, 0, 0.1))
    assert checked.size_mm == pytest.approx((35.28, 35.28), abs=0.01)


class WarnedJob(Job):
    """A job whose pages have each a warning, but for the second, which cannot be used."""

    def coarse_warnings(self, number: int) -> tuple[PageWarning, ...]:
        super().coarse_warnings(number)
        return (PageWarning(page=number - 1, kind="made-up", message=f"page {number}: beware"),)


@pytest.fixture
def warned_job(tmp_path: Path) -> Iterator[WarnedJob]:
    path = three_pages(tmp_path / "job.pdf", ("", "", ""))
    path.write_bytes(path.read_bytes().replace(b"4 0 obj\n<</Type/Page", b"4 0 obj\n<</Rotate 7/Type/Page"))
    with WarnedJob(JobSource(path=path, dpi=72)) as job:
        yield job


def test_warnings_come_before_the_first_sheet_and_a_refused_page_is_one(warned_job: WarnedJob) -> None:
    early = early_warnings(warned_job)
    of_pages = [(one.page, one.kind) for one in early.warnings if one.page != WHOLE_FILE]
    assert of_pages == [(0, "made-up"), (1, REFUSED), (2, "made-up")]
    assert early.remark == ""
    assert early.at_start == set(early.warnings)


def test_a_long_job_is_not_waited_for(warned_job: WarnedJob) -> None:
    seconds = iter((0.0, 6.0, 11.0))
    early = early_warnings(warned_job, seconds=10, clock=lambda: next(seconds))
    assert (early.pages, early.of) == (2, 3)
    assert early.remark.startswith("the first 2 of 3 pages were checked before the first sheet")


def test_at_least_one_page_is_looked_through(warned_job: WarnedJob) -> None:
    assert early_warnings(warned_job, seconds=0, clock=lambda: 0.0).pages == 1


def test_a_warning_names_its_page_once() -> None:
    warning = PageWarning(page=6, kind="font-substituted", message="font A is not embedded", object_name="A")
    assert warning_text(warning) == "p0007: font A is not embedded"
    assert plain(warning) == {
        "page": 7, "kind": "font-substituted", "message": "font A is not embedded", "object": "A",
    }  # fmt: skip
    assert warning_text(replace(warning, page=WHOLE_FILE, message="repaired\nhere")) == "repaired here"


def test_drawn_coarsely_a_page_has_the_warnings_of_its_engine(tmp_path: Path, write_pdf: WritePdf) -> None:
    script = tmp_path / "front-end.py"
    script.write_text(
        "import sys, numpy as np, tifffile\nprint('toner is low')\ndpi = float(sys.argv[3])\n"
        "side = round(100 * dpi / 72)\n"
        "tifffile.imwrite(sys.argv[4], np.zeros((side, side, 4), np.uint8), photometric='separated',"
        " resolution=(dpi, dpi), resolutionunit='inch')\n"
    )
    command = (sys.executable, str(script), "{pdf}", "{page}", "{dpi}", "{out}")
    engine = RipEngine(name="command", command=command)
    source: dict[str, Any] = {"path": write_pdf(""), "dpi": 300, "engine": engine}
    with JobSource(**source).open() as job:
        (warning,) = early_warnings(job).warnings
    assert (warning.page, warning.kind) == (0, "rip-message")
    assert "toner is low" in warning.message
