"""The report: every page is there, every alarm can be seen, nothing is loaded from elsewhere."""

from __future__ import annotations

import base64
import io
import pickle
import re
from dataclasses import replace
from html.parser import HTMLParser
from typing import TYPE_CHECKING

import pytest
from PIL import Image

from prooflight.cli.imposition import of_job
from prooflight.inspection.inspector import Inspector
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan
from prooflight.reporting.report import (
    PAGE_PICTURE_PX,
    PageEntry,
    RunSummary,
    counts,
    page_entry,
    write_report,
)
from prooflight.reporting.visibility_picture import VisibleOnPage
from prooflight.reporting.wording import mark_size
from prooflight.rng import stream
from prooflight.simulation.scans import MisprintRequest, scan_page

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

SUMMARY = RunSummary(
    job="leaflet",
    press="small",
    press_digest="c0ffee" * 10,
    guarantee="one good page in 1,000 alarms",
    world="ideal",
    seed=7,
    date="2001-02-03",
    pages_per_s=0.5,
)
VOID = {"meta", "link", "img", "br"}


class Burning:
    """A score of which nothing can be written."""

    def __abs__(self) -> float:
        raise ArithmeticError("burn")


class Element:
    def __init__(self, tag: str, attributes: dict[str, str]) -> None:
        self.tag, self.attributes = tag, attributes
        self.children: list[Element] = []
        self.words: list[str] = []

    def __iter__(self):  # type: ignore[no-untyped-def]
        yield self
        for child in self.children:
            yield from child

    def all(self, tag: str, style: str = "") -> list[Element]:
        wanted = set(style.split())
        return [e for e in self if e.tag == tag and wanted <= set(e.attributes.get("class", "").split())]

    def one(self, name: str) -> Element:
        (found,) = (e for e in self if e.attributes.get("id") == name)
        return found

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


class Reader(HTMLParser):
    """Elements with all the text inside them; fails on elements that are not closed."""

    def __init__(self) -> None:
        super().__init__()
        self.root = Element("root", {})
        self.open = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, {key: value or "" for key, value in attrs})
        self.open[-1].children.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop().tag == tag

    def handle_data(self, data: str) -> None:
        for element in self.open:
            element.words.append(data)


def read(path: Path) -> Element:
    reader = Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    assert reader.open == [reader.root]
    return reader.root


def entry_of(page: Page, press: Press, request: MisprintRequest | None, title: str = "") -> PageEntry:
    scan = scan_page(
        page,
        press=press,
        request=request,
        others=(),
        fetch=lambda _number: page,
        rng=stream(3, "print", page.number),
    )
    inspection = Inspector.of(press, "chi-square").inspect(page, scan.dn)
    return page_entry(page, inspection, press, truth=scan.misprint, title=title)


@pytest.fixture(scope="module")
def run(press: Press, make_page: Callable[..., Page]) -> list[PageEntry]:
    """A good page, a streak, missing content, a good page, and one without scan."""
    requests = {
        2: MisprintRequest(kind="streak", severity=0.9),
        3: MisprintRequest(kind="missing-content", severity=0.1),
    }
    entries = []
    for number in (1, 2, 3, 4):
        request = requests.get(number)
        entries.append(entry_of(make_page(number, number=number), press, request, title=f"Sheet {number}"))
    entries.append(page_entry(make_page(5, number=5), None, press))
    assert [entry.verdict.verdict for entry in entries] == [
        "good", "misprint", "misprint", "good", "not-inspected",
    ]  # fmt: skip
    return entries


@pytest.fixture(scope="module")
def twisted(run: list[PageEntry]) -> list[PageEntry]:
    """The same run, had the streak been missed and page 4 alarmed."""
    good, streak, content, fourth, unseen = run
    missed = replace(streak, verdict=replace(good.verdict, page=streak.name))
    alarmed = replace(
        fourth, alarm=content.alarm, verdict=replace(content.verdict, page=fourth.name, regions=(), kind=None)
    )
    return [good, missed, content, alarmed, unseen]


