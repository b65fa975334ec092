"""Tiles: levels by closed form, pieces of the scan where they lie, a huge page in little memory, a bounded cache."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import textwrap
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.console.tests.consoles import served
from packages.console.tests.drawn_sheets import MIDDLE, write_drawn
from packages.line.tests.journal.sample_rows import CUT_MM, facts, misprint
from PIL import Image

from prooflight.detectors.verdict import Region
from prooflight.files.content import content_digest
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.redeciding import evidence_to_store, scan_to_store
from prooflight.pages.files import write_tiff
from prooflight.spectra import srgb_encoded
from prooflight_console.accounts.roles import Role
from prooflight_console.pictures import expected
from prooflight_console.pictures.expected import TILE, Pyramid, levels_of, size_at, write_levels
from prooflight_console.pictures.pictures import tidy
from prooflight_console.pictures.seen import make_seen
from prooflight_console.pictures.tiles import UNSEEN_GREY, SheetPicture, aligned, thumbnail
from prooflight_line.journal.arrays import packed
from prooflight_line.journal.cuts import Cut
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord
from prooflight_line.run.outcomes import unknown_sheet
from prooflight_line.run.sheets.records import Fault, SeenPage

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight_console.pictures.tiles import Layer

API = "/api/v1"
BLANK = Fault(kind="blank", first_line=0, detail="it is blank")


def decoded(picture: bytes | None) -> NDArray[np.uint8]:
    assert picture is not None
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))


@given(width=st.integers(1, 30_000), height=st.integers(1, 30_000))
def test_each_level_is_half_of_the_one_above_and_the_lowest_one_tile(width: int, height: int) -> None:
    levels = levels_of(width, height)
    for extent in (width, height):
        sizes = [size_at(extent, level, levels) for level in range(levels)]
        assert sizes[-1] == extent
        assert sizes[0] <= TILE
        assert all(-(-fine // 2) == coarse for coarse, fine in pairwise(sizes))
    assert levels == 1 or max(size_at(width, 1, levels), size_at(height, 1, levels)) > TILE


@given(width=st.integers(1, 1300), height=st.integers(1, 1300), seed=st.integers(0, 9))
def test_a_picture_comes_back_in_tiles_and_means(
    tmp_path_factory: pytest.TempPathFactory, width: int, height: int, seed: int
) -> None:
    signal = np.random.default_rng(seed).random((height, width), np.float32)
    made = write_levels(
        tmp_path_factory.mktemp("levels"),
        lambda first, last: signal[first:last],
        width=width,
        height=height,
        size_mm=(width / 10, height / 10),
    )
    again = Pyramid.read(made.folder)
    assert again == made
    rows = []
    for top in range(0, height, TILE):
        row = [made.part(made.levels - 1, left, top, TILE) for left in range(0, width, TILE)]
        rows.append(np.concatenate(row, axis=1))
    stored = 0.5 / expected.FULL + 1e-6  # what 16 bits round off
    np.testing.assert_allclose(np.concatenate(rows), signal, atol=stored)
    if made.levels > 1:
        padded = np.pad(signal, ((0, height % 2), (0, width % 2)), mode="edge")
        means = padded.reshape(padded.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3))
        lower = made.part(made.levels - 2, 0, 0, TILE)
        np.testing.assert_allclose(lower, means[:TILE, :TILE], atol=3 * stored)


def test_a_page_of_20_000_by_14_000_pixels_takes_little_memory(tmp_path: Path) -> None:
    """In a process of its own, whose greatest memory the system tells: levels are written, and a tile is read."""
    program = f"""
        import resource, sys
        import numpy as np
        from pathlib import Path
        from prooflight_console.pictures.expected import Pyramid, write_levels
        from prooflight_console.pictures.tiles import SheetPicture

        def peak():  # of anonymous memory: pages of mapped files are the system's to take back
            status = Path("/proc/self/status").read_text()
            return int(status.split("RssAnon:")[1].split()[0]) / 1024
        begun, most = peak(), 0.0
        row = np.linspace(0, 1, 20_000, dtype=np.float32)
        def band(first, last):
            global most
            most = max(most, peak())
            return np.broadcast_to(row, (last - first, 20_000))
        made = write_levels(Path({str(tmp_path / "page")!r}), band, width=20_000, height=14_000,
                            size_mm=(2000.0, 1400.0))
        most = max(most, peak())
        picture = SheetPicture(width=made.width, height=made.height, width_mm=made.width_mm, height_mm=made.height_mm,
                               levels=made.levels, cuts=(), expected=made)
        for level in range(made.levels):
            assert picture.tile("expected", level, 0, 0)
        assert picture.tile("expected", made.levels - 1, 39, 27)
        assert picture.tile("expected", made.levels - 1, 40, 0) is None
        print(max(most, peak()) - begun)
    """
    ran = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        check=True,
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    whole_mb = 20_000 * 14_000 * 4 / 1e6  # as float32: 1,120 MB
    assert float(ran.stdout) < whole_mb / 4


def picture(cuts: tuple[Cut, ...]) -> SheetPicture:
    return SheetPicture(
        width=1000,
        height=1500,
        width_mm=100.0,
        height_mm=150.0,
        levels=levels_of(1000, 1500),
        cuts=cuts,
        expected=None,
    )


def test_a_cut_lies_where_it_was_seen_at_every_level() -> None:
    dark = Cut(signal=np.zeros((60, 40), np.float32), box_mm=(60.0, 120.0, 4.0, 6.0))
    shown = picture((dark,))
    for level in range(shown.levels):
        scale = 2.0 ** (level - shown.levels + 1)
        whole = np.full(
            (size_at(1500, level, shown.levels), size_at(1000, level, shown.levels), 3), 255, np.uint8
        )
        for row in range(-(-whole.shape[0] // TILE)):
            for column in range(-(-whole.shape[1] // TILE)):
                tile = decoded(shown.tile("scan", level, column, row))
                whole[
                    row * TILE : row * TILE + tile.shape[0], column * TILE : column * TILE + tile.shape[1]
                ] = tile
        found = np.argwhere(whole[..., 0] < 128)
        corners = found.min(axis=0), found.max(axis=0) + 1
        np.testing.assert_allclose(corners, np.array([[1200, 600], [1260, 640]]) * scale, atol=1)


def test_a_defect_draws_its_cut_to_no_other_place(tmp_path: Path) -> None:
    """A dark streak would be matched with the faint line beside it; the line itself is where the page has it."""
    page = np.ones((300, 300), np.float32)
    page[:, 100:108] = page[80:86] = 0.8
    made = write_levels(
        tmp_path / "page",
        lambda first, last: page[first:last],
        width=300,
        height=300,
        size_mm=(30.0, 30.0),
    )
    seen = page[60:120, 80:140].copy()
    seen[:, 29:37] = 0.0
    cut = Cut(signal=seen, box_mm=(7.8, 6.0, 6.0, 6.0), region=0)  # two pixels too far to the left
    streak = Region(x_mm=10.7, y_mm=0.0, width_mm=0.8, height_mm=30.0, score=9.0, kind="streak")
    assert aligned(cut, made, streak).moved_mm == pytest.approx((0.2, 0.0), abs=0.05)
    assert aligned(cut, made).moved_mm[0] < -0.5, "what this test is for"
    everywhere = replace(streak, x_mm=0.0, width_mm=30.0)
    assert aligned(cut, made, everywhere).moved_mm == (0.0, 0.0), "nothing is left that could be matched"


def test_a_cut_over_four_tiles_has_no_seam() -> None:
    ramp = np.tile(np.linspace(0, 1, 200, dtype=np.float32), (200, 1))
    shown = picture((Cut(signal=ramp, box_mm=(41.2, 41.2, 20.0, 20.0)),))
    tiles = [[decoded(shown.tile("scan", shown.levels - 1, c, r)) for c in (0, 1)] for r in (0, 1)]
    whole = np.concatenate([np.concatenate(row, axis=1) for row in tiles])[..., 0].astype(float)
    middle = whole[512, 415:610]
    expected_ramp = 255 * srgb_encoded((np.arange(415, 610) + 0.5 - 412) / 200)
    assert np.abs(middle - expected_ramp).max() < 12  # WebP's loss


def pyramid(folder: Path, signal: NDArray[np.float32]) -> Pyramid:
    """Levels of a page at ten pixels to a millimetre."""
    height, width = signal.shape
    return write_levels(
        folder, lambda a, b: signal[a:b], width=width, height=height, size_mm=(width / 10, height / 10)
    )


@pytest.mark.parametrize("layer", ["scan", "difference"])
def test_beside_what_was_stored_nothing_of_the_expected_page_is_shown(tmp_path: Path, layer: Layer) -> None:
    page = np.random.default_rng(3).random((400, 300)).astype(np.float32)
    cut = Cut(signal=page[100:160, 50:90], box_mm=(5.0, 10.0, 4.0, 6.0), region=0)
    made = pyramid(tmp_path / "page", page)
    shown = SheetPicture(
        width=300, height=400, width_mm=30.0, height_mm=40.0, levels=1, cuts=(cut,), expected=made
    )
    tile = decoded(shown.tile(layer, 0, 0, 0)).astype(int)
    beside = np.ones(tile.shape[:2], bool)
    beside[90:170, 40:100] = False  # WebP blurs the border
    assert np.abs(tile[beside] - UNSEEN_GREY).max() < 8
    inside = tile[110:150, 60:80]
    if layer == "scan":
        wanted = 255 * srgb_encoded(page[110:150, 60:80])
        assert np.abs(inside[..., 0] - wanted).mean() < 25, "WebP's loss on noise"
    else:
        assert inside.min() > 235, "seen as expected"


def test_of_a_whole_scan_too_nothing_is_shown_where_it_ends(tmp_path: Path) -> None:
    page = pyramid(tmp_path / "page", np.full((300, 300), 0.2, np.float32))
    scan = np.full((200, 300), 3000, np.uint16)
    kept = packed({"whole": scan, "whole_mm": np.array([0.0, 0.0, 30.0, 20.0])})
    make_seen(kept, None, None, page, tmp_path / "seen")
    seen = Pyramid.read(tmp_path / "seen")
    assert seen is not None
    shown = SheetPicture(
        width=300, height=300, width_mm=30.0, height_mm=30.0, levels=1, cuts=(), expected=page, seen=seen
    )
    tile = decoded(shown.tile("scan", 0, 0, 0)).astype(int)
    assert tile[:190].min() > 245, "paper"
    assert np.abs(tile[210:] - UNSEEN_GREY).max() < 8


def test_a_thumbnail_is_stretched_to_its_defect_s_contrast_and_a_whole_sheet_is_not() -> None:
    signal = np.full((140, 140), 0.95, np.float32)
    signal[20:26] = 0.05  # text
    signal[:, 64:76] *= 0.97  # a streak of 3 %
    box = (10.0, 20.0, 14.0, 14.0)
    streak = Region(x_mm=16.4, y_mm=0.0, width_mm=1.2, height_mm=297.0, score=9.0, kind="streak")
    stretched = decoded(thumbnail([Cut(signal=signal, box_mm=box, region=0)], [streak], side=140))[..., 0]
    plain = decoded(thumbnail([Cut(signal=signal, box_mm=box)], [], side=140))[..., 0]
    for picture, least, most in ((stretched, 25, 255), (plain, 0, 8)):
        paper, defect = (
            float(np.median(picture[60:, columns])) for columns in (slice(10, 50), slice(66, 74))
        )
        assert least <= paper - defect <= most


def test_places_outside_are_no_tiles() -> None:
    shown = picture(())
    assert shown.layers == ()
    shown = picture((Cut(signal=np.zeros((9, 9), np.float32), box_mm=(0.0, 0.0, 1.0, 1.0)),))
    assert shown.tile("expected", 0, 0, 0) is None
    assert shown.tile("scan", shown.levels, 0, 0) is None
    assert shown.tile("scan", shown.levels - 1, 2, 0) is None
    assert shown.tile("scan", shown.levels - 1, 1, 2) is not None


@pytest.mark.parametrize(
    "spoilt",
    [
        {"cut0_mm": np.array([np.nan, 0, 1, 1])},
        {"cut0_mm": np.array([0, 0, 0, 0])},
        {"cut0_mm": np.array([1e30, 1e30, 1, 1])},
        {"cut0_mm": np.zeros(7)},
        {"cut0": np.zeros((3, 3), np.uint16)},
        {"cut0": np.zeros((1, 0, 5), np.uint16)},
    ],
)
def test_cuts_that_lie_nowhere_are_left_out(tmp_path: Path, spoilt: dict[str, Any]) -> None:
    console = served(tmp_path)
    with Journal.open(str(console.journal)) as journal:
        record = misprint(30)
        assert record.evidence is not None
        odd = {**record.evidence, **spoilt}
        journal.record(1, misprint(30, kept=False).__class__(**{**_fields(record), "evidence": odd}))
    client = console.client(Role.VIEWER)
    told = client.get(f"{API}/runs/1/sheets/30/pictures")
    assert told.status_code == 200
    assert client.get(f"{API}/runs/1/sheets/30/pictures/scan/0/0/0").status_code in (200, 404)
    console.close()


def _fields(record: PageRecord) -> dict[str, Any]:
    return {name: getattr(record, name) for name in PageRecord.__slots__}


def test_what_was_looked_at_longest_ago_goes_first(tmp_path: Path) -> None:
    for age, name in enumerate(("newest", "older", "oldest")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "level00.npy").write_bytes(bytes(1000))
        os.utime(tmp_path / name, (1000 - age, 1000 - age))
    tidy(tmp_path, 2000, keep=tmp_path / "newest")
    assert {path.name for path in tmp_path.iterdir()} == {"newest", "older"}
    tidy(tmp_path, 10, keep=tmp_path / "newest")
    assert {path.name for path in tmp_path.iterdir()} == {"newest"}, "what is asked for stays"


def test_seen_expected_and_difference_of_a_real_misprint(
    tmp_path: Path, press: Press, make_page: Callable[..., Page]
) -> None:
    """A hole in the scan is lighter than expected there and nowhere else, and the scan lies on the page."""
    page = make_page(7)
    job = tmp_path / "job.tif"
    write_tiff(page, job)
    artefact = tmp_path / "rig.press"
    press.save(artefact)
    inspector = Inspector.of(press, "chi-square")
    planned = inspector.planned(page)
    scan = np.rint(planned.expected.expected_dn).astype(np.uint16)
    lines, columns = press.geometry.on_page(page.width_mm, page.height_mm)
    first = lines.start + 100, columns.start + 100
    hole = slice(first[0], first[0] + 40), slice(first[1], first[1] + 40)
    paper = int(press.sensors[0].white_dn)
    scan[0, hole[0], hole[1]] = paper
    inspection = inspector.inspect(page, scan)
    assert inspection.verdict.verdict == "misprint"
    console = served(tmp_path, run=False, presses=(artefact,), jobs=(job,))
    with Journal.open(str(console.journal)) as journal:
        told = facts(job_digest=content_digest(job), press_digest=press.digest, detector="chi-square")
        run = journal.begin_run(told)
        record = PageRecord(
            sheet=0,
            job_page=0,
            verdict=inspection.verdict,
            late=False,
            first_line=0,
            time_s=0.0,
            evidence=evidence_to_store(inspection, page, press),
        )
        journal.record(run, record)
    client = console.client(Role.VIEWER)
    told_pictures = client.get(f"{API}/runs/1/sheets/0/pictures").json()
    assert told_pictures["layers"] == ["scan", "expected", "difference"]
    assert (told_pictures["width_mm"], told_pictures["height_mm"]) == pytest.approx(
        (page.width_mm, page.height_mm), abs=0.2
    )
    top = told_pictures["levels"] - 1
    tiles = {
        layer: decoded(client.get(f"{API}/runs/1/sheets/0/pictures/{layer}/{top}/0/0").content).astype(int)
        for layer in ("scan", "expected", "difference")
    }
    at = slice(105, 135), slice(105, 135)
    assert tiles["scan"][at].min() > 240, "paper"
    assert tiles["expected"][at].mean() < 235
    blue = tiles["difference"][..., 2] - tiles["difference"][..., 0]
    assert blue[at].mean() > 25, "lighter than expected"
    beside = np.ones(blue.shape, bool)
    beside[90:150, 90:150] = False
    assert np.abs(blue[beside]).max() < 60, "nothing else differs: the scan lies where the page does"
    replayed = client.get(f"{API}/runs/1/sheets/0/replay").json()
    assert replayed["same"] is True
    console.close()


def test_a_sheet_that_passed_and_was_drawn_is_shown_whole(
    tmp_path: Path, press: Press, make_page: Callable[..., Page]
) -> None:
    """It lies on its page although the paper had moved and stretched, and differs where something is wrong alone."""
    console = served(tmp_path, run=False, **write_drawn(tmp_path, make_page(7), press))
    client = console.client(Role.OPERATOR)
    first = client.get("/runs/1/sheets/0").text
    assert 'id="coming"' in first, "nobody waits for what takes seconds"
    told_pictures = client.get(f"{API}/runs/1/sheets/0/pictures").json()
    assert (told_pictures["layers"], told_pictures["whole"]) == (["scan", "expected", "difference"], True)
    assert 'id="viewers"' in client.get("/runs/1/sheets/0").text
    top = told_pictures["levels"] - 1
    tiles = {
        layer: decoded(client.get(f"{API}/runs/1/sheets/0/pictures/{layer}/{top}/0/0").content).astype(int)
        for layer in ("scan", "expected", "difference")
    }
    assert np.abs(tiles["scan"] - tiles["expected"]).mean() < 6
    blue = tiles["difference"][..., 2] - tiles["difference"][..., 0]
    row, column = np.unravel_index(int(np.argmax(cv2.blur(blue.astype(np.float32), (9, 9)))), blue.shape)
    assert abs(row - MIDDLE[0]) < 8
    assert abs(column - MIDDLE[1]) < 8
    assert client.get("/runs/1/sheets/0/thumbnail").headers["content-type"] == "image/webp"
    console.close()


def test_a_page_that_cannot_be_pictured_is_shown_without_and_tried_once(
    tmp_path: Path, press: Press, caplog: pytest.LogCaptureFixture
) -> None:
    job, artefact = tmp_path / "job.tif", tmp_path / "rig.press"
    job.write_bytes(b"no picture at all")
    press.save(artefact)
    console = served(tmp_path, run=False, presses=(artefact,), jobs=(job,))
    with Journal.open(str(console.journal)) as journal:
        told = facts(job_digest=content_digest(job), press_digest=press.digest, detector="chi-square")
        journal.record(journal.begin_run(told), misprint(10))
    client = console.client(Role.VIEWER)
    for _ in range(2):
        answer = client.get(f"{API}/runs/1/sheets/10/pictures").json()
        assert (answer["layers"], answer["note"]) == (["scan"], "no-picture")
        console.console.pictures._sheets.clear()
    assert caplog.text.count("page 11 of job.tif cannot be pictured") == 1
    console.close()


def test_a_blank_sheet_has_its_picture_and_its_title(tmp_path: Path, press: Press) -> None:
    console = served(tmp_path, run=False)
    scan = np.full((1, 480, 400), 3000, np.uint16)
    blank = SeenPage(scan=scan, first_line=0, last_line_time_s=1.0, job_page=None, faults=(BLANK,))
    with Journal.open(str(console.journal)) as journal:
        run = journal.begin_run(facts())
        for sheet, evidence in ((60, scan_to_store(scan, press)), (61, None)):
            journal.record(run, unknown_sheet(sheet, blank, stored_evidence=evidence).record)
    client = console.client(Role.VIEWER)
    told = client.get(f"{API}/runs/1/sheets/60/pictures").json()
    assert (told["layers"], told["whole"], told["note"]) == (["scan"], True, "no-page")
    assert told["width_mm"] == pytest.approx(400 * press.geometry.pixel_pitch_mm)
    assert decoded(client.get(f"{API}/runs/1/sheets/60/pictures/scan/0/0/0").content).min() > 240
    assert client.get("/runs/1/sheets/60/thumbnail").headers["content-type"] == "image/webp"
    page = client.get("/runs/1/sheets/60").text
    assert "Sheet 60 · no page of the job" in page
    assert "sheet 60" not in page.lower().replace("sheet 60 · no page of the job", "").split("<h2>")[1]
    nothing = client.get(f"{API}/runs/1/sheets/61/pictures").json()
    assert nothing["layers"] == []
    assert "No picture of this sheet is stored" in client.get("/runs/1/sheets/61").text
    console.close()


def test_the_cut_of_a_run_without_its_job_is_shown_on_an_empty_page(tmp_path: Path) -> None:
    console = served(tmp_path)
    client = console.client(Role.VIEWER)
    told = client.get(f"{API}/runs/1/sheets/10/pictures").json()
    assert (told["layers"], told["note"]) == (["scan"], "no-job")
    assert told["cuts"] == [{"box_mm": list(CUT_MM)}]
    assert client.get("/runs/1/sheets/10/thumbnail").headers["content-type"] == "image/webp"
    console.close()
