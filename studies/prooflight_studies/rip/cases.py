"""Small PDFs of which ISO 32000 says what they print, in inks that no profile touches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

GOLD: Final = "/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 .2 .8 .1]/N 1>>"
RESOURCES: Final = (
    "/ExtGState<</A<</ca .5/CA .5>>/M<</BM/Multiply>>/L<</BM[/Foo/Multiply]>>/D<</BM/Darken>>"
    "/O<</op true/OP true/OPM 0>>/Q<</op true/OP true/OPM 1>>>>"
    f"/ColorSpace<</SpaceG[/Separation/Gold{GOLD}]/SpaceN[/Separation/None{GOLD}]"
    f"/SpaceK[/Separation/Black{GOLD}]/SpaceE[/Separation/All{GOLD}]/SpaceD[/DeviceN[/SpotA/SpotB]/DeviceCMYK 5 0 R]"
    "/SpaceV[/DeviceN[/Cyan/Black]/DeviceCMYK 5 0 R]/SpaceI[/Indexed/DeviceCMYK 1<00000000FF008000>]>>"
    "/XObject<</X 6 0 R/Y 7 0 R/Z 8 0 R/W 9 0 R>>"
    "/Shading<</H<</ShadingType 2/ColorSpace/DeviceCMYK/Coords[0 0 100 0]"
    "/Function<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[1 0 0 0]/N 1>>>>>>"
    "/Properties<</OC 10 0 R>>"
)
ALL: Final = "0 0 100 100 re f"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A page of 100 by 100 points, and the ink in its middle."""

    name: str
    clause: str
    """Clause of ISO 32000-2."""
    content: str
    inks: tuple[int, int, int, int]
    """C, M, Y, K. [of 255]"""
    page: str = ""
    """More entries of the page."""


CASES: Final = tuple(
    Case(name=name, clause=clause, content=content, inks=inks, page="".join(page))
    for name, clause, content, inks, *page in (
        ("DeviceCMYK", "8.6.4.4", f".2 .4 .6 .8 k {ALL}", (51, 102, 153, 204)),
        ("DeviceGray is black alone", "10.4.3", f".4 g {ALL}", (0, 0, 0, 153)),
        ("Indexed", "8.6.6.3", f"/SpaceI cs 1 scn {ALL}", (255, 0, 128, 0)),
        ("stroke", "8.5.3.2", "0 1 0 0 K 80 w 50 0 m 50 100 l S", (0, 255, 0, 0)),
        ("even-odd", "8.5.3.3.3", "1 0 0 0 k 0 0 100 100 re 20 20 60 60 re f*", (0, 0, 0, 0)),
        ("clip", "8.5.4", f"0 0 9 9 re W n 1 0 0 0 k {ALL}", (0, 0, 0, 0)),
        ("axial shading", "8.7.4.5.3", "/H sh", (129, 0, 0, 0)),
        ("Separation", "8.6.6.4", f"/SpaceG cs 1 scn {ALL}", (0, 51, 204, 26)),
        ("Separation Black", "8.6.6.4", f"/SpaceK cs .6 scn {ALL}", (0, 0, 0, 153)),
        ("Separation All", "8.6.6.4", f"/SpaceE cs .6 scn {ALL}", (153, 153, 153, 153)),
        (
            "Separation None leaves no mark",
            "8.6.6.4",
            f"1 0 0 0 k {ALL} /SpaceN cs 1 scn {ALL}",
            (255, 0, 0, 0),
        ),
        (
            "DeviceN by the transform of all colorants",
            "8.6.6.5",
            f"/SpaceD cs .8 .6 scn {ALL}",
            (0, 122, 0, 0),
        ),
        ("DeviceN of process inks", "8.6.6.5", f"/SpaceV cs .8 .6 scn {ALL}", (204, 0, 0, 153)),
        ("image in Separation Cyan", "8.6.6.4", "100 0 0 100 0 0 cm /Y Do", (128, 0, 0, 0)),
        ("image in DeviceN", "8.6.6.5", "100 0 0 100 0 0 cm /Z Do", (0, 122, 0, 0)),
        ("alternate for printing", "8.9.5.4", "100 0 0 100 0 0 cm /W Do", (255, 0, 0, 0)),
        ("knocks out", "8.6.7", f"1 0 0 0 k {ALL} 0 0 0 1 k {ALL}", (0, 0, 0, 255)),
        ("overprint mode 0", "8.6.7", f"1 0 0 0 k {ALL} /O gs 0 0 0 1 k {ALL}", (0, 0, 0, 255)),
        ("overprint mode 1", "8.6.7", f"1 0 0 0 k {ALL} /Q gs 0 0 0 1 k {ALL}", (255, 0, 0, 255)),
        (
            "a spot colour under overprint",
            "8.6.7",
            f"/SpaceG cs 1 scn {ALL} /O gs 1 0 0 0 k {ALL}",
            (255, 51, 204, 26),
        ),
        ("opacity", "11.3.6", f"/A gs 0 1 0 0 k {ALL}", (0, 128, 0, 0)),
        ("opacity in a group", "11.4.5", "/X Do", (0, 128, 0, 0)),
        (
            "fill and stroke knock each other out",
            "11.7.4.4",
            "/A gs 0 1 0 0 k 0 1 0 0 K 80 w 10 10 80 80 re B",
            (0, 128, 0, 0),
            "/Group<</S/Transparency>>",
        ),
        ("Multiply", "11.3.5.2", f"0 0 1 0 k {ALL} /M gs 1 0 0 0 k {ALL}", (255, 0, 255, 0)),
        (
            "the first known blend mode of a list",
            "11.6.3",
            f"0 0 1 0 k {ALL} /L gs 1 0 0 0 k {ALL}",
            (255, 0, 255, 0),
        ),
        (
            "an opaque page with an RGB group",
            "11.4.7",
            f"0 0 0 1 k {ALL}",
            (0, 0, 0, 255),
            "/Group<</S/Transparency/CS/DeviceRGB>>",
        ),
        (
            "a layer whose usage is not requested",
            "8.11.4.4",
            f"/OC /OC BDC 1 0 0 0 k {ALL} EMC",
            (255, 0, 0, 0),
        ),
        (
            "a link with an appearance",
            "12.5.5",
            "",
            (0, 128, 0, 0),
            "/Annots[<</Subtype/Link/F 4/Rect[0 0 100 100]/AP<</N 6 0 R>>>>]",
        ),
        ("a TrimBox without area", "14.11.2", f"1 0 0 0 k {ALL}", (255, 0, 0, 0), "/TrimBox[0 0 0 0]"),
    )
)