def written(folder: Path, entries: list[PageEntry], summary: RunSummary = SUMMARY) -> Element:
    write_report(folder / "report.html", entries, summary)
    return read(folder / "report.html")


def test_every_page_is_pictured_and_listed_in_order(tmp_path: Path, run: list[PageEntry]) -> None:
    report = written(tmp_path, run)
    sheets = report.one("pages").all("li")
    words = ["good", "misprint", "misprint", "good", "not inspected"]
    assert [sheet.text.split(" ")[0] for sheet in sheets] == ["1", "2", "3", "4", "5"]
    for sheet, word in zip(sheets, words, strict=True):
        assert word in sheet.text
        assert len(sheet.all("img")) == 1
    rows = report.one("figures").all("tr")[1:]
    assert [row.children[0].text for row in rows] == ["1", "2", "3", "4", "5"]
    assert [row.children[3].text for row in rows] == words


def test_every_alarm_has_three_pictures_with_each_place_boxed_on_each(
    tmp_path: Path, run: list[PageEntry]
) -> None:
    articles = written(tmp_path, run).one("alarms").all("article")
    alarmed = [entry for entry in run if entry.alarmed]
    assert [article.attributes["id"] for article in articles] == ["sheet2", "sheet3"]
    for article, entry in zip(articles, alarmed, strict=True):
        (trio,) = article.all("div", "pictures")
        plates = trio.all("div", "plate")
        assert len(plates) == 3
        places = entry.verdict.regions
        assert places
        for plate in plates:
            found = plate.all("i", "box found")
            assert [box.text for box in found] == [str(n) for n in range(1, len(places) + 1)]
        assert len(trio.all("i", "box true")) == 1
        assert len(article.all("div", "zoom")) == 2
        (table,) = article.all("table", "places")
        assert len(table.all("tr")) == 1 + len(places)
        assert f"{places[0].x_mm:.1f}" in table.text
        assert entry.truth is not None
        assert f"Printed on purpose: {entry.truth.detail}" in article.text


def test_sheets_and_sets_stand_above_their_sides_and_lead_to_them(
    tmp_path: Path, run: list[PageEntry]
) -> None:
    sides = [replace(run[at], number=number) for number, at in enumerate((0, 3, 1, 4), start=1)]
    layout = Layout.parse("sides=2,pages-a-set=2").of(4)
    plan = SheetPlan(layout=layout, sides=4, sheets=2)
    found = of_job(plan, [side.verdict for side in sides])
    write_report(tmp_path / "report.html", sides, replace(SUMMARY, world=None), sheets=found)
    report = read(tmp_path / "report.html")
    rows = report.one("sheets").all("tr")[1:]
    assert [[row.children[at].text for at in (0, 1, 2, 3, 5)] for row in rows] == [
        ["s0001", "1, 2", "0", "good", ""],
        ["s0002", "3, 4", "1", "misprint", "3, 4"],
    ]
    assert "p0004 not inspected" in rows[1].children[4].text
    assert rows[1].children[6].text.startswith("front: ")
    sets = report.one("sets").all("tr")[1:]
    assert [[cell.text for cell in row.children[:4]] for row in sets] == [
        ["0", "good", "may be delivered", "s0001 good"],
        ["1", "misprint", "not as it is", "s0002 misprint"],
    ]
    named = {element.attributes["id"] for element in report if "id" in element.attributes}
    links = [link.attributes["href"] for row in rows for link in row.all("a")]
    assert links == ["#set0", "#row1", "#row2", "#set1", "#sheet3", "#row4"]
    links += [link.attributes["href"] for row in sets for link in row.all("a")]
    assert links[-2:] == ["#of-sheet0", "#of-sheet1"]
    assert {link.removeprefix("#") for link in links} <= named
    assert "1 of 2 sheets are good" in report.text
    assert "1 of 2 sets may be delivered" in report.text
    assert "3 sides inspected: 2 passed as good" in report.text
    assert all(entry.attributes.get("id") != "sheets" for entry in written(tmp_path, run))


