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


CASES: Final = (
    Case(name="DeviceCMYK", clause="8.6.4.4", content=f".2 .4 .6 .8 k {ALL}", inks=(51, 102, 153, 204)),
    Case(name="DeviceGray is black alone", clause="10.4.3", content=f".4 g {ALL}", inks=(0, 0, 0, 153)),
    Case(name="Indexed", clause="8.6.6.3", content=f"/SpaceI cs 1 scn {ALL}", inks=(255, 0, 128, 0)),
    Case(name="stroke", clause="8.5.3.2", content="0 1 0 0 K 80 w 50 0 m 50 100 l S", inks=(0, 255, 0, 0)),
    Case(
        name="even-odd",
        clause="8.5.3.3.3",
        content="1 0 0 0 k 0 0 100 100 re 20 20 60 60 re f*",
        inks=(0, 0, 0, 0),
    ),
    Case(name="clip", clause="8.5.4", content=f"0 0 9 9 re W n 1 0 0 0 k {ALL}", inks=(0, 0, 0, 0)),
    Case(name="axial shading", clause="8.7.4.5.3", content="/H sh", inks=(129, 0, 0, 0)),
    Case(name="Separation", clause="8.6.6.4", content=f"/SpaceG cs 1 scn {ALL}", inks=(0, 51, 204, 26)),
    Case(name="Separation Black", clause="8.6.6.4", content=f"/SpaceK cs .6 scn {ALL}", inks=(0, 0, 0, 153)),
    Case(
        name="Separation All", clause="8.6.6.4", content=f"/SpaceE cs .6 scn {ALL}", inks=(153, 153, 153, 153)
    ),
    Case(
        name="Separation None leaves no mark",
        clause="8.6.6.4",
        content=f"1 0 0 0 k {ALL} /SpaceN cs 1 scn {ALL}",
        inks=(255, 0, 0, 0),
    ),
    Case(
        name="DeviceN by the transform of all colorants",
        clause="8.6.6.5",
        content=f"/SpaceD cs .8 .6 scn {ALL}",
        inks=(0, 122, 0, 0),
    ),
    Case(
        name="DeviceN of process inks",
        clause="8.6.6.5",
        content=f"/SpaceV cs .8 .6 scn {ALL}",
        inks=(204, 0, 0, 153),
    ),
    Case(
        name="image in Separation Cyan",
        clause="8.6.6.4",
        content="100 0 0 100 0 0 cm /Y Do",
        inks=(128, 0, 0, 0),
    ),
    Case(name="image in DeviceN", clause="8.6.6.5", content="100 0 0 100 0 0 cm /Z Do", inks=(0, 122, 0, 0)),
    Case(
        name="alternate for printing",
        clause="8.9.5.4",
        content="100 0 0 100 0 0 cm /W Do",
        inks=(255, 0, 0, 0),
    ),
    Case(name="knocks out", clause="8.6.7", content=f"1 0 0 0 k {ALL} 0 0 0 1 k {ALL}", inks=(0, 0, 0, 255)),
    Case(
        name="overprint mode 0",
        clause="8.6.7",
        content=f"1 0 0 0 k {ALL} /O gs 0 0 0 1 k {ALL}",
        inks=(0, 0, 0, 255),
    ),
    Case(
        name="overprint mode 1",
        clause="8.6.7",
        content=f"1 0 0 0 k {ALL} /Q gs 0 0 0 1 k {ALL}",
        inks=(255, 0, 0, 255),
    ),
    Case(
        name="a spot colour under overprint",
        clause="8.6.7",
        content=f"/SpaceG cs 1 scn {ALL} /O gs 1 0 0 0 k {ALL}",
        inks=(255, 51, 204, 26),
    ),
    Case(name="opacity", clause="11.3.6", content=f"/A gs 0 1 0 0 k {ALL}", inks=(0, 128, 0, 0)),
    Case(name="opacity in a group", clause="11.4.5", content="/X Do", inks=(0, 128, 0, 0)),
    Case(
        name="fill and stroke knock each other out",
        clause="11.7.4.4",
        content="/A gs 0 1 0 0 k 0 1 0 0 K 80 w 10 10 80 80 re B",
        inks=(0, 128, 0, 0),
        page="/Group<</S/Transparency>>",
    ),
    Case(
        name="Multiply",
        clause="11.3.5.2",
        content=f"0 0 1 0 k {ALL} /M gs 1 0 0 0 k {ALL}",
        inks=(255, 0, 255, 0),
    ),
    Case(
        name="the first known blend mode of a list",
        clause="11.6.3",
        content=f"0 0 1 0 k {ALL} /L gs 1 0 0 0 k {ALL}",
        inks=(255, 0, 255, 0),
    ),
    Case(
        name="an opaque page with an RGB group",
        clause="11.4.7",
        content=f"0 0 0 1 k {ALL}",
        inks=(0, 0, 0, 255),
        page="/Group<</S/Transparency/CS/DeviceRGB>>",
    ),
    Case(
        name="a layer whose usage is not requested",
        clause="8.11.4.4",
        content=f"/OC /OC BDC 1 0 0 0 k {ALL} EMC",
        inks=(255, 0, 0, 0),
    ),
    Case(
        name="a link with an appearance",
        clause="12.5.5",
        content="",
        inks=(0, 128, 0, 0),
        page="/Annots[<</Subtype/Link/F 4/Rect[0 0 100 100]/AP<</N 6 0 R>>>>]",
    ),
    Case(
        name="a TrimBox without area",
        clause="14.11.2",
        content=f"1 0 0 0 k {ALL}",
        inks=(255, 0, 0, 0),
        page="/TrimBox[0 0 0 0]",
    ),
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
