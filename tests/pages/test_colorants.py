"""Separation and DeviceN spaces on a press of four inks, wherever a page names them, in fills, images and gradients."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from PIL import Image, ImageCms
from tests.pages.conftest import pdf_bytes, stream
from tests.stand_ins import cmyk_profile

from prooflight.errors import JobError
from prooflight.pages.pdf.rip import PdfJob

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    WritePdf = Callable[..., Path]

FILL = " scn 0 0 100 100 re f"
OVERPRINT = "/ExtGState<</N<</op true/OPM 0>>>>"


def blend(ends: str, alternate: str = "/DeviceCMYK", name: str = "Gold") -> str:
    start = {"/DeviceCMYK": "0 0 0 0", "/DeviceRGB": "1 1 1", "/DeviceGray": "1"}[alternate]
    return f"[/Separation/{name} {alternate}<</FunctionType 2/Domain[0 1]/C0[{start}]/C1[{ends}]/N 1>>]"


def calculator(body: str, inputs: int, outputs: int) -> bytes:
    return stream(
        f"{{{body}}}".encode(),
        f"/FunctionType 4/Domain[{'0 1 ' * inputs}]/Range[{'0 1 ' * outputs}]".encode(),
    )


def image(space: str, data: bytes, width: int = 1) -> bytes:
    entries = f"/Subtype/Image/Width {width}/Height 1/ColorSpace{space}/BitsPerComponent 8"
    return stream(data, entries.encode())


def rip(path: Path, profile: Path | None = None) -> NDArray[np.int64]:
    with PdfJob(path, profile=profile) as job:
        return job.page(1, 72).cmyk.astype(np.int64)


GOLD = [0, 51, 204, 26]


@pytest.mark.parametrize(
    "where", ["pages", "form", "pattern", "Type 3 font", "appearance", "soft mask beside"]
)
def test_a_spot_colour_prints_wherever_it_is_named(tmp_path: Path, where: str) -> None:
    spaces = f"<</ColorSpace<</S{blend('0 .2 .8 .1')}>>>>"
    paint, more, page, inherited = "/S cs 1" + FILL, [b"null"], "", ""
    resources = ""
    if where == "pages":
        inherited = f"/Resources{spaces}"
    elif where == "form":
        more = [stream(paint.encode(), f"/Subtype/Form/BBox[0 0 100 100]/Resources{spaces}".encode())]
        paint, resources = "/X Do", "/Resources<</XObject<</X 5 0 R>>>>"
    elif where == "pattern":
        entries = (
            f"/PatternType 1/PaintType 1/TilingType 1/BBox[0 0 100 100]/XStep 100/YStep 100/Resources{spaces}"
        )
        more = [stream(paint.encode(), entries.encode())]
        paint, resources = f"/Pattern cs /P{FILL}", "/Resources<</Pattern<</P 5 0 R>>>>"
    elif where == "Type 3 font":
        glyph = stream(b"1000 0 d0 /S cs 1 scn 0 0 1000 1000 re f")
        font = (
            "/Type/Font/Subtype/Type3/FontBBox[0 0 1000 1000]/FontMatrix[.001 0 0 .001 0 0]/CharProcs<</a 5 0 R>>"
            f"/Encoding<</Differences[97/a]>>/FirstChar 97/LastChar 97/Widths[1000]/Resources{spaces}"
        )
        more, resources = [glyph], f"/Resources<</Font<</F<<{font}>>>>>>"
        paint = "BT /F 100 Tf (a) Tj ET"
    elif where == "appearance":
        more = [stream(paint.encode(), f"/Subtype/Form/BBox[0 0 100 100]/Resources{spaces}".encode())]
        paint, page = "", "/Annots[<</Subtype/Stamp/F 4/Rect[0 0 100 100]/AP<</N 5 0 R>>>>]"
    else:
        mask = stream(
            b"1 g 0 0 100 100 re f", b"/Subtype/Form/BBox[0 0 100 100]/Group<</S/Transparency/CS/DeviceGray>>"
        )
        more = [mask]
        own = spaces[:-2] + "/ExtGState<</M<</SMask<</S/Luminosity/G 5 0 R>>>>>>>>"
        paint, resources = "/M gs " + paint, f"/Resources{own}"
    path = tmp_path / "job.pdf"
    path.write_bytes(
        pdf_bytes(
            [
                b"<</Type/Catalog/Pages 2 0 R>>",
                f"<</Type/Pages/Kids[3 0 R]/Count 1/MediaBox[0 0 100 100]{inherited}>>".encode(),
                f"<</Type/Page/Parent 2 0 R/Contents 4 0 R{resources}{page}>>".encode(),
                stream(paint.encode()),
                *more,
            ]
        )
    )
    np.testing.assert_allclose(rip(path)[50, 50], GOLD, atol=1)


@pytest.mark.parametrize("name", ["P", "A", "Dest", "Parent", "Kids", "Type"])
def test_a_space_of_any_name(write_pdf: WritePdf, name: str) -> None:
    job = write_pdf(f"/{name} cs 1{FILL}", resources=f"/ColorSpace<</{name}{blend('0 .2 .8 .1')}>>")
    assert rip(job)[50, 50].tolist() == GOLD


def test_two_separations_of_one_name_keep_their_transforms(write_pdf: WritePdf) -> None:
    spaces = f"/ColorSpace<</A{blend('1 0 0 0')}/B{blend('0 1 0 0')}/C{blend('1 0 0 0')}>>"
    cmyk = rip(
        write_pdf(
            "/A cs 1 scn 0 0 50 100 re f /B cs .4 scn 50 0 50 100 re f /C cs 1 scn 0 0 9 9 re f",
            resources=spaces,
        )
    )
    assert cmyk[5, 25].tolist() == [255, 0, 0, 0]
    assert cmyk[5, 75].tolist() == [0, 102, 0, 0]
    assert cmyk[95, 5].tolist() == [255, 0, 0, 0]


@pytest.mark.parametrize("form", ["fill", "image", "indexed", "gradient"])
@pytest.mark.parametrize("colorants", ["[/SpotA/SpotB]", "[/Cyan/SpotB]", "[/SpotA/All]"])
@pytest.mark.parametrize("alternate", ["/DeviceCMYK", "/DeviceGray"])
def test_device_n_by_the_transform_of_all_its_colorants(
    write_pdf: WritePdf, form: str, colorants: str, alternate: str
) -> None:
    """a b -> 1 - ab in grey, and 0 ab 0 0 in ink, which no sum over colorants is; a = 0.8, b = 0.6."""
    body = "mul 1 exch sub" if alternate == "/DeviceGray" else "mul 0 exch 0 0"
    space = f"[/DeviceN{colorants}{alternate} 5 0 R]"
    more = [calculator(body, 2, 1 if alternate == "/DeviceGray" else 4), image(space, bytes([204, 153]))]
    content, drawn = f"/S cs .8 .6{FILL}", ""
    spaces = f"/ColorSpace<</S{space}/G{blend('0 .2 .8 .1', name='SpotA')}>>"
    if form == "image":
        content, drawn = "100 0 0 100 0 0 cm /I Do", "/XObject<</I 6 0 R>>"
    elif form == "indexed":
        content, spaces = f"/S cs 1{FILL}", f"/ColorSpace<</S[/Indexed{space}1<0000CC99>]>>"
    elif form == "gradient":
        steady = "<</FunctionType 2/Domain[0 1]/C0[.8 .6]/C1[.8 .6]/N 1>>"
        drawn = f"/Shading<</H<</ShadingType 2/ColorSpace{space}/Coords[0 0 100 0]/Function {steady}>>>>"
        content = "/H sh"
    inks = rip(write_pdf(content, resources=spaces + drawn, more=more))[50, 50]
    expected = [0, 0, 0, 122] if alternate == "/DeviceGray" else [0, 122, 0, 0]  # 255 * 0.48
    np.testing.assert_allclose(inks, expected, atol=1)


@pytest.mark.parametrize("form", ["fill", "image"])
def test_an_additive_device_n(write_pdf: WritePdf, form: str) -> None:
    """Lightness alone is kept: 1 is paper, by whatever else is asked for."""
    space = "[/DeviceN[/L/A/B]/DeviceGray 5 0 R]"
    more = [calculator("pop pop", 3, 1), image(space, bytes([255, 128, 128, 51, 128, 128]), width=2)]
    content = "/D cs 1 .5 .5 scn 0 0 50 100 re f .2 .5 .5 scn 50 0 50 100 re f"
    if form == "image":
        content = "100 0 0 100 0 0 cm /I Do"
    cmyk = rip(write_pdf(content, resources=f"/ColorSpace<</D{space}>>/XObject<</I 6 0 R>>", more=more))
    assert not cmyk[50, 25].any()
    assert cmyk[50, 75].tolist() == [0, 0, 0, 204]


@pytest.mark.parametrize("form", ["fill", "stroke", "text", "image", "gradient", "DeviceN", "stencil"])
@pytest.mark.parametrize("state", ["", "/N gs "])
def test_none_leaves_no_mark(write_pdf: WritePdf, form: str, state: str) -> None:
    space = blend("0 1 1 0", name="None")
    function = "<</FunctionType 2/Domain[0 1]/C0[1]/C1[1]/N 1>>"
    paint = {
        "fill": f"/S cs 1{FILL}",
        "stroke": "/S CS 1 SCN 50 w 0 50 m 100 50 l S",
        "text": "/S cs 1 scn BT /F 90 Tf 20 20 Td (I) Tj ET",
        "image": "100 0 0 100 0 0 cm /I Do",
        "gradient": "/H sh",
        "DeviceN": f"/D cs 1 1{FILL}",
        "stencil": "/S cs 1 scn 100 0 0 100 0 0 cm /M Do",
    }[form]
    more = [
        image(space, b"\xff"),
        calculator("pop pop 0 1 0 0", 2, 4),
        stream(b"\0", b"/Subtype/Image/Width 1/Height 1/ImageMask true/BitsPerComponent 1"),
    ]
    resources = (
        f"/ColorSpace<</S{space}/D[/DeviceN[/None/None]/DeviceCMYK 6 0 R]>>/XObject<</I 5 0 R/M 7 0 R>>{OVERPRINT}"
        f"/Shading<</H<</ShadingType 2/ColorSpace{space}/Coords[0 0 100 0]/Function{function}>>>>"
        "/Font<</F<</Type/Font/Subtype/Type1/BaseFont/Helvetica>>>>"
    )
    cmyk = rip(write_pdf(f"1 0 0 0 k 0 0 100 100 re f {state}{paint}", resources=resources, more=more))
    assert (cmyk == [255, 0, 0, 0]).all()


@pytest.mark.parametrize("alternate", ["/DeviceCMYK", "/DeviceRGB", "/DeviceGray"])
@pytest.mark.parametrize("form", ["fill", "image", "indexed image"])
@pytest.mark.parametrize(
    ("name", "expected"), [("All", [153] * 4), ("Cyan", [153, 0, 0, 0]), ("Black", [0, 0, 0, 153])]
)
def test_colorants_that_the_press_has_are_printed_as_such(
    write_pdf: WritePdf, alternate: str, form: str, name: str, expected: list[int]
) -> None:
    """By no alternate, and over a spot colour, which they knock out."""
    ends = {"/DeviceCMYK": "0 1 0 0", "/DeviceRGB": "0 .6 .9", "/DeviceGray": "0"}[alternate]
    space = blend(ends, alternate, name)
    paint, drawn = f"/S cs .6{FILL}", image(space, bytes([153]))
    if form == "indexed image":
        drawn = image(f"[/Indexed{space}1<0099>]", b"\1")
    if form != "fill":
        paint = "100 0 0 100 0 0 cm /I Do"
    job = write_pdf(
        f"/G cs 1{FILL} {paint}",
        resources=f"/ColorSpace<</S{space}/G{blend('0 .2 .8 .1')}>>/XObject<</I 5 0 R>>",
        more=[drawn],
    )
    assert rip(job)[50, 50].tolist() == expected


def test_an_image_in_a_process_colorant_overprints(write_pdf: WritePdf) -> None:
    job = write_pdf(
        "0 .6 0 0 k 0 0 100 100 re f /N gs 100 0 0 100 0 0 cm /I Do",
        resources=f"/XObject<</I 5 0 R>>{OVERPRINT}",
        more=[image(blend("0 .6 .9", "/DeviceRGB", "Cyan"), bytes([128]))],
    )
    assert rip(job)[50, 50].tolist() == [128, 153, 0, 0]


@pytest.mark.parametrize(("listed", "painted"), [(64, 1), (64, 0), (30, 30), (70, 60)])
def test_many_spot_colours(write_pdf: WritePdf, listed: int, painted: int) -> None:
    """Each over the one before, which it knocks out, and one over all of them, which it leaves alone."""
    spaces = "".join(f"/S{i}{blend(f'{i / 100:.2f} 0 0 0', name=f'Spot{i}')}" for i in range(listed))
    paint = "".join(f"/S{i} cs 1 scn {i} 0 {100 - i} 100 re f " for i in range(painted))
    over = f"/N gs /S{painted - 1} cs 1 scn 0 0 100 20 re f" if painted > 1 else ""
    cmyk = rip(write_pdf(paint + over, resources=f"/ColorSpace<<{spaces}>>{OVERPRINT}"))
    expected = np.rint(255 * np.minimum(np.arange(100), max(painted - 1, 0)) / 100)
    np.testing.assert_allclose(cmyk[50, :, 0], expected, atol=1)
    assert not cmyk[..., 1:].any()
    if painted > 1:
        last = 255 * (painted - 1) / 100
        np.testing.assert_allclose(
            cmyk[90, : painted - 1, 0], np.minimum(expected[: painted - 1] + last, 255), atol=1
        )


def test_many_spot_colours_in_one_nchannel_space_are_refused(write_pdf: WritePdf) -> None:
    names = [f"Spot{i}" for i in range(30)]
    own = "".join(f"/{name}{blend('1 0 0 0', name=name)}" for name in names)
    colorants = "".join(f"/{name}" for name in names)
    space = f"[/DeviceN[{colorants}]/DeviceCMYK 5 0 R<</Subtype/NChannel/Colorants<<{own}>>>>]"
    job = write_pdf(
        f"/S cs {'1 ' * 30}{FILL}",
        resources=f"/ColorSpace<</S{space}>>",
        more=[calculator("pop " * 30 + "0 0 0 0", 30, 4)],
    )
    with pytest.raises(JobError, match="page 1: it has 30 spot colours, some of them in one NChannel space"):
        rip(job)


def test_a_mesh_blends_in_its_own_colours(write_pdf: WritePdf, tmp_path: Path) -> None:
    """From red on the left to blue on the right."""
    profile = tmp_path / "press.icc"
    profile.write_bytes(cmyk_profile())
    corners = [(0, 0, 0), (0, 255, 0), (255, 0, 1), (255, 255, 1)]  # x, y, blue
    order = [0, 1, 2, 1, 2, 3]
    data = b"".join(
        bytes([0, corners[i][0], corners[i][1], 255 * (1 - corners[i][2]), 0, 255 * corners[i][2]])
        for i in order
    )
    entries = (
        b"/ShadingType 4/ColorSpace/DeviceRGB/BitsPerCoordinate 8/BitsPerComponent 8/BitsPerFlag 8"
        b"/Decode[0 100 0 100 0 1 0 1 0 1]"
    )
    job = write_pdf("/S sh", resources="/Shading<</S 5 0 R>>", more=[stream(data, entries)])
    cmyk = rip(job, profile)
    link = ImageCms.buildTransform(
        ImageCms.createProfile("sRGB"),
        str(profile),
        "RGB",
        "CMYK",
        ImageCms.Intent.RELATIVE_COLORIMETRIC,
        ImageCms.Flags.BLACKPOINTCOMPENSATION | ImageCms.Flags.NOOPTIMIZE,
    )
    blue = (np.arange(100) + 0.5) / 100
    rgb = np.rint(255 * np.stack([1 - blue, 0 * blue, blue], axis=1)).astype(np.uint8)
    expected = np.asarray(ImageCms.applyTransform(Image.fromarray(rgb[None]), link))[0].astype(np.int64)
    np.testing.assert_allclose(
        cmyk[50, 2:-2], expected[2:-2], atol=4
    )  # a step of 255, and MuPDF's half a pixel


@pytest.mark.parametrize("order", ["PDF/X first", "PDF/X last", "PDF/X without a profile"])
def test_the_intent_of_pdf_x_decides(write_pdf: WritePdf, order: str) -> None:
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    given = cmyk_profile(gamma=2.4, black=0.3)
    entry = "<</S/GTS_{0}/OutputConditionIdentifier(x)/DestOutputProfile {1} 0 R>>"
    archive, press = entry.format("PDFA1", 5), entry.format("PDFX", 6)
    intents = press + archive if order == "PDF/X first" else archive + press
    more = [stream(srgb, b"/N 3"), stream(given, b"/N 4")]
    content = "1 .5 0 rg 0 0 100 100 re f"
    alone = rip(write_pdf(content, catalogue=f"/OutputIntents[{press}]", more=more))[50, 50].tolist()
    if order == "PDF/X without a profile":
        intents = archive + press.replace("/DestOutputProfile 6 0 R", "")
        alone = rip(write_pdf(content, catalogue=f"/OutputIntents[{archive}]", more=more))[50, 50].tolist()
    assert (
        rip(write_pdf(content, catalogue=f"/OutputIntents[{intents}]", more=more))[50, 50].tolist() == alone
    )
