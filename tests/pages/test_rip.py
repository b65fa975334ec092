"""What a press prints of a PDF: pages written operator by operator, values known in closed form."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from tests.stand_ins import cmyk_profile, others

from prooflight.pages.pdf.rip import PdfJob

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    WritePdf = Callable[..., Path]

SPOT = "/Separation/Gold/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 0.2 0.8 0.1]/N 1>>"
CURVED = "/Separation/Gold/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 0.2 0.8 0.1]/N 2>>"
GOLD = [0, 51, 204, 26]  # round(255 * (0, 0.2, 0.8, 0.1))


def rip(path: Path, dpi: float = 72, profile: Path | None = None) -> NDArray[np.uint8]:
    with PdfJob(path, profile=profile) as job:
        return job.page(1, dpi).cmyk


def test_process_values_are_the_nearest_byte(write_pdf: WritePdf) -> None:
    inks = [0.0, 0.001, 0.1, 0.2, 0.25, 0.33, 0.5, 0.6, 0.66, 0.75, 0.9, 0.999, 1.0]
    bars = "".join(f"{v} 0 {v / 2:.4f} {v} k {7 * i} 0 7 100 re f\n" for i, v in enumerate(inks))
    cmyk = rip(write_pdf(bars))
    for i, v in enumerate(inks):
        expected = [round(255 * v), 0, round(255 * v / 2), round(255 * v)]
        assert cmyk[:, 7 * i : 7 * i + 7].reshape(-1, 4).tolist() == [expected] * 700
    assert not cmyk[:, 91:].any()


def test_device_gray_is_black_alone(write_pdf: WritePdf) -> None:
    cmyk = rip(write_pdf("0 g 0 0 50 100 re f 0.4 g 50 0 50 100 re f"))
    assert cmyk[50, 25].tolist() == [0, 0, 0, 255]
    assert cmyk[50, 75].tolist() == [0, 0, 0, 153]


def test_a_pixel_is_ink_or_paper(write_pdf: WritePdf) -> None:
    font = "/Font<</F<</Type/Font/Subtype/Type1/BaseFont/Helvetica>>>>"
    cmyk = rip(
        write_pdf("0 0 0 1 k BT /F 40 Tf 5 20 Td (Rag) Tj ET 3 90 m 97 70 l 50 50 l f", resources=font), 150
    )
    black = cmyk[:, :, 3]
    assert set(np.unique(black)) == {0, 255}
    assert 0.05 < (black > 0).mean() < 0.5


@pytest.mark.parametrize("dpi", [150, 1600])
def test_a_page_drawn_finer_is_the_mean_of_its_pixels(write_pdf: WritePdf, dpi: int) -> None:
    """1600: in several bands."""
    font = "/Font<</F<</Type/Font/Subtype/Type1/BaseFont/Helvetica>>>>"
    text = "0 0 0 1 k BT /F 40 Tf 5 20 Td (Rag) Tj ET 1 0 .5 0 k 3 90 m 97 70 l 50 50 l f"
    with PdfJob(write_pdf(text, resources=font)) as job:
        coarse, fine = job.page(1, dpi, drawn_dpi=2 * dpi).cmyk, job.page(1, 2 * dpi).cmyk
    rows, columns = coarse.shape[:2]
    mean = fine[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse, mean, atol=0.5)  # a byte is rounded


@pytest.mark.parametrize("dpi", [100, 900])
def test_a_page_is_drawn_at_the_resolution_of_its_press(write_pdf: WritePdf, dpi: int) -> None:
    """Whose pixels are no whole number in one of the raster's; 900: in several bands."""
    text, step = "0 0 0 1 k 3 90 m 97 70 l 50 50 l f 10 10 30 20 re f", 2.49
    with PdfJob(write_pdf(text)) as job:
        coarse, fine = job.page(1, dpi, drawn_dpi=step * dpi).cmyk, job.page(1, step * dpi).cmyk
    rows, columns = coarse.shape[:2]
    summed = np.pad(np.pad(fine[..., 3].astype(np.float64), ((0, 3), (0, 3)), "edge").cumsum(0).cumsum(1), 1)

    def up_to(edges: NDArray[np.float64], along: int) -> NDArray[np.float64]:
        """Sums up to edges, between those of whole pixels."""
        whole, part = np.floor(edges).astype(int), edges % 1
        low, high = sums.take(whole, along), sums.take(whole + 1, along)
        shape = (-1, 1) if along == 0 else (1, -1)
        return low + part.reshape(shape) * (high - low)

    sums = summed
    sums = up_to(step * np.arange(rows + 1), 0)
    sums = up_to(step * np.arange(columns + 1), 1)
    mean = np.diff(np.diff(sums, axis=0), axis=1) / step**2
    inside = slice(0, -2)  # beyond the finer raster nothing is known
    np.testing.assert_allclose(coarse[inside, inside, 3], mean[inside, inside], atol=0.51)


