"""What is rare on a page, and printed as ISO 32000-2 says all the same; what cannot be drawn is said."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from tests.pages.conftest import stream

from prooflight.errors import JobError
from prooflight.pages.pdf.rip import PdfJob

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page

    WritePdf = Callable[..., Path]

ALL = "0 0 100 100 re f"
CYAN = f"1 0 0 0 k {ALL}"
SHOW = "100 0 0 100 0 0 cm /I Do"
STATES = "/ExtGState<</A<</ca .5>>/Q<</op true/OPM 1>>>>"
MIXED = "[/DeviceN[/SpotA/SpotB]/DeviceCMYK 5 0 R]"
PRODUCT = stream(b"{mul 0 exch 0 0}", b"/FunctionType 4/Domain[0 1 0 1]/Range[0 1 0 1 0 1 0 1]")
"""From tints a and b to a b of magenta."""
LAB = "[/Lab<</WhitePoint[.9642 1 .8249]%s>>]"
TOLERANCE = 2


def page_of(path: Path) -> Page:
    with PdfJob(path) as job:
        return job.page(1, 72)


def middle(path: Path) -> list[int]:
    return page_of(path).cmyk[50, 50].tolist()


def image(entries: str, data: bytes) -> bytes:
    return stream(data, f"/Type/XObject/Subtype/Image/BitsPerComponent 8{entries}".encode())


def kinds(page: Page) -> list[str]:
    return [warning.kind for warning in page.warnings]


def test_the_background_of_a_gradient_counts_in_a_pattern_alone(write_pdf: WritePdf) -> None:
    """8.7.4.3, table 77; one gradient is used both ways."""
    blend = "/Function<</FunctionType 2/Domain[0 1]/C0[0 1 0 0]/C1[0 1 0 0]/N 1>>"
    gradient = (
        f"<</ShadingType 2/Coords[0 0 10 0]/ColorSpace/DeviceCMYK/Background[1 0 0 0]{blend}>>".encode()
    )
    resources = "/Shading<</H 5 0 R>>/Pattern<</P<</PatternType 2/Shading 5 0 R>>>>"
    cmyk = page_of(
        write_pdf("/H sh /Pattern cs /P scn 50 0 50 100 re f", resources=resources, more=[gradient])
    ).cmyk
    assert not cmyk[50, 40].any()
    assert cmyk[50, 60].tolist() == [255, 0, 0, 0]
    assert cmyk[95, 3].tolist() == [0, 255, 0, 0]


@pytest.mark.parametrize(
    ("space", "tints", "expected"),
    [
        (MIXED, (204, 153), [0, 122, 0, 0]),
        ("[/Separation/All/DeviceGray<</FunctionType 2/Domain[0 1]/C0[1]/C1[0]/N 1>>]", (153,), [153] * 4),
    ],
)
def test_a_mesh_in_any_colorants(
    write_pdf: WritePdf, space: str, tints: tuple[int, ...], expected: list[int]
) -> None:
    corners = ((0, 0), (2**16 - 1, 0), (0, 2**16 - 1))
    data = b"".join(struct.pack(">BHH", 0, *corner) + bytes(tints) for corner in corners)
    entries = f"/ShadingType 4/ColorSpace{space}/BitsPerCoordinate 16/BitsPerComponent 8/BitsPerFlag 8"
    mesh = stream(data, f"{entries}/Decode[0 300 0 300{' 0 1' * len(tints)}]".encode())
    page = page_of(write_pdf("/H sh", resources="/Shading<</H 6 0 R>>", more=[PRODUCT, mesh]))
    assert page.cmyk[50, 50].tolist() == expected
    assert not page.warnings


@pytest.mark.parametrize(
    ("space", "data"),
    [(MIXED, b"\xcc\x99"), ("/DeviceRGB", b"\x80\x4d\x33"), ("[/Indexed/DeviceRGB 1<804D33FF0000>]", b"\0")],
)
def test_a_colour_key_leaves_other_samples_alone(write_pdf: WritePdf, space: str, data: bytes) -> None:
    """8.9.6.4."""
    size = f"/Width 1/Height 1/ColorSpace{space}"
    key = " ".join("1 1" for _ in data)
    resources = "/XObject<</I 6 0 R>>"
    plain = middle(write_pdf(SHOW, resources=resources, more=[PRODUCT, image(size, data)]))
    keyed = image(f"{size}/Mask[{key}]", data)
    assert middle(write_pdf(SHOW, resources=resources, more=[PRODUCT, keyed])) == plain
    away = image(f"{size}/Mask[{' '.join(f'{one} {one}' for one in data)}]", data)
    assert middle(write_pdf(f"{CYAN} {SHOW}", resources=resources, more=[PRODUCT, away])) == [255, 0, 0, 0]


def test_a_page_group_that_knocks_out(write_pdf: WritePdf) -> None:
    """11.4.7: the page's group is isolated in any case, and knocks out if it says so."""
    page = "/MediaBox[0 0 100 100]/Group<</S/Transparency/K true>>"
    path = write_pdf(f"/A gs 0 1 0 0 k {ALL} 0 0 1 0 k {ALL}", resources=STATES, page=page)
    np.testing.assert_allclose(middle(path), [0, 0, 128, 0], atol=TOLERANCE)


def test_ink_in_an_isolated_rgb_group_is_a_warning(write_pdf: WritePdf) -> None:
    def warned(content: str) -> list[str]:
        group = stream(
            content.encode(),
            b"/Subtype/Form/BBox[0 0 100 100]/Group<</S/Transparency/I true/CS/DeviceRGB>>",
        )
        return kinds(page_of(write_pdf("/X Do", resources="/XObject<</X 5 0 R>>", more=[group])))

    assert warned(f"0 0 0 1 k {ALL}") == ["page-group"]
    assert warned(f"1 0 0 rg {ALL}") == []