def test_boxes_lie_around_the_true_place(tmp_path: Path, run: list[PageEntry]) -> None:
    streak = run[1]
    assert streak.truth is not None
    (article, _) = written(tmp_path, run).one("alarms").all("article")
    (box,) = article.all("i", "box true")
    left, _, width, _ = map(float, re.findall(r"([\d.]+)%", box.attributes["style"]))
    x, _, wide, _ = streak.truth.region_mm
    # the pictures leave out parts of a pixel at the page's edges: 0.1 mm
    assert left / 100 * streak.size_mm[0] == pytest.approx(x, abs=0.25)
    assert width / 100 * streak.size_mm[0] == pytest.approx(wide, abs=0.25)
    (found,) = article.all("div", "pictures")[0].children[0].all("i", "box found")
    middle_left, _, middle_width, _ = map(float, re.findall(r"([\d.]+)%", found.attributes["style"]))
    found_mm = (middle_left + middle_width / 2) / 100 * streak.size_mm[0]
    assert found_mm == pytest.approx(x + wide / 2, abs=1.7)  # two blocks


def test_counts_and_headline_agree(tmp_path: Path, run: list[PageEntry]) -> None:
    count = counts(run)
    assert (count.pages, count.good, count.alarms, count.stopped, count.not_inspected) == (5, 2, 2, 2, 1)
    assert (count.misprints, count.caught, count.missed, count.false_alarms) == (2, 2, 0, 0)
    (title,) = written(tmp_path, run).all("h1")
    assert title.text == (
        "4 pages inspected: 2 passed as good, 2 stopped as misprints; 1 more page had no scan and is held."
    )


def test_missed_misprints_and_false_alarms_are_shown_as_such(
    tmp_path: Path, twisted: list[PageEntry]
) -> None:
    count = counts(twisted)
    assert (count.misprints, count.caught, count.missed, count.false_alarms) == (2, 1, 1, 1)
    report = written(tmp_path, twisted)
    assert (
        "2 misprints printed on purpose, 1 caught, 1 missed, 1 false alarm." in report.all("header")[0].text
    )
    (missed,) = report.one("missed").all("article")
    assert missed.attributes["id"] == "sheet2"
    assert len(missed.all("div", "plate")) == 5
    assert twisted[1].truth is not None
    assert twisted[1].truth.detail in missed.text
    alarms = report.one("alarms").all("article")
    assert [alarm.attributes["id"] for alarm in alarms] == ["sheet3", "sheet4"]
    assert "false alarm" in alarms[1].text
    assert "false alarm" not in alarms[0].text
    sheets = report.one("pages").all("li")
    assert "missed" in sheets[1].text
    assert "false alarm" in sheets[3].text


def test_a_real_run_claims_no_truth(tmp_path: Path, twisted: list[PageEntry]) -> None:
    real = [replace(entry, truth=None) for entry in twisted]
    report = written(tmp_path, real, replace(SUMMARY, world=None, seed=None))
    for word in ("on purpose", "simulat", "false alarm", "Truth", "seed", "caught"):
        assert word not in report.text
    assert len(report.one("alarms").all("article")) == 2
    assert not [element for element in report if element.attributes.get("id") == "missed"]


def test_pages_without_scan_are_said_to_be_uninspected(tmp_path: Path, run: list[PageEntry]) -> None:
    assert run[4].alarm is None
    report = written(tmp_path, run)
    sheet = report.one("pages").all("li")[4]
    assert "not-inspected" in sheet.attributes["class"]
    assert sheet.all("a")[0].attributes["href"] == "#row5"
    assert report.one("row5").children[4].text == "–"
    (title,) = written(tmp_path, run[4:]).all("h1")
    assert title.text == "No page inspected; 1 page had no scan."


def test_names_are_text_and_never_markup(tmp_path: Path, run: list[PageEntry]) -> None:
    nasty = "\"><script>alert(1)</script><b title='&amp;"
    entries = [replace(entry, title=nasty, name=nasty) for entry in run]
    report = written(tmp_path, entries, replace(SUMMARY, job=nasty, press=nasty, guarantee=nasty))
    assert not report.all("script")
    assert nasty in report.one("row1").text
    assert nasty in report.all("header")[0].text
    assert all(nasty in image.attributes["alt"] for image in report.one("pages").all("img"))