def test_a_page_drawn_finer_has_the_shape_of_its_resolution(write_pdf: WritePdf) -> None:
    with PdfJob(write_pdf("0 0 0 1 k 0 0 49.5 100 re f")) as job:
        page = job.page(1, 72, drawn_dpi=144)
    assert page.cmyk.shape == (100, 100, 4)
    assert page.cmyk[50, [48, 49, 50], 3].tolist() == [255, 128, 0]


OVERPRINT = "/ExtGState<</N<</op true/OPM 0>>/M<</op true/OPM 1>>/K<</op false/OPM 1>>>>"


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        pytest.param("", [0, 0, 0, 255], id="knocks out"),
        pytest.param("/K gs", [0, 0, 0, 255], id="OPM 1 without overprint knocks out"),
        pytest.param("/N gs", [0, 0, 0, 255], id="OPM 0: DeviceCMYK names all four inks"),
        pytest.param("/M gs", [102, 51, 0, 255], id="OPM 1: ink that is 0 is left alone"),
    ],
)
def test_black_text_over_colour(write_pdf: WritePdf, state: str, expected: list[int]) -> None:
    job = write_pdf(f"0.4 0.2 0 0 k 0 0 100 100 re f {state} 0 0 0 1 k 20 20 60 60 re f", resources=OVERPRINT)
    cmyk = rip(job)
    assert cmyk[5, 5].tolist() == [102, 51, 0, 0]
    assert cmyk[50, 50].tolist() == expected


def test_a_trace_of_ink_is_not_zero_for_overprint_mode_1(write_pdf: WritePdf) -> None:
    cmyk = rip(
        write_pdf("0.4 0 0 0 k 0 0 100 100 re f /M gs 0.001 0 0 1 k 20 20 60 60 re f", resources=OVERPRINT)
    )
    assert cmyk[50, 50].tolist() == [0, 0, 0, 255]


@pytest.mark.parametrize(("state", "under"), [("", 0), ("/M gs", 102)])
def test_spot_colour_by_its_tint_transform(write_pdf: WritePdf, state: str, under: int) -> None:
    job = write_pdf(
        f"0.4 0 0 0 k 0 0 100 100 re f {state} /S cs 1 scn 20 20 60 60 re f",
        resources=f"/ColorSpace<</S[{SPOT}]>>{OVERPRINT}",
    )
    cmyk = rip(job)
    assert cmyk[5, 5].tolist() == [102, 0, 0, 0]
    assert cmyk[50, 50].tolist() == [under, *GOLD[1:]]


@pytest.mark.parametrize("tint", [0.2, 0.5, 0.8])
@pytest.mark.parametrize(("space", "power"), [(SPOT, 1), (CURVED, 2)])
def test_tints_follow_the_whole_curve(write_pdf: WritePdf, tint: float, space: str, power: int) -> None:
    cmyk = rip(write_pdf(f"/S cs {tint} scn 0 0 100 100 re f", resources=f"/ColorSpace<</S[{space}]>>"))
    expected = 255 * tint**power * np.array([0, 0.2, 0.8, 0.1])
    # a tint is held in 8 bits: half a step of it, and half a step of the result
    np.testing.assert_allclose(cmyk[50, 50], expected, atol=0.5 + 0.5 * power)


