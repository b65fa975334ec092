"""What a page prints where MuPDF alone reads it otherwise: layers, alternates, links, images, bytes after the end."""

from __future__ import annotations

import io
import zlib
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from PIL import Image
from tests.pages.conftest import one_page, stream

from prooflight.errors import JobError
from prooflight.pages.job import open_job
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.warnings import PageWarning

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page

    WritePdf = Callable[..., Path]

CYAN = "1 0 0 0 k 0 0 100 100 re f"
SHOW = "100 0 0 100 0 0 cm /I Do"


def page_of(path: Path) -> Page:
    with PdfJob(path) as job:
        return job.page(1, 72)


def middle(path: Path) -> list[int]:
    return page_of(path).cmyk[50, 50].tolist()


def image(entries: str, data: bytes) -> bytes:
    return stream(data, f"/Type/XObject/Subtype/Image{entries}".encode())


PRINT_OFF, PRINT_ON = "/Usage<</Print<</PrintState/OFF>>>>", "/Usage<</Print<</PrintState/ON>>>>"
VIEW_OFF = "/Usage<</View<</ViewState/OFF>>>>"
ASKED = "/AS[<</Event/Print/OCGs[5 0 R]/Category[/Print]>>]"


@pytest.mark.parametrize(
    ("group", "default", "printed"),
    [
        ("", "", True),
        ("", "/OFF[5 0 R]", False),
        ("", "/BaseState/OFF", False),
        ("", "/BaseState/OFF/ON[5 0 R]", True),
        pytest.param(PRINT_OFF, "", True, id="nobody asks for the usage"),
        pytest.param(PRINT_OFF, ASKED, False, id="usage asked for, off"),
        pytest.param(PRINT_ON, f"/OFF[5 0 R]{ASKED}", True, id="printed only"),
        pytest.param(
            PRINT_OFF, ASKED.replace("/Event/Print", "/Event/View"), True, id="asked for another event"
        ),
        pytest.param(PRINT_OFF, ASKED.replace("[5 0 R]", "[]"), True, id="asked for other layers"),
        pytest.param(VIEW_OFF, ASKED, True, id="asked for another category"),
        pytest.param("/Intent/Design", "/OFF[5 0 R]", True, id="a state of another intent"),
        pytest.param("/Intent/Design", "/OFF[5 0 R]/Intent/All", False, id="a state of any intent"),
    ],
)
def test_layers_are_as_for_printing(write_pdf: WritePdf, group: str, default: str, printed: bool) -> None:
    job = write_pdf(
        f"/OC /L BDC {CYAN} EMC",
        resources="/Properties<</L 5 0 R>>",
        catalogue=f"/OCProperties<</OCGs[5 0 R]/D<<{default}>>>>",
        more=[f"<</Type/OCG/Name(a){group}>>".encode()],
    )
    assert middle(job) == [255 * printed, 0, 0, 0]


@pytest.mark.parametrize(
    ("expression", "printed"),
    [
        ("/VE[/Not 6 0 R]", True),
        ("/VE[/And 5 0 R 6 0 R]", False),
        ("/VE[/Or 5 0 R 6 0 R]", True),
        ("/VE[/And 5 0 R[/Not 6 0 R]]", True),
        ("/OCGs[5 0 R 6 0 R]/P/AllOn", False),
        ("/OCGs[5 0 R 6 0 R]/P/AnyOff", True),
        ("/OCGs 6 0 R", False),
    ],
)
@pytest.mark.parametrize("where", ["content", "form"])
def test_expressions_of_layers(write_pdf: WritePdf, expression: str, printed: bool, where: str) -> None:
    """Layer 5 is on, layer 6 off."""
    content = f"/OC /L BDC {CYAN} EMC" if where == "content" else "/X Do"
    job = write_pdf(
        content,
        resources="/Properties<</L 7 0 R>>/XObject<</X 8 0 R>>",
        catalogue="/OCProperties<</OCGs[5 0 R 6 0 R]/D<</OFF[6 0 R]>>>>",
        more=[
            b"<</Type/OCG/Name(a)>>",
            b"<</Type/OCG/Name(b)>>",
            f"<</Type/OCMD{expression}>>".encode(),
            stream(CYAN.encode(), b"/Subtype/Form/BBox[0 0 100 100]/OC 7 0 R"),
        ],
    )
    assert middle(job) == [255 * printed, 0, 0, 0]


