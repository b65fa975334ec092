"""``import prooflight as pf``: what is documented runs, loads when touched, and shows itself."""

from __future__ import annotations

import inspect
import io
import pickle
import subprocess
import sys
import textwrap
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image
from reportlab.lib.units import mm
from reportlab.pdfgen import canvas
from tests import usage

import prooflight as pf
from prooflight.cli import run
from prooflight.errors import ProoflightError, RequestError, ScanError
from prooflight.pages.files import write_tiff
from prooflight.reporting import notebook
from prooflight.reporting.pictures import SCALE
from prooflight.scans.recorded import recorded_scans, write_scan

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(scope="module")
def folder(
    tmp_path_factory: pytest.TempPathFactory, press: pf.Press, make_page: Callable[..., pf.Page]
) -> Path:
    """A press, a job of three pages, and scans of them; the second shows a streak."""
    folder = tmp_path_factory.mktemp("api")
    (folder / "scans").mkdir()
    press.save(folder / "my.press")
    for number in (1, 2, 3):
        page = make_page(number, number=number, height_mm=30.0)
        write_tiff(page, folder / "job" / f"{page.name}.tif")
        scan = pf.simulate(page, press, misprint="streak:0.9" if number == 2 else None, seed=number)
        write_scan(folder / "scans" / f"{page.name}.tif", scan.dn, facts={})
    return folder


@pytest.fixture(scope="module")
def found(press: pf.Press, page: pf.Page) -> pf.Inspection:
    """A hole in a page."""
    return pf.Inspector(press).inspect(page, pf.simulate(page, press, misprint="spots-voids:0.9"))


# --- names ---

INSPECTING = """
import sys
import prooflight.inspection.inspector
assert "scipy.special" in sys.modules
slow = {"scipy.stats", "scipy.optimize", "PIL", "matplotlib", "pymupdf"} & set(sys.modules)
assert not slow, slow
"""


def test_what_inspects_loads_nothing_that_takes_longer_than_a_page() -> None:
    subprocess.run([sys.executable, "-c", INSPECTING], check=True, timeout=60)


LEAN = """
import sys
before = set(sys.modules)
import prooflight
heavy = {"numpy", "numba", "cv2", "scipy", "PIL", "pydantic", "jinja2"} & (set(sys.modules) - before)
assert not heavy, heavy
ours = sorted(name for name in sys.modules if name.startswith("prooflight."))
assert ours == ["prooflight.shown"], ours
assert {"Press", "open_job", "__version__"} <= set(dir(prooflight))
prooflight.Press
assert "numpy" in sys.modules
"""


def test_the_bare_import_loads_nothing_and_a_name_loads_its_room() -> None:
    subprocess.run([sys.executable, "-c", LEAN], check=True, timeout=60)


def test_every_public_name_is_documented_and_is_the_one_of_its_room() -> None:
    assert pf.__doc__ is not None
    for name in pf.__all__:
        if name == "__version__":
            continue
        value = getattr(pf, name)
        assert value.__doc__, name
        assert not value.__doc__.startswith(f"{name}("), name  # what dataclasses write of their own accord
        assert f"\n{name} " in pf.__doc__, name
        assert not inspect.ismodule(value), name
    rows = [line for line in pf.__doc__.split("=\n")[1].splitlines() if line[:1].isalpha()]
    assert len(rows) == len(pf.__all__) - 1  # nothing is listed that is not there
    assert 20 <= len(rows) <= 25


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Printer'"):
        _ = pf.Printer


# --- the documented usage ---


def test_a_job_is_inspected_as_documented(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = usage.a_job(folder)
    assert [verdict for verdict, _ in told] == ["good", "misprint", "good"]
    assert [places > 0 for _, places in told] == [False, True, False]
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" ")[0] for line in lines] == ["p0001", "p0002", "p0003"]
    assert "misprint: Streak in print direction" in lines[1]


