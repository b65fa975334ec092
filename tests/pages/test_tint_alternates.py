"""Spot colours print what their tint transform gives in their alternate space, whatever space that is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from PIL import ImageCms

from prooflight.pages.pdf.rip import PdfJob

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    WritePdf = Callable[..., Path]

FILL = " scn 0 0 100 100 re f"


def stream(data: bytes, entries: str) -> bytes:
    return f"<<{entries}/Length {len(data)}>>stream\n".encode() + data + b"\nendstream"


def profile(name: str) -> bytes:
    return ImageCms.ImageCmsProfile(ImageCms.createProfile(name)).tobytes()


LAB = "[/Lab<</WhitePoint[0.9642 1 0.8249]/Range[-128 127 -128 127]>>]"
ALTERNATES: dict[str, tuple[str, list[float], list[float], bytes]] = {
    "Lab": (LAB, [100, 0, 0], [50, 20, 60], b"null"),
    "ICC Lab": (
        "[/ICCBased 5 0 R]",
        [100, 0, 0],
        [50, 20, 60],
        stream(profile("LAB"), f"/N 3/Alternate {LAB}"),
    ),
    "ICC RGB": ("[/ICCBased 5 0 R]", [1, 1, 1], [0.5, 0.2, 0.1], stream(profile("sRGB"), "/N 3")),
    "CalRGB": (
        "[/CalRGB<</WhitePoint[0.9505 1 1.089]/Gamma[2.2 2.2 2.2]>>]",
        [1, 1, 1],
        [0.5, 0.2, 0.1],
        b"null",
    ),
    "CalGray": ("[/CalGray<</WhitePoint[0.9505 1 1.089]>>]", [1], [0.25], b"null"),
    "RGB": ("/DeviceRGB", [1, 1, 1], [0.5, 0.2, 0.1], b"null"),
    "grey": ("/DeviceGray", [1], [0.25], b"null"),
    "CMYK": ("/DeviceCMYK", [0, 0, 0, 0], [0.1, 0.2, 0.3, 0.4], b"null"),
}
TINT = 0.4  # 102 of 255, a whole number


def numbers(values: list[float]) -> str:
    return " ".join(f"{value:.6f}" for value in values)


def middle(path: Path) -> list[int]:
    with PdfJob(path) as job:
        return job.page(1, 72).cmyk[50, 50].astype(int).tolist()


@pytest.mark.parametrize("kind", ALTERNATES)
@pytest.mark.parametrize("form", ["fill", "image", "indexed", "DeviceN", "NChannel", "stitched", "sampled"])
def test_a_tint_is_its_alternate_colour(write_pdf: WritePdf, kind: str, form: str) -> None:
    space, white, full, profile_object = ALTERNATES[kind]
    colour = [start + TINT * (end - start) for start, end in zip(white, full, strict=True)]
    spaces = f"/ColorSpace<</A {space}>>"
    direct = write_pdf(f"/A cs {numbers(colour)}{FILL}", resources=spaces, more=[profile_object])
    expected = middle(direct)
    blend = f"<</FunctionType 2/Domain[0 1]/C0[{numbers(white)}]/C1[{numbers(full)}]/N 1>>"
    more, content, drawn = [profile_object], f"/S cs {TINT}{FILL}", ""
    spot = f"[/Separation/Gold {space}{blend}]"
    limits = " ".join(f"{min(pair):g} {max(pair):g}" for pair in zip(white, full, strict=True))
    if form == "image":
        more.append(
            stream(bytes([102]), f"/Subtype/Image/Width 1/Height 1/ColorSpace{spot}/BitsPerComponent 8")
        )
        content, drawn = "100 0 0 100 0 0 cm /I Do", "/XObject<</I 6 0 R>>"
    elif form == "indexed":
        spot, content = f"[/Indexed{spot}1<0066>]", f"/S cs 1{FILL}"
    elif form in ("DeviceN", "NChannel"):  # the second colorant changes nothing
        steps = [
            f"{i} index {end - start:.6f} mul {start:.6f} add"
            for i, (start, end) in enumerate(zip(white, full, strict=True))
        ]
        turned = f"{len(white) + 1} {len(white)} roll pop"
        more.append(
            stream(
                f"{{pop {' '.join(steps)} {turned}}}".encode(),
                f"/FunctionType 4/Domain[0 1 0 1]/Range[{limits}]",
            )
        )
        own = f"<</Subtype/NChannel/Colorants<</Gold {spot}>>>>" if form == "NChannel" else ""
        spot, content = f"[/DeviceN[/Gold/None]{space} 6 0 R{own}]", f"/S cs {TINT} 1{FILL}"
    elif form == "stitched":
        stitched = f"<</FunctionType 3/Domain[0 1]/Functions[{blend}]/Bounds[]/Encode[0 1]>>"
        spot = f"[/Separation/Gold {space}{stitched}]"
    elif form == "sampled":
        entries = f"/FunctionType 0/Domain[0 1]/Range[{limits}]/Size[2]/BitsPerSample 8"
        rising = bytes(255 * (end > start) for start, end in zip(white, full, strict=True))
        more.append(stream(bytes(255 - value for value in rising) + rising, entries))
        spot = f"[/Separation/Gold {space} 6 0 R]"
    job = write_pdf(content, resources=f"/ColorSpace<</S {spot}>>{drawn}", more=more)
    # a* and b* are rounded to whole numbers before they are converted, and MuPDF's own link is coarse
    np.testing.assert_allclose(middle(job), expected, atol=3)


@pytest.mark.parametrize("alternate", [LAB, "/DeviceCMYK"])
def test_all_is_each_ink_and_none_is_none(write_pdf: WritePdf, alternate: str) -> None:
    ends = ("100 0 0", "0 0 0") if alternate == LAB else ("0 0 0 0", "1 1 1 1")
    blend = f"<</FunctionType 2/Domain[0 1]/C0[{ends[0]}]/C1[{ends[1]}]/N 1>>"
    for name, expected in (("All", [102] * 4), ("None", [0] * 4), ("Cyan", [102, 0, 0, 0])):
        spaces = f"/ColorSpace<</S[/Separation/{name} {alternate}{blend}]>>"
        assert middle(write_pdf(f"/S cs {TINT}{FILL}", resources=spaces)) == expected, name


BLEND = "<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 0.5 1 0]/N 1>>"


@pytest.mark.parametrize("name", ["F#e4rbe", "#ff#fe", "Gr#C3#BCn", "A#20B"])
def test_names_are_bytes(write_pdf: WritePdf, name: str) -> None:
    spaces = f"/ColorSpace<</S{name}[/Separation/{name}/DeviceCMYK{BLEND}]>>"
    assert middle(write_pdf(f"/S{name} cs {TINT}{FILL}", resources=spaces)) == [0, 51, 102, 0]


def test_a_broken_space_that_nothing_is_painted_in(write_pdf: WritePdf) -> None:
    broken = f"/T[/Separation/Red/F#e4rbe{BLEND}]/U[/DeviceN[/B#e4]/#e4 9 0 R]"
    spaces = f"/ColorSpace<<{broken}/S[/Separation/Gold/DeviceCMYK{BLEND}]>>"
    assert middle(write_pdf(f"/S cs {TINT}{FILL}", resources=spaces)) == [0, 51, 102, 0]


def test_spaces_nested_deeper_than_a_stack(write_pdf: WritePdf) -> None:
    chain = [b"[%d 0 R]" % (6 + n) for n in range(5000)] + [b"null"]
    spaces = f"/X 5 0 R/ColorSpace<</S[/Separation/Gold/DeviceCMYK{BLEND}]>>"
    assert middle(write_pdf(f"/S cs {TINT}{FILL}", resources=spaces, more=chain)) == [0, 51, 102, 0]