PIXEL = "/Width 1/Height 1/ColorSpace/DeviceCMYK/BitsPerComponent 8"


@pytest.mark.parametrize(("chosen", "expected"), [("true", [255, 0, 0, 0]), ("false", [0, 255, 0, 0])])
@pytest.mark.parametrize("where", ["page", "form"])
def test_the_alternate_for_printing_is_printed(
    write_pdf: WritePdf, chosen: str, expected: list[int], where: str
) -> None:
    alternates = f"/Alternates[<</Image 6 0 R/DefaultForPrinting {chosen}>>]"
    base, other = image(PIXEL + alternates, b"\0\xff\0\0"), image(PIXEL, b"\xff\0\0\0")
    form = stream(SHOW.encode(), b"/Subtype/Form/BBox[0 0 100 100]/Resources<</XObject<</I 5 0 R>>>>")
    content, resources = (
        (SHOW, "/XObject<</I 5 0 R>>") if where == "page" else ("/X Do", "/XObject<</X 7 0 R>>")
    )
    assert middle(write_pdf(content, resources=resources, more=[base, other, form])) == expected


@pytest.mark.parametrize(("mode", "space"), [("LA", "/DeviceGray"), ("RGBA", "/DeviceRGB")])
@pytest.mark.parametrize(
    ("asked", "opaque"), [("", True), ("/SMaskInData 0", True), ("/SMaskInData 1", False)]
)
def test_opacity_in_jpeg_2000_is_used_where_it_is_asked_for(
    write_pdf: WritePdf, mode: str, space: str, asked: str, opaque: bool
) -> None:
    file = io.BytesIO()
    colour = (0, 128) if mode == "LA" else (0, 0, 0, 128)
    Image.new(mode, (32, 32), colour).save(file, "JPEG2000")
    entries = f"/Width 32/Height 32/ColorSpace{space}/Filter/JPXDecode{asked}"
    job = write_pdf(SHOW, resources="/XObject<</I 5 0 R>>", more=[image(entries, file.getvalue())])
    inks = page_of(job).cmyk[50, 50]
    solid = middle(write_pdf(f"{'0 g' if mode == 'LA' else '0 0 0 rg'} 0 0 100 100 re f"))
    np.testing.assert_allclose(inks, np.asarray(solid) * (1.0 if opaque else 0.5), atol=2)


@pytest.mark.parametrize(
    ("flags", "states", "printed"), [("/F 4", "5 0 R", True), ("", "5 0 R", False), ("/F 6", "5 0 R", False)]
)
def test_a_link_with_an_appearance_is_printed(
    write_pdf: WritePdf, flags: str, states: str, printed: bool
) -> None:
    link = f"/Annots[<</Subtype/Link{flags}/Rect[0 0 100 100]/AP<</N {states}>>>>]"
    more = [stream(CYAN.encode(), b"/Subtype/Form/BBox[0 0 100 100]")]
    assert middle(write_pdf("", page=f"/MediaBox[0 0 100 100]{link}", more=more)) == [255 * printed, 0, 0, 0]


UNDECODABLE = {
    "no JPEG": ("/Filter/DCTDecode", b"hello" * 40),
    "a JPEG cut off": ("/Filter/DCTDecode", b""),
    "no deflated data": ("/Filter/FlateDecode", b"hello" * 40),
    "deflated data cut off": (
        "/Filter/FlateDecode",
        zlib.compress(np.random.default_rng(1).bytes(4096))[:1000],
    ),
    "no JPEG 2000": ("/Filter/JPXDecode", b"hello" * 40),
    "no JBIG2": ("/Filter/JBIG2Decode", b"hello" * 40),
    "no LZW": ("/Filter/LZWDecode", b"\xff" * 40),
    "run lengths cut off": ("/Filter/RunLengthDecode", b"\x7f123"),
}