def case_pdf(case: Case) -> bytes:
    """Return the page as a PDF file."""
    pixel = "/Subtype/Image/Width 1/Height 1/BitsPerComponent 8/ColorSpace"
    objects = [
        "<</Type/Catalog/Pages 2 0 R/OCProperties<</OCGs[10 0 R]/D<<>>>>>>",
        "<</Type/Pages/Kids[3 0 R]/Count 1/MediaBox[0 0 100 100]>>",
        f"<</Type/Page/Parent 2 0 R/Contents 4 0 R/Resources<<{RESOURCES}>>{case.page}>>",
        _stream(case.content),
        _stream("{mul 0 exch 0 0}", "/FunctionType 4/Domain[0 1 0 1]/Range[0 1 0 1 0 1 0 1]"),
        _stream(
            f"/A gs 0 1 0 0 k {ALL}",
            "/Type/XObject/Subtype/Form/BBox[0 0 100 100]/Group<</S/Transparency>>"
            "/Resources<</ExtGState<</A<</ca .5>>>>>>",
        ),
        _stream(
            "80>",
            f"{pixel}[/Separation/Cyan/DeviceRGB<</FunctionType 2/Domain[0 1]/C0[1 1 1]/C1[0 .6 .9]/N 1>>]"
            "/Filter/ASCIIHexDecode",
        ),
        _stream("CC99>", f"{pixel}[/DeviceN[/SpotA/SpotB]/DeviceCMYK 5 0 R]/Filter/ASCIIHexDecode"),
        _stream(
            "00FF0000>",
            f"{pixel}/DeviceCMYK/Filter/ASCIIHexDecode/Alternates[<</Image 11 0 R/DefaultForPrinting true>>]",
        ),
        "<</Type/OCG/Name(a)/Usage<</Print<</PrintState/OFF>>>>>>",
        _stream("FF000000>", f"{pixel}/DeviceCMYK/Filter/ASCIIHexDecode"),
    ]
    out, offsets = bytearray(b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n"), []
    for number, body in enumerate(objects, 1):
        offsets.append(len(out))
        out += f"{number} 0 obj\n{body}\nendobj\n".encode()
    start = len(out)
    out += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n".encode()
    out += b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    return (
        bytes(out) + f"trailer<</Size {len(objects) + 1}/Root 1 0 R>>\nstartxref\n{start}\n%%EOF\n".encode()
    )


def _stream(data: str, entries: str = "") -> str:
    return f"<<{entries}/Length {len(data)}>>stream\n{data}\nendstream"