def test_process_ink_knocks_a_spot_out(write_pdf: WritePdf) -> None:
    cmyk = rip(
        write_pdf(
            "/S cs 1 scn 0 0 100 100 re f 0 0 0 0.6 k 20 20 60 60 re f /M gs 0 0 0 0.6 k 0 0 10 100 re f",
            resources=f"/ColorSpace<</S[{SPOT}]>>{OVERPRINT}",
        )
    )
    assert cmyk[50, 50].tolist() == [0, 0, 0, 153]
    assert cmyk[50, 5].tolist() == [*GOLD[:3], GOLD[3] + 153]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("All", [153, 153, 153, 153]),
        ("None", [0, 0, 0, 0]),
        ("Magenta", [0, 153, 0, 0]),
        ("Black", [0, 0, 0, 153]),
    ],
)
def test_colorants_with_a_meaning(write_pdf: WritePdf, name: str, expected: list[int]) -> None:
    # the tint transform says cyan: it must not be used for any of them
    space = f"/Separation/{name}/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[1 0 0 0]/N 1>>"
    cmyk = rip(write_pdf("/S cs 0.6 scn 0 0 100 100 re f", resources=f"/ColorSpace<</S[{space}]>>"))
    assert cmyk[50, 50].tolist() == expected


def test_separation_black_overprints_colour(write_pdf: WritePdf) -> None:
    space = "/Separation/Black/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 0 0 1]/N 1>>"
    content = "0.4 0.2 0 0 k 0 0 100 100 re f /N gs /S cs 0.6 scn 20 20 60 60 re f"
    cmyk = rip(write_pdf(content, resources=f"/ColorSpace<</S[{space}]>>{OVERPRINT}"))
    assert cmyk[50, 50].tolist() == [102, 51, 0, 153]


def test_all_on_a_page_with_spots_is_printed_once(write_pdf: WritePdf) -> None:
    everything = "/Separation/All/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[1 1 1 1]/N 1>>"
    cmyk = rip(
        write_pdf(
            "/S cs 1 scn 0 0 50 100 re f /A cs 0.6 scn 50 0 50 100 re f",
            resources=f"/ColorSpace<</S[{SPOT}]/A[{everything}]>>",
        )
    )
    assert cmyk[50, 25].tolist() == GOLD
    assert cmyk[50, 75].tolist() == [153, 153, 153, 153]


MIXED = b"{pop dup 0.2 mul exch dup 0.8 mul exch 0.1 mul}"  # c g n -> c 0.2g 0.8g 0.1g


def function(body: bytes, inputs: int) -> bytes:
    entries = b"/FunctionType 4/Domain[%s]/Range[0 1 0 1 0 1 0 1]" % (b"0 1 " * inputs)
    return b"<<%s/Length %d>>stream\n%s\nendstream" % (entries, len(body), body)


@pytest.mark.parametrize(
    ("attributes", "over"),
    [
        pytest.param("", [102, *GOLD[1:]], id="DeviceN: in the alternate space, which names all four inks"),
        pytest.param(
            f"<</Subtype/NChannel/Colorants<</Gold[{SPOT}]>>>>",
            [102, 153 + GOLD[1], *GOLD[2:]],
            id="NChannel",
        ),
    ],
)
def test_device_n_with_a_spot_colour(write_pdf: WritePdf, attributes: str, over: list[int]) -> None:
    cmyk = rip(
        write_pdf(
            "0 0.6 0 0 k 0 0 100 100 re f /D cs 0.4 1 0.9 scn 0 0 50 100 re f /N gs 50 0 50 100 re f",
            resources=f"/ColorSpace<</D[/DeviceN[/Cyan/Gold/None]/DeviceCMYK 5 0 R{attributes}]>>{OVERPRINT}",
            more=[function(MIXED, 3)],
        )
    )
    assert cmyk[50, 25].tolist() == [102, *GOLD[1:]]
    assert cmyk[50, 75].tolist() == over


def test_device_n_of_process_inks_paints_these(write_pdf: WritePdf) -> None:
    """Its tint transform says otherwise, and is not used."""
    cmyk = rip(
        write_pdf(
            "0 0.6 0 0 k 0 0 100 100 re f /D cs 0.4 1 0.8 scn 0 0 50 100 re f /N gs 50 0 50 100 re f",
            resources=f"/ColorSpace<</D[/DeviceN[/Cyan/None/Black]/DeviceCMYK 5 0 R]>>{OVERPRINT}",
            more=[function(b"{pop pop pop 0 1 0 0}", 3)],
        )
    )
    assert cmyk[50, 25].tolist() == [102, 0, 0, 204]
    assert cmyk[50, 75].tolist() == [102, 153, 0, 204]


PUBLISHED = others("ICC profiles")