def cut_jpeg() -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.random.default_rng(3).integers(0, 256, (64, 64)).astype(np.uint8)).save(file, "JPEG")
    return file.getvalue()[: len(file.getvalue()) // 2]


@pytest.mark.parametrize("kind", UNDECODABLE)
@pytest.mark.parametrize("use", ["image", "stencil", "soft mask"])
def test_an_image_that_cannot_be_decoded_refuses_its_page(write_pdf: WritePdf, kind: str, use: str) -> None:
    """And the next page that shows it: what MuPDF keeps of it is forgotten."""
    filters, data = UNDECODABLE[kind]
    if use == "stencil" and kind == "a JPEG cut off":
        pytest.skip("a stencil needs an eighth of the samples that are left")
    size = f"/Width 64/Height 64{filters}"
    broken = image(
        size
        + (
            "/ImageMask true/BitsPerComponent 1"
            if use == "stencil"
            else "/ColorSpace/DeviceGray/BitsPerComponent 8"
        ),
        data or cut_jpeg(),
    )
    more = [broken]
    if use == "soft mask":
        more = [
            image("/Width 1/Height 1/ColorSpace/DeviceGray/BitsPerComponent 8/SMask 6 0 R", b"\0"),
            broken,
        ]
    job = write_pdf("36 0 0 18 18 54 cm /I Do", resources="/XObject<</I 5 0 R>>", more=more)
    for _ in range(2):
        with PdfJob(job) as opened, pytest.raises(JobError) as caught:
            opened.page(1, 72)
        text = str(caught.value)
        assert "page 1: " in text
        assert "image I (object" in text
        assert "13 x 6 mm at 6, 10 mm from the top left" in text
        assert "cannot be decoded" in text
        assert "\n" not in text


def test_an_image_that_is_not_shown_does_not_matter(write_pdf: WritePdf) -> None:
    broken = image("/Width 64/Height 64/ColorSpace/DeviceGray/BitsPerComponent 8/Filter/DCTDecode", b"hello")
    assert middle(write_pdf(CYAN, resources="/XObject<</I 5 0 R>>", more=[broken])) == [255, 0, 0, 0]


def test_an_image_with_too_few_samples_is_a_warning(write_pdf: WritePdf) -> None:
    short = image("/Width 2/Height 10/ColorSpace/DeviceGray/BitsPerComponent 8", bytes(15))
    page = page_of(write_pdf(SHOW, resources="/XObject<</I 5 0 R>>", more=[short]))
    assert [(warning.kind, warning.page) for warning in page.warnings] == [("image-short", 0)]
    assert "image I (object 5), 35 x 35 mm at 0, 0 mm" in page.warnings[0].message


def font(name: str, more: str = "") -> str:
    return f"/Font<</F<</Type/Font/Subtype/TrueType/BaseFont/{name}/Encoding/WinAnsiEncoding{more}>>>>"


TEXT = "BT /F 40 Tf 5 40 Td (ABC) Tj ET"


@pytest.mark.parametrize("name", ["CorporateSans-Bold", "Helvetica", "Arial"])
def test_a_font_that_is_not_embedded_is_a_warning(write_pdf: WritePdf, name: str) -> None:
    page = page_of(write_pdf(TEXT, resources=font(name)))
    assert page.warnings == (
        PageWarning(
            page=0,
            kind="font-substituted",
            message=f"the font {name} is not embedded, and another is drawn in its place: embed it",
            object_name=name,
        ),
    )


def test_a_font_that_no_text_uses_is_no_warning(write_pdf: WritePdf) -> None:
    assert page_of(write_pdf(CYAN, resources=font("CorporateSans"))).warnings == ()


@pytest.mark.parametrize(
    ("state", "warned"),
    [
        ("/TR 5 0 R", True),
        ("/TR2/Default", False),
        ("/TR/Identity", False),
        ("/TR2[5 0 R 5 0 R 5 0 R 5 0 R]", True),
    ],
)
def test_a_transfer_function_is_ignored_with_a_warning(write_pdf: WritePdf, state: str, warned: bool) -> None:
    more = [stream(b"{1 exch sub}", b"/FunctionType 4/Domain[0 1]/Range[0 1]")]
    page = page_of(write_pdf(f"/X gs {CYAN}", resources=f"/ExtGState<</X<<{state}>>>>", more=more))
    assert page.cmyk[50, 50].tolist() == [255, 0, 0, 0]
    assert [(warning.kind, warning.object_name) for warning in page.warnings] == [
        ("transfer-function", "X")
    ] * warned


@pytest.mark.parametrize("profile", [b"no profile", b""])
def test_a_colour_space_that_falls_back_is_a_warning(write_pdf: WritePdf, profile: bytes) -> None:
    more = [stream(profile, b"/N 4")]
    page = page_of(
        write_pdf(
            "/C cs 1 0 0 0 scn 0 0 100 100 re f", resources="/ColorSpace<</C[/ICCBased 5 0 R]>>", more=more
        )
    )
    assert page.cmyk[50, 50].tolist() == [255, 0, 0, 0]
    assert "colour-space" in {warning.kind for warning in page.warnings}


@pytest.mark.parametrize(
    ("boxes", "shape"),
    [
        ("/TrimBox[0 0 0 0]", (100, 100)),
        ("/TrimBox[10 10 10 90]/CropBox[0 0 80 60]", (60, 80)),
        ("/CropBox[5 5 5 5]/TrimBox[10 10 90 50]", (40, 80)),
    ],
)
def test_a_box_without_area_is_passed_over(write_pdf: WritePdf, boxes: str, shape: tuple[int, int]) -> None:
    path = write_pdf(CYAN, page=f"/MediaBox[0 0 100 100]{boxes}")
    page = page_of(path)
    assert page.cmyk.shape[:2] == shape
    assert [warning.kind for warning in page.warnings] == ["box"]
    with open_job(path, dpi=72) as job:
        assert len(job.page_sizes_mm) == 1
        assert [(warning.page, warning.kind) for warning in job.warnings] == [(0, "box")]


def appended(path: Path, data: bytes) -> Path:
    path.write_bytes(path.read_bytes() + data)
    return path


@pytest.mark.parametrize("data", [bytes(4096), b"\r\n" * 3000, b"<html>" * 1000])
def test_bytes_after_the_end_do_not_matter(write_pdf: WritePdf, data: bytes) -> None:
    page = page_of(appended(write_pdf(CYAN), data))
    assert page.cmyk[50, 50].tolist() == [255, 0, 0, 0]
    assert page.warnings == ()


def test_an_update_that_is_cut_off_is_refused(write_pdf: WritePdf) -> None:
    """Else its page would print as it was before."""
    update = b"\n4 0 obj\n" + stream(b"0 1 0 0 k 0 0 100 100 re f" + b" " * 4000)
    with pytest.raises(JobError, match="the PDF is truncated"):
        page_of(appended(write_pdf(CYAN), update))


def test_encryption_for_certificates_is_named(tmp_path: Path) -> None:
    path = tmp_path / "job.pdf"
    encryption = (
        b"/Encrypt<</Filter/Adobe.PubSec/SubFilter/adbe.pkcs7.s5/V 4/Length 128/Recipients[(x)]>>/ID[(a)(a)]"
    )
    path.write_bytes(one_page(CYAN).replace(b"/Root 1 0 R", b"/Root 1 0 R" + encryption))
    with pytest.raises(JobError, match="the PDF is encrypted for the holders of certificates"):
        PdfJob(path)


def test_warnings_of_a_job_name_its_pages(tmp_path: Path) -> None:
    (tmp_path / "a.pdf").write_bytes(one_page(CYAN))
    (tmp_path / "b.pdf").write_bytes(one_page(TEXT, resources=font("CorporateSans")))
    with open_job(tmp_path, dpi=72) as job:
        pages = list(job)
        assert [len(page.warnings) for page in pages] == [0, 1]
        assert job.warnings == pages[1].warnings
        assert job.warnings[0].page == 1