@pytest.mark.parametrize("stated", ["/Range[-100 20 -100 30]", ""])
def test_samples_of_a_lab_image_span_its_range(write_pdf: WritePdf, stated: str) -> None:
    """8.9.5.2, table 88: the last samples are the end of the range, which is 100 where none is stated."""
    a, b = (20, 30) if stated else (100, 100)
    space, wide = LAB % stated, LAB % "/Range[-128 127 -128 127]"
    one = "/Width 1/Height 1"
    found = middle(
        write_pdf(
            SHOW, resources="/XObject<</I 5 0 R>>", more=[image(f"{one}/ColorSpace{space}", b"\x80\xff\xff")]
        )
    )
    same = image(f"{one}/ColorSpace{wide}", bytes([128, 128 + a, 128 + b]))
    assert found == middle(write_pdf(SHOW, resources="/XObject<</I 5 0 R>>", more=[same]))


def type_3(glyph: str, resources: str, *more: bytes) -> dict[str, object]:
    """Resources and objects of a font /F, whose letter A is as large as its em."""
    font = (
        "<</Type/Font/Subtype/Type3/FontBBox[0 0 1 1]/FontMatrix[1 0 0 1 0 0]/CharProcs<</a 6 0 R>>/Widths[1]"
        f"/Encoding<</Differences[65/a]>>/FirstChar 65/LastChar 65/Resources<<{resources}>>>>"
    )
    return {"resources": "/Font<</F 5 0 R>>", "more": [font.encode(), stream(glyph.encode()), *more]}


LETTER = "BT /F 100 Tf 0 0 Td (A) Tj ET"


def test_a_coloured_glyph_overprints(write_pdf: WritePdf) -> None:
    """9.6.4: what a glyph of a Type 3 font paints is painted as anything else is."""
    path = write_pdf(f"{CYAN} {LETTER}", **type_3("1 0 d0 /Q gs 0 0 0 1 k 0 0 1 1 re f", STATES))
    assert middle(path) == [255, 0, 0, 255]


BROKEN = image("/Width 64/Height 64/ColorSpace/DeviceGray/Filter/DCTDecode", b"hello" * 40)


def test_an_image_of_a_glyph_that_cannot_be_decoded_is_named(write_pdf: WritePdf) -> None:
    path = write_pdf(LETTER, **type_3("1 0 d0 /I Do", "/XObject<</I 7 0 R>>", BROKEN))
    with pytest.raises(JobError, match=r"page 1: image I \(object 7\).* cannot be decoded"):
        page_of(path)


@pytest.mark.parametrize(
    ("content", "more"),
    [
        ("/X Do", stream(b"hello" * 40, b"/Subtype/Form/BBox[0 0 100 100]/Filter/FlateDecode")),
        (SHOW.replace("/I", "/X"), image("/Width 1/Height 1/ColorSpace/DeviceGray/Filter/FooDecode", b"\0")),
        ("q 9 0 0 9 0 0 cm BI /W 9/H 9/CS/G/BPC 8/F/A85 ID !!{{}}~> EI Q", b"null"),
        (
            SHOW.replace("/I", "/X"),
            image("/Width 64/Height 64/ColorSpace/DeviceGray/Filter/ASCIIHexDecode", b"no digits"),
        ),
        (
            SHOW.replace("/I", "/X"),
            stream(
                np.random.default_rng(5).bytes(64),
                b"/Type/XObject/Subtype/Image/Width 64/Height 64/BitsPerComponent 1/ColorSpace/DeviceGray"
                b"/Filter/CCITTFaxDecode/DecodeParms<</K -1/Columns 64/Rows 64>>",
            ),
        ),
    ],
    ids=["form", "unknown filter", "inline image", "hexadecimal digits", "fax"],
)
def test_what_else_cannot_be_decoded_refuses_the_page(write_pdf: WritePdf, content: str, more: bytes) -> None:
    path = write_pdf(content, resources="/XObject<</X 5 0 R>>", more=[more])
    for _ in range(2):
        with PdfJob(path) as job, pytest.raises(JobError, match=r"page 1: .* cannot be decoded") as caught:
            job.page(1, 72)
        assert "\n" not in str(caught.value)


def test_a_font_that_clips_and_is_not_embedded_is_a_warning(write_pdf: WritePdf) -> None:
    font = "/Font<</F<</Type/Font/Subtype/Type1/BaseFont/CorporateSans>>>>"
    page = page_of(write_pdf(f"BT /F 90 Tf 7 Tr 5 20 Td (X) Tj ET {CYAN}", resources=font))
    assert kinds(page) == ["font-substituted"]


def test_an_annotation_of_an_expression_of_layers(write_pdf: WritePdf) -> None:
    """8.11.2.2: layer 5 is on, so what is visible without it is not printed."""
    appearance = "/AP<</N 6 0 R>>/OC<</Type/OCMD/VE[/Not 5 0 R]>>"
    path = write_pdf(
        "",
        page=f"/MediaBox[0 0 100 100]/Annots[<</Subtype/Stamp/F 4/Rect[0 0 100 100]{appearance}>>]",
        catalogue="/OCProperties<</OCGs[5 0 R]/D<<>>>>",
        more=[b"<</Type/OCG/Name(a)>>", stream(CYAN.encode(), b"/Subtype/Form/BBox[0 0 100 100]")],
    )
    assert middle(path) == [0, 0, 0, 0]