def test_the_five_lines_of_the_package_s_own_words_work_on_a_pdf(
    press: pf.Press, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    drawn = canvas.Canvas("job.pdf", pagesize=(36 * mm, 30 * mm))
    for word in ("one", "two"):
        drawn.setFillColorCMYK(0, 0, 0, 1)
        drawn.drawString(5 * mm, 15 * mm, f"page {word}")
        drawn.showPage()
    drawn.save()
    press.save("my.press")
    with pf.open_job("job.pdf", press) as job:
        for page in job:
            scan = pf.simulate(page, press, misprint="streak:1" if page.number == 2 else None)
            write_scan(tmp_path / "scans" / f"{page.name}.tif", scan.dn, facts={})
    assert pf.__doc__ is not None
    _, _, rest = pf.__doc__.partition("::\n\n")
    lines, _, _ = rest.partition("\n\n")
    assert lines.strip().startswith("import prooflight as pf")
    exec(textwrap.dedent(lines), {})
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "p0001 is good."
    assert said[1].startswith("p0002 is a misprint: ")


def test_a_page_is_inspected_as_documented(page: pf.Page, press: pf.Press) -> None:
    verdict = usage.a_page(page, press)
    assert (verdict.verdict, verdict.detector) == ("misprint", "chi-square")


def test_a_press_is_built_saved_and_loaded_as_documented(tmp_path: Path, press: pf.Press) -> None:
    assert usage.a_press(tmp_path).digest == press.digest  # the same file, seed and pixels


def test_a_camera_answers_as_documented(prototype: pf.PressFile) -> None:
    (answers,) = usage.a_camera(prototype).values()
    paper, cyan, magenta, yellow, black = answers
    assert paper > yellow > cyan > black  # a grey sensor under the prototype's lamp
    assert paper > magenta > black


# --- jobs and pairs ---


def test_a_job_is_opened_as_its_pages_enter_the_press(
    press: pf.Press, make_page: Callable[..., pf.Page], tmp_path: Path
) -> None:
    wide = make_page(4, width_mm=60.0, height_mm=30.0)  # wider than the field of 42 mm
    write_tiff(wide, tmp_path / "wide.tif")
    with pf.open_job(str(tmp_path / "wide.tif"), press) as job:
        assert job.source.dpi == press.dpi
        assert usage.pages_of(job) == [pytest.approx(30.0, abs=0.1)]
        with pickle.loads(pickle.dumps(job)) as again:
            assert np.array_equal(again.page(1).cmyk, job.page(1).cmyk)


def test_pages_without_a_scan_are_named_or_left_out(folder: Path, press: pf.Press, tmp_path: Path) -> None:
    (tmp_path / "p0002.tif").write_bytes((folder / "scans" / "p0002.tif").read_bytes())
    with pf.open_job(folder / "job", press) as job:
        with pytest.raises(ScanError, match=r"no scan of p0001, p0003; add them"):
            pf.pair(job, tmp_path)
        ((page, scan),) = pf.pair(job, str(tmp_path), partly=True)
    assert page.name == "p0002"
    assert scan.name.endswith("p0002.tif")


def test_simulate_makes_the_scan_that_the_command_writes(
    folder: Path, press: pf.Press, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for world in ("ideal", "press"):
        out = tmp_path / world
        words = [folder / "job", "--press", folder / "my.press", "-o", out, "--pages", "3", "--seed", "5"]
        words += ["--world", world, "--misprint", "density:0.7"]
        assert run(["simulate", *map(str, words)]) == 0
        (written,) = recorded_scans(out, sensors=1)
        with pf.open_job(folder / "job", press) as job:
            scan = pf.simulate(
                job.page(3), press, misprint="density:0.7", world=world, others=list(job), seed=5
            )
        assert np.array_equal(scan.dn, written.read())
    capsys.readouterr()


def test_simulate_refuses_what_there_is_not(page: pf.Page, press: pf.Press) -> None:
    for wish in ({"misprint": "stripes"}, {"misprint": "streak:2"}, {"world": "moon"}):
        with pytest.raises(RequestError):
            pf.simulate(page, press, **wish)


# --- inspectors ---


def test_an_inspector_takes_a_detector_or_the_press_s_best(press: pf.Press, trained_press: pf.Press) -> None:
    assert pf.Inspector(press).detector.name == "chi-square"
    assert pf.Inspector(trained_press).detector.name == "matched_filter"
    own = pf.Inspector.of(trained_press, "chi-square")
    assert pf.Inspector(trained_press, own.detector).detector is own.detector
    assert replace(own, press=press).detector is own.detector
    assert pickle.loads(pickle.dumps(own)).guarantee == own.guarantee


# --- how things show themselves ---


def colours(picture: Image.Image) -> np.ndarray:
    return np.asarray(picture.convert("RGB")).astype(int)


def test_a_page_shows_as_a_thumbnail_in_the_colours_of_its_inks() -> None:
    cmyk = np.zeros((900, 600, 4), np.uint8)
    cmyk[:300, :, 0], cmyk[300:600, :, 3] = 255, 255
    page = pf.Page(cmyk=cmyk, dpi=300, name="p0001", number=1)
    picture = Image.open(io.BytesIO(page._repr_png_()))
    assert (picture.format, picture.size) == ("PNG", (240, 360))
    assert [picture.getpixel((120, y)) for y in (60, 180, 300)] == [(0, 255, 255), (0, 0, 0), (255, 255, 255)]
    tiny = pf.Page(cmyk=cmyk[:3, :2], dpi=300, name="p0001", number=1)
    assert Image.open(io.BytesIO(tiny._repr_png_())).size == (2, 3)


def test_the_picture_marks_the_regions_where_they_differ(found: pf.Inspection, page: pf.Page) -> None:
    assert found.regions
    picture = found.picture()
    pixels = colours(picture)
    panel = (picture.width - notebook.GAP_PX) // 3 - notebook.GAP_PX
    lefts = [notebook.GAP_PX + index * (panel + notebook.GAP_PX) for index in range(3)]
    marked = [
        (np.abs(pixels[:, left : left + panel] - notebook.MARK).sum(axis=2) < 4).any() for left in lefts
    ]
    assert marked == [False, True, True]
    region, scale = found.regions[0], panel / page.width_mm
    x = lefts[2] + (region.x_mm + region.width_mm / 2) * scale
    y = notebook.CAPTION_PX + (region.y_mm + region.height_mm / 2) * scale
    inside = pixels[round(y) - 4 : round(y) + 5, round(x) - 4 : round(x) + 5].reshape(-1, 3)
    ends = np.array([SCALE[0][1], SCALE[-1][1]])
    assert np.abs(inside[:, None] - ends).sum(axis=2).min() < 60  # as far off as the scale goes


def test_a_good_page_has_no_marks(press: pf.Press, page: pf.Page) -> None:
    good = pf.Inspector(press).inspect(page, pf.simulate(page, press))
    assert good.regions == ()
    assert (np.abs(colours(good.picture()) - notebook.MARK).sum(axis=2) >= 4).all()
    assert "p0001 is good." in good._repr_html_()


def test_html_holds_the_picture_the_numbers_and_nothing_unescaped(found: pf.Inspection) -> None:
    named = replace(found, verdict=replace(found.verdict, page="<script>alert(1)</script>", detector="a & b"))
    html = named._repr_html_()
    assert "data:image/png;base64," in html
    assert "<script>" not in html
    assert "&lt;script&gt;" in html
    assert "a &amp; b" in html
    assert html.count("<tr>") >= 1 + len(found.regions)
    assert "<img" not in named.verdict._repr_html_()


def test_an_unseen_page_shows_why() -> None:
    html = pf.Verdict.skipped("p0001", "its <scan> is missing")._repr_html_()
    assert "p0001 was not inspected: its &lt;scan&gt; is missing." in html


def test_a_press_shows_its_report_card(press: pf.Press, trained_press: pf.Press) -> None:
    html = replace(press, name="<b>mine</b>")._repr_html_()
    assert "<b>mine" not in html
    for word in ("mono", "400 pixels", f"{press.dpi:.0f} dpi", "Detector chi-square", "built-in"):
        assert word in html
    assert "Detector matched_filter" not in html
    assert (
        pf.Inspector.of(trained_press, "matched_filter").guarantee.split(";")[0]
        in trained_press._repr_html_()
    )


def test_a_detector_s_own_inspection_has_no_picture_but_a_verdict(found: pf.Inspection) -> None:
    alone = replace(found, planned=None)
    with pytest.raises(ProoflightError, match="Inspector"):
        alone.picture()
    assert "<img" not in alone._repr_html_()
    assert alone.verdict.page in alone._repr_html_()


def test_show_says_a_line_at_a_prompt_and_displays_in_a_notebook(
    found: pf.Inspection, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found.show()
    assert capsys.readouterr().out.startswith("p0001 is a misprint: ")
    shown: list[object] = []
    for shell, displayed in ((None, []), (SimpleNamespace(), []), (SimpleNamespace(kernel=1), [found])):
        fake = SimpleNamespace(
            get_ipython=lambda shell=shell: shell, display=SimpleNamespace(display=shown.append)
        )
        monkeypatch.setitem(sys.modules, "IPython", fake)
        found.show()
        assert shown == displayed
        assert (capsys.readouterr().out == "") == bool(displayed)