def test_nothing_is_loaded_from_elsewhere(tmp_path: Path, twisted: list[PageEntry]) -> None:
    report = written(tmp_path, twisted)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    without_pictures = re.sub(r"data:image/webp;base64,[\w+/=]+", "data:", text)
    assert not re.search(r"https?:|//[a-z]|url\(|@import|srcset", without_pictures)
    for element in report:
        for key in ("src", "href"):
            assert element.attributes.get(key, "data:").startswith(("data:", "#"))
        assert element.tag != "script"
    assert len(text) < 2e6


def test_links_lead_somewhere_and_ids_are_unique(tmp_path: Path, twisted: list[PageEntry]) -> None:
    copies = twisted + [replace(entry, name=entry.name + "-2") for entry in twisted]
    report = written(tmp_path, copies)
    ids = [element.attributes["id"] for element in report if "id" in element.attributes]
    assert len(ids) == len(set(ids))
    links = [element.attributes["href"] for element in report.all("a")]
    assert len(links) >= len(copies)
    assert {link.removeprefix("#") for link in links} <= set(ids)


def test_every_picture_opens_and_says_what_it_shows(tmp_path: Path, run: list[PageEntry]) -> None:
    for image in written(tmp_path, run).all("img"):
        head, data = image.attributes["src"].split(",", 1)
        assert head == "data:image/webp;base64"
        assert Image.open(io.BytesIO(base64.b64decode(data))).size[0] > 10
        assert image.attributes["alt"] or image.attributes["class"] == "thumb"


def test_a_report_that_fails_leaves_the_former_one(tmp_path: Path, run: list[PageEntry]) -> None:
    written(tmp_path, run)
    before = (tmp_path / "report.html").read_bytes()
    broken = [run[0], replace(run[1], verdict=replace(run[1].verdict, score=Burning()))]  # type: ignore[arg-type]
    with pytest.raises(Exception, match="burn"):
        write_report(tmp_path / "report.html", broken, SUMMARY)
    assert (tmp_path / "report.html").read_bytes() == before
    write_report(tmp_path / "report.html", run[:1], SUMMARY)
    assert (tmp_path / "report.html").read_bytes() != before
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_the_same_run_gives_the_same_file(tmp_path: Path, run: list[PageEntry]) -> None:
    for name in ("a", "b"):
        write_report(tmp_path / name, run, SUMMARY)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_entries_travel_between_processes_and_are_small(run: list[PageEntry]) -> None:
    for entry in run:
        data = pickle.dumps(entry)
        assert pickle.loads(data) == entry
        assert len(data) < 400_000
        assert Image.open(io.BytesIO(entry.picture)).size[0] == PAGE_PICTURE_PX


def test_good_pages_carry_no_pictures_of_the_camera(run: list[PageEntry]) -> None:
    assert [entry.alarm is not None for entry in run] == [False, True, True, False, False]


def test_what_would_be_caught_is_shown_with_the_floor(
    tmp_path: Path, run: list[PageEntry], trained_press: Press, make_page: Callable[..., Page]
) -> None:
    page = make_page(7)
    assert VisibleOnPage.of(Inspector.of(trained_press, "chi-square"), page) is None
    visible = VisibleOnPage.of(Inspector.of(trained_press), page)
    assert visible is not None
    with Image.open(io.BytesIO(visible.picture)) as picture:
        assert picture.format == "WEBP"
        assert picture.width > picture.height > 300
    write_report(tmp_path / "report.html", run, SUMMARY, visible=visible)
    section = read(tmp_path / "report.html").one("visible")
    rows = [[cell.text for cell in row.children] for row in section.all("tr")[1:]]
    assert [row[0] for row in rows] == [row.place for row in visible.rows]
    assert rows[0][2] == mark_size(visible.rows[0].spot_mm)
    assert "a flat place over 0.1 mm² that differs by more than 10 % of paper white is always" in section.text
    assert all(entry.attributes.get("id") != "visible" for entry in written(tmp_path, run))