@pytest.fixture(params=["made", "published"] if PUBLISHED else ["made"])
def profiles(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Path]:
    """Two output profiles: of a job, and another."""
    if request.param == "published":
        output, other = PUBLISHED
        return output, other
    output, other = tmp_path / "output.icc", tmp_path / "other.icc"
    output.write_bytes(cmyk_profile())
    other.write_bytes(cmyk_profile(gamma=2.4, black=0.3))
    return output, other


INTENT = (
    "/OutputIntents[<</Type/OutputIntent/S/GTS_PDFX/OutputConditionIdentifier(x)/DestOutputProfile 5 0 R>>]"
)
BOX = "/MediaBox[0 0 100 100]"


def profile_stream(path: Path) -> bytes:
    data = path.read_bytes()
    return b"<</N 4/Length %d>>stream\n" % len(data) + data + b"\nendstream"


def squares(colours: NDArray[np.float64], operator: str) -> str:
    """5 by 5 squares of 20 points, from the bottom row up."""
    return "".join(
        f"{' '.join(f'{v:.6f}' for v in colour)} {operator} {20 * (i % 5)} {20 * (i // 5)} 20 20 re f\n"
        for i, colour in enumerate(colours)
    )


def centres(cmyk: NDArray[np.uint8]) -> NDArray[np.int64]:
    return cmyk[::-1][10::20, 10::20].reshape(25, 4).astype(np.int64)


@pytest.mark.parametrize("by", ["document", "page", "argument", "argument over document"])
@pytest.mark.parametrize("kind", ["fill", "image"])
def test_rgb_is_converted_as_lcms_does(
    write_pdf: WritePdf, profiles: tuple[Path, Path], by: str, kind: str
) -> None:
    from PIL import Image, ImageCms

    output, other = profiles
    rgb = np.random.default_rng(7).integers(0, 256, (25, 3), dtype=np.uint8)
    rgb[:4] = [[0, 0, 0], [255, 255, 255], [255, 0, 0], [0, 0, 255]]
    more, catalogue, page, argument = [profile_stream(output)], INTENT, BOX, None
    if by == "page":
        catalogue, page = "", BOX + INTENT
    if by.startswith("argument"):
        argument = output
        more, catalogue = ([profile_stream(other)], INTENT) if "over" in by else ([b"null"], "")
    if kind == "fill":
        job = write_pdf(squares(rgb / 255, "rg"), catalogue=catalogue, page=page, more=more)
    else:
        rows = rgb.reshape(5, 5, 3)[::-1].tobytes()
        image = (
            b"<</Subtype/Image/Width 5/Height 5/ColorSpace/DeviceRGB/BitsPerComponent 8/Length 75>>stream\n"
        )
        more = [*more, image + rows + b"\nendstream"]
        job = write_pdf(
            "100 0 0 100 0 0 cm /I Do",
            resources="/XObject<</I 6 0 R>>",
            catalogue=catalogue,
            page=page,
            more=more,
        )
    # Reference: no precalculated link at all; 2 is the fine link's grid (measured: 1) and rounding.
    link = ImageCms.buildTransform(
        ImageCms.createProfile("sRGB"),
        str(output),
        "RGB",
        "CMYK",
        ImageCms.Intent.RELATIVE_COLORIMETRIC,
        ImageCms.Flags.BLACKPOINTCOMPENSATION | ImageCms.Flags.NOOPTIMIZE,
    )
    expected = np.asarray(ImageCms.applyTransform(Image.frombytes("RGB", (25, 1), rgb.tobytes()), link))[0]
    np.testing.assert_allclose(centres(rip(job, profile=argument)), expected, atol=2)


@pytest.mark.parametrize("by", ["document", "page", "argument"])
def test_no_profile_touches_native_ink(write_pdf: WritePdf, profiles: tuple[Path, Path], by: str) -> None:
    output, _ = profiles
    inks = np.random.default_rng(8).integers(0, 1001, (25, 4)) / 1000
    black = inks[:, 3]
    where = {"document": {"catalogue": INTENT}, "page": {"page": BOX + INTENT}, "argument": {}}[by]
    argument = output if by == "argument" else None
    more = [profile_stream(output)]
    cmyk = rip(write_pdf(squares(inks, "k"), more=more, **where), profile=argument)
    np.testing.assert_array_equal(centres(cmyk), [[round(255 * v) for v in ink] for ink in inks.tolist()])
    grey = centres(rip(write_pdf(squares(1 - black[:, None], "g"), more=more, **where), profile=argument))
    np.testing.assert_allclose(grey[:, 3], 255 * black, atol=0.51)  # 1 - grey is formed in single precision
    assert not grey[:, :3].any()
    spot = squares(np.ones((25, 1)), "scn").replace("1.000000", "/S cs 1")
    gold = rip(write_pdf(spot, resources=f"/ColorSpace<</S[{SPOT}]>>", more=more, **where), profile=argument)
    assert gold[50, 50].tolist() == GOLD


