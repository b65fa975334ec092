"""Transparency prints what ISO 32000 says: opacity in every kind of group, and ink that a group need not convert."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from PIL import ImageCms
from tests.pages.conftest import stream
from tests.stand_ins import cmyk_profile

from prooflight.pages.pdf.rip import PdfJob

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    WritePdf = Callable[..., Path]

STATES = (
    "/ExtGState<</A<</ca .5/CA .5>>/B<</ca .3/CA .7>>/M<</BM/Multiply>>/T<</TK false/ca .5>>/O<</op true>>>>"
)
SPOT = "/ColorSpace<</S[/Separation/Gold/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 .2 .8 .1]/N 1>>]>>"
FONT = "/Font<</F<</Type/Font/Subtype/Type1/BaseFont/Helvetica-Bold>>>>"
SQUARE = "0 1 0 0 k 0 1 0 0 K 8 w 20 20 60 60 re"
HALF = 2
"""Steps of 255 that opacity of 8 bits costs in a group in a group."""


def rip(path: Path, profile: Path | None = None) -> NDArray[np.int64]:
    with PdfJob(path, profile=profile) as job:
        return job.page(1, 72).cmyk.astype(np.int64)


def form(content: str, group: str, resources: str = STATES) -> bytes:
    entries = f"/Type/XObject/Subtype/Form/BBox[0 0 100 100]{group}/Resources<<{resources}>>"
    return stream(content.encode(), entries.encode())


GROUPS = {
    "not isolated": "/Group<</S/Transparency>>",
    "isolated": "/Group<</S/Transparency/I true>>",
    "knockout": "/Group<</S/Transparency/K true>>",
    "isolated knockout": "/Group<</S/Transparency/I true/K true>>",
    "none": "",
}


@pytest.mark.parametrize("kind", GROUPS)
@pytest.mark.parametrize("operator", ["f", "S", "B", "text"])
@pytest.mark.parametrize("outer", ["", "/M gs ", "/A gs "])
def test_opacity_in_a_group(write_pdf: WritePdf, kind: str, operator: str, outer: str) -> None:
    """On bare paper, where no kind of group differs from another; half as much where the group is half opaque, too."""
    paint = "0 1 0 0 k BT /F 90 Tf 20 20 Td (I) Tj ET" if operator == "text" else f"{SQUARE} {operator}"
    job = write_pdf(
        f"{outer}/X Do",
        resources=f"{STATES}/XObject<</X 5 0 R>>",
        more=[form(f"/A gs {paint}", GROUPS[kind], STATES + FONT)],
    )
    painted = rip(job)[..., 1]
    twice = outer.startswith("/A") and kind != "none"
    assert np.abs(painted.max() - (64 if twice else 128)) <= HALF
    assert set(np.unique(painted)) <= {0, int(painted.max())}  # what overlaps is knocked out, not added


@pytest.mark.parametrize(
    "where", ["/Group<</S/Transparency>>", "/Group<</S/Transparency/CS/DeviceCMYK>>", ""]
)
def test_fill_and_stroke_of_a_page(write_pdf: WritePdf, where: str) -> None:
    job = write_pdf(
        "0 0 .4 0 k 0 0 100 100 re f /B gs 1 0 0 0 k 0 1 0 0 K 10 w 20 20 60 60 re B",
        resources=STATES,
        page=f"/MediaBox[0 0 100 100]{where}",
    )
    cmyk = rip(job)
    np.testing.assert_allclose(cmyk[50, 50], [77, 0, 71, 0], atol=HALF)
    np.testing.assert_allclose(cmyk[50, 20], [0, 179, 31, 0], atol=HALF)
    assert cmyk[5, 5].tolist() == [0, 0, 102, 0]


@pytest.mark.parametrize("kind", ["not isolated", "isolated"])
@pytest.mark.parametrize("subtype", ["Alpha", "Luminosity"])
def test_soft_masks(write_pdf: WritePdf, kind: str, subtype: str) -> None:
    grey = GROUPS[kind].replace(">>", "/CS/DeviceGray>>")
    ink = "/A gs 1 g" if subtype == "Luminosity" else "/A gs 0 g"
    mask = f"/ExtGState<</SM<</SMask<</Type/Mask/S/{subtype}/G 5 0 R>>>>>>"
    job = write_pdf(
        "/SM gs 1 0 0 0 k 0 0 100 100 re f", resources=mask, more=[form(f"{ink} 0 0 50 100 re f", grey)]
    )
    cmyk = rip(job)
    np.testing.assert_allclose(cmyk[50, 25], [128, 0, 0, 0], atol=HALF)
    assert not cmyk[50, 75].any()


def test_a_page_without_opacity_is_sharp(write_pdf: WritePdf) -> None:
    """The same pixels are inside a shape, whether it is opaque or not."""
    shape = "1 0 0 0 k 1 0 0 0 K 3 90 m 97 70 l 50 13 l f 10 10 m 60 33 l S BT /F 40 Tf 5 40 Td (Rag) Tj ET"
    opaque, half = (rip(write_pdf(f"{state}{shape}", resources=STATES + FONT)) for state in ("", "/A gs "))
    assert set(np.unique(opaque[..., 0])) == {0, 255}
    np.testing.assert_array_equal(opaque[..., 0] > 0, half[..., 0] > 0)


def intent(profile: bytes, kind: str = "PDFA1") -> tuple[str, bytes]:
    colours = 4 if profile[16:20] == b"CMYK" else 3
    entry = f"<</S/GTS_{kind}/OutputConditionIdentifier(x)/DestOutputProfile 5 0 R>>"
    return f"/OutputIntents[{entry}]", stream(profile, b"/N %d" % colours)


SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
INKS = "0 0 0 1 k 0 0 50 100 re f 0 g 50 0 50 50 re f 1 0 0 0 k 50 50 50 50 re f"


@pytest.mark.parametrize("colours", ["RGB", "CMYK"])
@pytest.mark.parametrize(
    "by", ["unused blend mode", "form with a group", "page group without colours", "blending"]
)
def test_no_output_intent_touches_native_ink(
    write_pdf: WritePdf, tmp_path: Path, colours: str, by: str
) -> None:
    given, other = cmyk_profile(), cmyk_profile(gamma=2.4, black=0.3)
    profile = tmp_path / "press.icc"
    profile.write_bytes(given)
    catalogue, stored = intent(SRGB if colours == "RGB" else other)
    content, page = INKS, "/MediaBox[0 0 100 100]"
    if by == "form with a group":
        content = "/X Do"
    elif by == "page group without colours":
        page += "/Group<</S/Transparency>>"
    elif by == "blending":
        content = f"{INKS} /M gs 0 0 0 0 k 0 0 100 100 re f"
    job = write_pdf(
        content,
        resources=f"{STATES}/XObject<</X 6 0 R>>",
        page=page,
        catalogue=catalogue,
        more=[stored, form(INKS, GROUPS["not isolated"])],
    )
    cmyk = rip(job, profile)
    assert cmyk[50, 25].tolist() == [0, 0, 0, 255]
    assert cmyk[75, 75].tolist() == [0, 0, 0, 255]
    assert cmyk[25, 75].tolist() == [255, 0, 0, 0]


RGB_PAGE = "/MediaBox[0 0 100 100]/Group<</S/Transparency/CS/DeviceRGB>>"


def test_an_rgb_page_group_matters_to_what_is_transparent_alone(write_pdf: WritePdf) -> None:
    cmyk = rip(write_pdf(INKS, resources=STATES, page=RGB_PAGE))
    assert cmyk[50, 25].tolist() == [0, 0, 0, 255]
    assert cmyk[25, 75].tolist() == [255, 0, 0, 0]
    path = write_pdf(f"{INKS} /A gs 5 5 10 10 re f", resources=STATES, page=RGB_PAGE)
    with PdfJob(path) as job:
        blended = job.page(1, 72)
    assert blended.cmyk[50, 25].astype(bool).sum() > 1  # black became a colour of RGB, and four inks of that
    assert [warning.kind for warning in blended.warnings] == ["page-group"]


def test_overprint_leaves_a_spot_colour_alone_on_an_rgb_page(write_pdf: WritePdf) -> None:
    content = "/S cs 1 scn 0 0 100 100 re f /O gs 1 0 0 0 k 20 20 60 60 re f"
    cmyk = rip(write_pdf(content, resources=STATES + SPOT, page=RGB_PAGE))
    assert cmyk[5, 5].tolist() == [0, 51, 204, 26]
    assert cmyk[50, 50].tolist() == [255, 51, 204, 26]


@pytest.mark.parametrize(
    ("modes", "blends"), [("/Foo/Multiply", True), ("/Foo", False), ("/Normal/Multiply", False)]
)
def test_of_a_list_of_blend_modes_the_first_known_counts(
    write_pdf: WritePdf, modes: str, blends: bool
) -> None:
    job = write_pdf(
        "0 0 1 0 k 0 0 100 100 re f /L gs 1 0 0 0 k 20 20 60 60 re f",
        resources=f"/ExtGState<</L<</BM[{modes}]>>>>",
    )
    assert rip(job)[50, 50].tolist() == [255, 0, 255 if blends else 0, 0]


@pytest.mark.parametrize(("state", "darkest"), [("/A", 128), ("/T", 191)])
def test_glyphs_of_a_text_knock_each_other_out(write_pdf: WritePdf, state: str, darkest: int) -> None:
    resources = STATES if state == "/T" else STATES.replace("/TK false", "")
    text = f"BT {state} gs 1 0 0 0 k /F 100 Tf -20 Tc 10 20 Td (II) Tj ET"
    assert abs(rip(write_pdf(text, resources=resources + FONT))[..., 0].max() - darkest) <= HALF