def test_lab_is_converted_as_lcms_does(write_pdf: WritePdf, profiles: tuple[Path, Path]) -> None:
    imagecodecs = pytest.importorskip("imagecodecs")
    from PIL import ImageCms

    output, _ = profiles
    lab = np.random.default_rng(9).uniform([10, -40, -40], [95, 40, 40], (25, 3)).round(2)
    space = "/L[/Lab<</WhitePoint[0.9642 1 0.8249]/Range[-128 127 -128 127]>>]"
    cmyk = rip(write_pdf("/L cs " + squares(lab, "scn"), resources=f"/ColorSpace<<{space}>>"), profile=output)
    expected = imagecodecs.cms_transform(
        lab[None],
        ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes(),
        output.read_bytes(),
        colorspace="lab",
        outcolorspace="cmyk",
        outdtype="uint8",
        intent=1,
        flags=0x2100,  # black point compensation, no precalculation
    )[0]
    # a* and b* are rounded to whole numbers: half a unit moves an ink by up to about 2 of 255
    np.testing.assert_allclose(centres(cmyk), expected.astype(np.int64), atol=4)


@pytest.mark.parametrize("turn", [0, 90, 180, 270, -90])
def test_rotate_turns_the_page_clockwise(write_pdf: WritePdf, turn: int) -> None:
    plain = rip(write_pdf("1 0 0 0 k 0 60 30 40 re f", page="/MediaBox[0 0 80 100]"))
    assert plain[5, 5, 0] == 255
    assert not plain[95, 5].any()
    cmyk = rip(write_pdf("1 0 0 0 k 0 60 30 40 re f", page=f"/MediaBox[0 0 80 100]/Rotate {turn}"))
    np.testing.assert_array_equal(cmyk, np.rot90(plain, -turn // 90))


def test_the_trim_box_is_printed(write_pdf: WritePdf) -> None:
    boxes = "/MediaBox[0 0 100 100]/CropBox[5 5 95 95]/TrimBox[10 20 90 80]"
    content = "0 0 0 1 k 0 0 100 100 re f 1 0 0 0 k 10 70 10 10 re f"
    cmyk = rip(write_pdf(content, page=boxes))
    assert cmyk.shape == (60, 80, 4)
    assert (cmyk[:10, :10] == [255, 0, 0, 0]).all()
    assert (cmyk[10:] == [0, 0, 0, 255]).all()
    assert rip(write_pdf(content, page=boxes.split("/TrimBox")[0])).shape == (90, 90, 4)
    with PdfJob(write_pdf(content, page=boxes)) as job:
        assert job.page_sizes_mm == ((pytest.approx(80 / 72 * 25.4), pytest.approx(60 / 72 * 25.4)),)


def test_user_unit_scales_the_page(write_pdf: WritePdf) -> None:
    cmyk = rip(write_pdf("0 0 0 1 k 0 0 50 100 re f", page="/MediaBox[0 0 100 100]/UserUnit 2"))
    assert cmyk.shape == (200, 200, 4)
    assert cmyk[100, :100, 3].all()
    assert not cmyk[100, 100:].any()


@pytest.mark.parametrize(("points", "dpi"), [(100, 482), (595.276, 100), (33.3, 301.7), (3, 7)])
def test_the_raster_is_as_large_as_stated(write_pdf: WritePdf, points: float, dpi: float) -> None:
    cmyk = rip(write_pdf("", page=f"/MediaBox[0 0 {points} 72]"), dpi)
    assert cmyk.shape == (round(dpi), max(1, round(points * dpi / 72)), 4)


def test_image_samples_are_blocks(write_pdf: WritePdf) -> None:
    image = b"<</Subtype/Image/Width 2/Height 1/ColorSpace/DeviceCMYK/BitsPerComponent 8/Length 8>>stream\n"
    more = [image + bytes([10, 20, 30, 40, 250, 0, 5, 255]) + b"\nendstream"]
    cmyk = rip(write_pdf("100 0 0 100 0 0 cm /I Do", resources="/XObject<</I 5 0 R>>", more=more), 144)
    assert (cmyk[:, :100] == [10, 20, 30, 40]).all()
    assert (cmyk[:, 100:] == [250, 0, 5, 255]).all()


def test_jobs_do_not_disturb_each_other(tmp_path: Path, write_pdf: WritePdf) -> None:
    import pymupdf

    first = PdfJob(write_pdf("0.5 0 0 0 k 0 0 33.3 33.3 re f").rename(tmp_path / "a.pdf"))
    before = first.page(1, 100).cmyk.copy()
    pymupdf.TOOLS.set_aa_level(8)
    with PdfJob(write_pdf("1 0 0 rg 0 0 33.3 33.3 re f")) as second:
        second.page(1, 200)
        np.testing.assert_array_equal(first.page(1, 100).cmyk, before)
    assert pymupdf.TOOLS.show_aa_level()["graphics"] == 8
    first.close()


def image(entries: str, data: bytes) -> bytes:
    return f"<</Subtype/Image{entries}/Length {len(data)}>>stream\n".encode() + data + b"\nendstream"


PLACES = {
    "upright": "100 0 0 100 0 0",
    "upside down": "100 0 0 -100 0 100",
    "mirrored": "-100 0 0 100 100 0",
    "turned": "0 100 -100 0 100 0",
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("dpi", [50, 482])  # below and above where MuPDF's own sampling drifts
@pytest.mark.parametrize("kind", ["image", "stencil", "soft mask", "indexed"])
def test_samples_lie_where_the_matrix_puts_them(
    write_pdf: WritePdf, place: str, dpi: float, kind: str
) -> None:
    samples = np.array([[1, 0, 1], [0, 1, 1]], dtype=np.uint8)  # 1 is ink; top row first
    size, bits = "/Width 3/Height 2", "/BitsPerComponent 8"
    ink = (255 * samples).tobytes()
    cmyk = bytes(np.kron(samples, [[0, 0, 0, 255]]).astype(np.uint8))
    grey = image(f"{size}/ColorSpace/DeviceGray{bits}", ink)
    more = {
        "image": [image(f"{size}/ColorSpace/DeviceCMYK{bits}", cmyk)],
        "stencil": [
            image(f"{size}/ImageMask true/BitsPerComponent 1/Decode[1 0]", bytes([0b10100000, 0b01100000]))
        ],
        "soft mask": [image(f"{size}/ColorSpace/DeviceCMYK{bits}/SMask 6 0 R", b"\0\0\0\xff" * 6), grey],
        "indexed": [
            image(f"{size}/ColorSpace[/Indexed/DeviceCMYK 1<00000000000000FF>]{bits}", samples.tobytes())
        ],
    }[kind]
    job = write_pdf(f"0 0 0 1 k {PLACES[place]} cm /I Do", resources="/XObject<</I 5 0 R>>", more=more)
    black = rip(job, dpi)[:, :, 3]
    turned = {
        "upright": samples,
        "upside down": samples[::-1],
        "mirrored": samples[:, ::-1],
        "turned": np.rot90(samples),  # anticlockwise
    }[place]
    rows, columns = (
        np.floor((np.arange(n) + 0.5) / n * k).astype(int)
        for n, k in zip(black.shape, turned.shape, strict=True)
    )
    expected = 255 * turned[np.ix_(rows, columns)]
    # MuPDF alone may be half a pixel out, and places slanted and turned images itself: compare away from edges
    reach = 1 if place != "turned" else 1 + black.shape[0] ** 2 // (2 * 16384)
    inside = np.ones_like(expected, dtype=bool)
    for cut in np.flatnonzero(np.diff(rows)):
        inside[cut - reach + 1 : cut + reach + 1] = False
    for cut in np.flatnonzero(np.diff(columns)):
        inside[:, cut - reach + 1 : cut + reach + 1] = False
    assert inside.mean() > 0.8
    # MuPDF blends through a stencil with 255/256: full ink comes out as 254
    np.testing.assert_allclose(black[inside].astype(int), expected[inside], atol=int(kind == "stencil"))


def test_gradients_are_as_smooth_as_eight_bits_allow(write_pdf: WritePdf) -> None:
    function = "<</FunctionType 2/Domain[0 1]/C0[0 1 0.2 0]/C1[1 0 0.6 0]/N 1>>"
    shading = f"/Shading<</S<</ShadingType 2/ColorSpace/DeviceCMYK/Coords[0 0 100 0]/Function {function}>>>>"
    cmyk = rip(write_pdf("/S sh", resources=shading), 720).astype(float)
    t = (np.arange(1000) + 0.5) / 1000
    expected = 255 * np.stack([t, 1 - t, 0.2 + 0.4 * t, 0 * t], axis=-1)
    # MuPDF has 256 steps: half a step is half a level here, and rounding is half a level more; one for its own t
    np.testing.assert_allclose(cmyk[500], expected, atol=2)
    assert np.abs((cmyk[500] - expected).mean(axis=0)).max() < 0.5  # MuPDF alone: a level too low
    again = write_pdf("/S sh /S sh", resources=shading)
    with PdfJob(again) as job:  # a gradient drawn before is the same gradient
        np.testing.assert_array_equal(job.page(1, 720).cmyk, job.page(1, 720).cmyk)
        np.testing.assert_array_equal(job.page(1, 720).cmyk, cmyk)


@pytest.mark.parametrize("space", ["[/Indexed/DeviceRGB 2<204080FF000010E030>]", "/DeviceRGB"])
def test_images_and_fills_of_one_colour_print_alike(
    write_pdf: WritePdf, profiles: tuple[Path, Path], space: str
) -> None:
    colours = bytes.fromhex("204080FF000010E030")
    data = colours if space == "/DeviceRGB" else bytes([0, 1, 2])
    more = [image(f"/Width 3/Height 1/ColorSpace{space}/BitsPerComponent 8", data)]
    fills = "".join(
        f"{' '.join(f'{v / 255:.6f}' for v in colours[3 * i : 3 * i + 3])} rg {i} 0 1 0.5 re f "
        for i in range(3)
    )
    job = write_pdf(
        f"{100 / 3:.6f} 0 0 100 0 0 cm q 3 0 0 1 0 0 cm /I Do Q {fills}",
        resources="/XObject<</I 5 0 R>>",
        more=more,
    )
    cmyk = rip(job, 72, profiles[0])
    np.testing.assert_array_equal(cmyk[25, [16, 50, 83]], cmyk[75, [16, 50, 83]])


def test_ink_of_the_output_profile_is_native(write_pdf: WritePdf, profiles: tuple[Path, Path]) -> None:
    inks = np.random.default_rng(10).integers(0, 256, (25, 4)) / 255
    paint = squares(inks, "scn")
    more = [profile_stream(path) for path in profiles]
    for number, native in ((5, True), (6, False)):
        spaces = f"/ColorSpace<</P[/ICCBased {number} 0 R]>>"
        cmyk = centres(rip(write_pdf("/P cs " + paint, resources=spaces, catalogue=INTENT, more=more)))
        assert (cmyk == np.rint(255 * inks)).all() == native


@pytest.mark.parametrize("managed", [False, True])
def test_images_and_gradients_in_a_spot_colour(
    write_pdf: WritePdf, profiles: tuple[Path, Path], managed: bool
) -> None:
    more = [image(f"/Width 3/Height 1/ColorSpace[{SPOT}]/BitsPerComponent 8", bytes([0, 102, 255]))]
    function = "<</FunctionType 2/Domain[0 1]/C0[0]/C1[1]/N 1>>"
    shading = f"/Shading<</S<</ShadingType 2/ColorSpace[{SPOT}]/Coords[0 0 90 0]/Function {function}>>>>"
    cmyk = rip(
        write_pdf(
            "q 90 0 0 40 0 50 cm /I Do Q 0 0 90 40 re W n /S sh",
            resources=f"/XObject<</I 5 0 R>>{shading}",
            page="/MediaBox[0 0 90 100]",
            more=more,
        ),
        profile=profiles[0] if managed else None,
    )
    assert cmyk[30, [15, 45, 75]].tolist() == [[0, 0, 0, 0], [0, 20, 82, 10], GOLD]
    tints = (np.arange(90) + 0.5) / 90
    np.testing.assert_allclose(cmyk[80], np.outer(tints, GOLD), atol=2)
