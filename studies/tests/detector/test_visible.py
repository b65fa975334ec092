"""The study of visible marks: what is drawn has its size and place, and figures are those of rows."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import special

from prooflight.detectors.matched_filter.entry import model_of
from prooflight.errors import RequestError
from prooflight.pages.raster import Page
from prooflight.scans.geometry import ScanGeometry
from prooflight.scans.placement import Placement
from prooflight_studies.commands.marks import visible
from prooflight_studies.harness.psychometric import Psychometric
from prooflight_studies.visible import findings, marks, rig, study
from prooflight_studies.visible.rig import Camera
from prooflight_studies.visible.rows import (
    MEASURES,
    TABLE,
    CurveWork,
    PageVariation,
    in_place,
    local_difference,
)
from prooflight_studies.visible.sheets import (
    AREAS_MM,
    CLEAR_MM,
    SIZES_PT,
    TINT_SHARE,
    PlacesPage,
    bare,
    edge_length_m,
    flat_tint,
    near_text,
    nearly_blank,
    slip_of,
    somewhere,
)

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press

DPI = 254.0
"""A pixel is 0.1 mm."""
CAMERA = Camera(sensors=1, pitch_mm=0.508)


def blank(width_mm: float = 40.0, height_mm: float = 50.0) -> Page:
    shape = (round(height_mm * 10), round(width_mm * 10), 4)
    return Page(cmyk=np.zeros(shape, np.uint8), dpi=DPI, name="p0001", number=1)


def inked(page: Page, box: tuple[int, int, int, int], ink: tuple[int, int, int, int]) -> Page:
    """With a rectangle (top, left, bottom, right) of an ink. [mm]"""
    cmyk = page.cmyk.copy()
    top, left, bottom, right = (10 * each for each in box)
    cmyk[top:bottom, left:right] = ink
    return replace(page, cmyk=cmyk)


def area_mm2(page: Page, other: Page) -> float:
    """Of what two pages differ in, by the share of full ink."""
    off = np.abs(page.cmyk.astype(float) - other.cmyk.astype(float)).max(axis=2)
    return float(off.sum() / 255) * page.pixel_mm**2


@pytest.mark.parametrize("diameter_mm", [0.4, 0.8, 4.0])
def test_a_spot_has_its_area_and_contrast_and_its_middle(diameter_mm: float) -> None:
    page, rng = blank(), np.random.default_rng(1)
    spotted = marks.spot(page, (12.3, 20.7), diameter_mm=diameter_mm, rng=rng)
    expected = 0.9 * np.pi * diameter_mm**2 / 4
    assert area_mm2(page, spotted) == pytest.approx(expected, rel=0.06)
    rows, columns = np.nonzero(spotted.cmyk[..., 3])
    middle = (columns.mean() + 0.5) * 0.1, (rows.mean() + 0.5) * 0.1
    assert middle == pytest.approx((12.3, 20.7), abs=0.05)
    assert not spotted.cmyk[..., :3].any()


def test_a_void_a_scratch_a_band_and_fainter_ink_leave_so_much_ink() -> None:
    page = inked(blank(), (0, 0, 50, 40), (102, 0, 0, 204))
    rng, at = np.random.default_rng(2), (20.0, 25.0)
    kinds = marks.KINDS
    drawn = {name: kinds[name].draw for name in ("void", "scratch", "band", "local density")}
    levels = {"void": 2.0, "scratch": 10.0, "band": 50.0, "local density": 25.0}
    lost = {}
    for name, draw in drawn.items():
        assert draw is not None
        after = draw(page, at, levels[name], False, rng)
        assert (after.cmyk <= page.cmyk).all()
        lost[name] = float((page.cmyk.astype(float) - after.cmyk)[..., 3].sum()) / 204 * 0.01
    expected = {"void": np.pi, "scratch": 1.5, "band": 20.0, "local density": 16.0}
    assert lost == pytest.approx(expected, rel=0.02)


def test_blur_keeps_ink_and_takes_sharpness() -> None:
    page = inked(blank(), (20, 18, 30, 20), (0, 0, 0, 255))
    after = marks.blurred(page, (20.0, 25.0), sigma_mm=0.3, rng=np.random.default_rng(3))
    assert after.cmyk.sum(dtype=float) == pytest.approx(page.cmyk.sum(dtype=float), rel=0.01)
    steps = [np.abs(np.diff(each.cmyk[250, :, 3].astype(int))).max() for each in (page, after)]
    assert steps[0] == 255
    assert steps[1] < 60


@pytest.mark.parametrize("named", marks.NAMED, ids=lambda one: one.name)
def test_named_marks_stay_within_their_reach(named: marks.NamedMark) -> None:
    page, at = blank(), (20.0, 25.0)
    after = named.draw(page, at, np.random.default_rng(4))
    rows, columns = np.nonzero((after.cmyk != page.cmyk).any(axis=2))
    assert rows.size
    away = np.hypot((columns + 0.5) * 0.1 - at[0], (rows + 0.5) * 0.1 - at[1])
    assert away.max() <= named.reach_mm + 0.2


def test_marks_on_bare_paper_are_far_from_ink_and_from_the_page_s_edges() -> None:
    page = inked(blank(), (0, 0, 20, 40), (0, 0, 0, 255))
    rows, columns = np.nonzero(bare(page, 1.0))
    assert rows.min() * 0.1 == pytest.approx(20 + 1.0 + CLEAR_MM, abs=0.2)
    assert columns.min() * 0.1 == pytest.approx(1.0 + CLEAR_MM, abs=0.2)
    assert rows.max() * 0.1 == pytest.approx(50 - 1.0 - CLEAR_MM, abs=0.2)
    assert somewhere(page, bare(page, 15.0), np.random.default_rng(0)) is None


@pytest.mark.parametrize(
    ("ink", "is_tint"),
    [((0, 0, 0, 100), True), ((60, 60, 0, 0), True), ((0, 0, 0, 255), False), ((0, 0, 0, 0), False)],
)
def test_a_tint_is_light_and_even(ink: tuple[int, int, int, int], is_tint: bool) -> None:
    page = inked(blank(), (10, 10, 40, 30), ink)
    found = flat_tint(page, 1.0)
    assert found.any() == is_tint
    if is_tint:
        rows, columns = np.nonzero(found)
        assert (rows.min() * 0.1, columns.min() * 0.1) == pytest.approx((13.0, 13.0), abs=0.2)
        cut = page.cmyk.copy()
        cut[240:260] = 0
        assert not flat_tint(replace(page, cmyk=cut), 1.0)[220:280].any()


def test_marks_beside_text_are_beside_letters_and_not_beside_pictures() -> None:
    letter = inked(blank(), (10, 10, 12, 12), (0, 0, 0, 255))
    picture = inked(blank(), (10, 10, 30, 30), (0, 0, 0, 255))
    rows, columns = np.nonzero(near_text(letter, 0.5))
    away = np.hypot(
        np.maximum(np.abs((columns + 0.5) * 0.1 - 11) - 1, 0),
        np.maximum(np.abs((rows + 0.5) * 0.1 - 11) - 1, 0),
    )
    assert away.min() > 1.6
    assert away.max() < 3.1
    assert not near_text(picture, 0.5).any()


def test_the_difficulty_of_a_page_is_the_length_of_its_edges() -> None:
    page = inked(blank(), (10, 10, 40, 30), (0, 0, 0, 255))
    assert edge_length_m(page) == pytest.approx(0.1)  # 2 (20 + 30) mm
    assert edge_length_m(inked(blank(), (10, 10, 40, 30), (0, 0, 0, 60))) == 0


@pytest.mark.parametrize("index", range(3))
def test_nearly_blank_pages_are_nearly_blank(index: int) -> None:
    page = nearly_blank(1, index, dpi=100)
    assert 0 < (page.packed != 0).mean() < 0.06


def test_a_page_of_all_places_has_them_all() -> None:
    composed = PlacesPage.composed(1, 0, dpi=DPI)
    parts = {
        name: composed.page.cmyk[10 * int(top) : 10 * int(bottom), 10 * int(left) : 10 * int(right)]
        for name, (left, top, right, bottom) in AREAS_MM.items()
    }
    assert not parts["paper"].any()
    assert not parts["border of paper"].any()
    tints = np.unique(
        np.concatenate([parts["tint"].reshape(-1, 4), parts["border of tint"].reshape(-1, 4)]), axis=0
    )
    assert len(tints) == 1
    assert set(tints[0].tolist()) <= {0, round(255 * TINT_SHARE)}
    assert 0 < (parts["text"] > 0).any(axis=2).mean() < 0.5
    assert len(np.unique(parts["photo"].reshape(-1, 4), axis=0)) > 100
    assert {size for letter, size in composed.letters if letter.isalpha()} == set(SIZES_PT)


def test_marks_that_take_ink_away_lie_on_ink_and_the_others_in_their_place() -> None:
    composed, rng = PlacesPage.composed(1, 1, dpi=DPI), np.random.default_rng(5)
    for kind in marks.KINDS.values():
        if kind.draw is None:
            continue
        for place in kind.places:
            x, y = composed.point(place, kind.extent_mm, rng, takes=kind.takes)
            if kind.takes:
                assert composed.page.cmyk[int(y * 10), int(x * 10)].any()
            elif place == "paper":
                after = kind.draw(composed.page, (x, y), kind.levels[1] / 2, False, rng)
                assert (after.cmyk != composed.page.cmyk).any(axis=2)[:, 490:].any()
            if place == "border":
                assert min(x, 90 - x) <= 3


@pytest.mark.parametrize("missing", [False, True])
def test_a_slip_changes_one_letter_of_its_size(missing: bool) -> None:
    composed, rng = PlacesPage.composed(1, 2, dpi=DPI), np.random.default_rng(6)
    slip = slip_of(composed.letters, 8.0, missing=missing, rng=rng)
    other = PlacesPage.composed(1, 2, dpi=DPI, slip=slip)
    assert other.letters == composed.letters
    assert composed.letters[slip.letter][1] == 8.0
    rows, columns = np.nonzero((other.page.cmyk != composed.page.cmyk).any(axis=2))
    assert 0 < max(np.ptp(rows), np.ptp(columns)) * 0.1 < 4.0
    if missing:
        assert (other.page.cmyk <= composed.page.cmyk).all()


def test_the_variation_model_is_mean_and_spread_and_a_floor() -> None:
    rng = np.random.default_rng(7)
    prints = [rng.normal(1000, 5, (1, 40, 50)).astype(np.float32) for _ in range(30)]
    model = PageVariation.learn(prints)
    assert model.mean == pytest.approx(np.mean(prints, axis=0), rel=1e-5)
    assert model.spread == pytest.approx(np.std(prints, axis=0, ddof=1), rel=1e-3)
    odd = model.mean.copy()
    odd[0, 10, 10:13] += 300  # three pixels are too few
    assert model.score(odd, [1000.0], 0.02) == 0
    odd[0, 11, 10] += 200
    assert model.score(odd, [1000.0], 0.02) == pytest.approx(10, rel=1e-3)


def test_a_print_off_its_place_is_laid_in_place() -> None:
    pitch = 0.25
    geometry = ScanGeometry(
        pixels=200, pixel_pitch_mm=pitch, line_pitch_mm=pitch, lead_in_mm=2.0, lead_out_mm=2.0
    )
    page = blank(30.0, 40.0)
    lines = geometry.lines(page.height_mm)
    placement = Placement(shift_mm=(0.6, -0.4), skew_deg=0.1)
    x, y = np.meshgrid(geometry.centres_x_mm(page.width_mm), geometry.centres_y_mm(lines))
    seen_x, seen_y = placement.seen_mm(x, y, page_width_mm=page.width_mm, page_height_mm=page.height_mm)
    area = (slice(5, lines - 3), slice(10, 190))

    def printed(x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        return 2000 + 20 * x_mm + 9 * y_mm

    inspection = SimpleNamespace(
        planned=SimpleNamespace(page=page),
        placement=placement,
        area=area,
        measured_dn=np.rint(printed(seen_x, seen_y)).astype(np.uint16)[None, *area],
    )
    laid = in_place(inspection, SimpleNamespace(geometry=geometry))  # type: ignore[arg-type]
    rows, columns = geometry.on_page(page.width_mm, page.height_mm)
    expected = printed(x, y)[rows, columns]
    inner = (slice(4, -4), slice(4, -4))
    assert (
        np.abs(laid[0][inner] - expected[inner]).max() < 1.2
    )  # half a number of rounding, and interpolation


def test_the_difference_is_the_worst_square_s_of_the_worst_sensor() -> None:
    expected = np.full((2, 30, 30), 1000, np.float32)
    measured = expected.astype(np.uint16)
    measured[1, 10:13, 10:13] -= 100
    assert local_difference(measured, expected, white_dn=[2000, 1000], side=3) == pytest.approx(0.1)
    assert local_difference(measured, expected, white_dn=[2000, 1000], side=1) == pytest.approx(0.1)
    assert local_difference(measured, expected, white_dn=[2000, 1000], side=5) == pytest.approx(0.036)


@pytest.mark.parametrize("alarms", [0, 2])
def test_every_method_alarms_as_often_as_ours(alarms: int) -> None:
    scores = np.random.default_rng(8).random((50, len(MEASURES)))
    assert ((scores > findings.tolerances(scores, alarms)).sum(axis=0) == alarms).all()


def test_another_method_is_better_beyond_chance_alone() -> None:
    matched_filter = np.zeros(20, bool)
    theirs = matched_filter.copy()
    theirs[:4] = True
    assert not findings.better(theirs, matched_filter)  # 1 in 16
    theirs[:5] = True
    assert findings.better(theirs, matched_filter)  # 1 in 32
    assert not findings.better(matched_filter, theirs)


def test_what_is_known_of_another_page_holds_what_its_prints_were_drawn_by() -> None:
    rng, middle, spread = np.random.default_rng(9), np.log(40.0), 0.3
    seen = Psychometric.unknown(0.01)
    for page in range(6):
        for strength in np.repeat(np.geomspace(10, 300, 8), 4):
            chance = 0.01 + 0.988 * special.ndtr((np.log(strength) - middle) / spread)
            seen = seen.seen(page, float(strength), caught=bool(rng.random() < chance))
    for chance in findings.CHANCES:
        low, value, high = seen.strengths(findings.ANY_PAGE, chance, findings.INTERVAL)
        truth = np.exp(middle + spread * special.ndtri(chance))
        assert low <= truth <= high
        assert value == pytest.approx(truth, rel=0.35)


def table_rows() -> dict[str, np.ndarray]:
    """Ten prints of the first mark, nine of them caught, and 100 good ones, of which the most difficult alarms."""
    good = 100
    return {
        "mark": np.array([TABLE[0].name] * 10 + [""] * good),
        "source": np.array(["design"] * 10 + ["design"] * 90 + ["blank"] * 10),
        "alarm": np.array([True] * 9 + [False] + [at == 89 for at in range(good)]),
        "uninspected": np.zeros(110, bool),
        "edges_m": np.concatenate([np.full(10, 50.0), np.arange(good)]),
        "ink": np.full(110, 0.2),
    }


def test_the_table_counts_its_prints() -> None:
    first, *others = findings.caught_of(table_rows(), TABLE)
    assert (first.prints, first.caught) == (10, 9)
    assert first.at_least == pytest.approx(special.betaincinv(9, 2, 0.05), abs=1e-6)  # Clopper and Pearson
    assert all(one.prints == 0 for one in others)


def test_good_prints_are_counted_by_quintile_of_composed_designs() -> None:
    every, *quintiles, few, nearly = findings.good_prints(table_rows())
    assert (every.prints, every.alarms) == (90, 1)
    assert [one.prints for one in quintiles] == [18] * 5
    assert [one.alarms for one in quintiles] == [0, 0, 0, 0, 1]
    assert (few.prints, nearly.prints, nearly.alarms) == (0, 10, 0)


def test_cells_count_the_prints_that_each_method_caught() -> None:
    levels = np.tile(marks.levels_of("spot", 8), 4)
    good, prints = 20, levels.size
    peers = np.zeros((good + prints, len(MEASURES)))
    peers[:good] = np.linspace(0, 1, good)[:, None]
    peers[good:, 1] = 2.0 * (levels > 0.5)  # differences of 3 x 3 pixels, alone
    rows = {
        "camera": np.full(good + prints, CAMERA.number),
        "page": np.concatenate([np.zeros(good, int), np.repeat(np.arange(4), 8)]),
        "kind": np.array([""] * good + ["spot"] * prints),
        "place": np.array([""] * good + ["paper"] * prints),
        "level": np.concatenate([np.zeros(good), levels]),
        "alarm": np.concatenate([np.zeros(good, bool), levels > 1.5]),
        "uninspected": np.zeros(good + prints, bool),
        "peers": peers,
    }
    (curves,) = findings.curves_of(rows, {CAMERA.number: CAMERA}, learned=30)
    assert (curves.pages, curves.good, curves.alarms, curves.worse) == (4, good, 0, 1)
    matched_filter, difference, ssim, variation = curves.cells[0].methods
    assert [one.caught for one in (matched_filter, difference, ssim, variation)] == [8, 20, 0, 0]
    assert difference.setting == MEASURES[1]
    assert [one.better for one in (matched_filter, difference, ssim, variation)] == [
        False,
        True,
        False,
        False,
    ]
    assert 1.0 < matched_filter.at[0].value < 2.2 < matched_filter.at[2].value
    assert 0.35 < difference.at[0].value < 0.65
    assert ssim.at[0].value > 3.2


def test_marks_are_printed_on_the_first_designs_that_have_a_place() -> None:
    places = {
        "design": np.array([3, 3, 5, 8, 9]),
        "name": np.array([TABLE[0].name, TABLE[1].name, TABLE[0].name, TABLE[0].name, TABLE[1].name]),
    }
    counts = {TABLE[0].name: 3, TABLE[1].name: 3}
    pages = study.scheduled(places, counts, copies=2)
    assert [(one.index, dict(one.marks)) for one in pages] == [
        (3, {TABLE[0].name: 2, TABLE[1].name: 2}),
        (5, {TABLE[0].name: 1}),
        (9, {TABLE[1].name: 1}),
    ]


def test_levels_of_letters_are_sizes_that_the_page_has() -> None:
    for levels in (1, 2, 8):
        work = CurveWork(presses={}, seed=1, levels=levels, learned=2, good=1)
        assert set(work.levels_of("wrong glyph")) <= set(SIZES_PT)
        assert len(work.levels_of("wrong glyph")) == len(work.levels_of("spot")) == levels


def test_a_small_study_writes_its_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trained_press: Press
) -> None:
    model = model_of(trained_press)  # of narrower pages: training takes longer than all prints of this study
    monkeypatch.setattr(rig, "trained", lambda press, *_, **__: press.with_detector("matched_filter", model))
    few: dict[str, Any] = {name: marks.KINDS[name] for name in ("spot", "void", "missing glyph")}
    few["spot"] = replace(few["spot"], places=("paper",))
    few["void"] = replace(few["void"], places=("border",))
    for module in (marks, findings, study):
        monkeypatch.setattr(module, "KINDS", few)
    monkeypatch.setattr("prooflight_studies.visible.rows.KINDS", few)
    monkeypatch.setattr(study, "draw_curves", lambda path, curves: path.write_bytes(b""))
    plan = replace(
        study.VisiblePlan.quick(1),
        coarse=(CAMERA, CAMERA),
        fine=CAMERA,
        screened=4,
        good=2,
        curves=((CAMERA, 1),),
    )
    said: list[str] = []
    results = study.run_visible_study(
        tmp_path / "out",
        cache=tmp_path / "cache",
        plan=plan,
        parts=("marks", "curves"),
        processes=1,
        progress=said.append,
    )
    assert sum(one.prints for one in results.marks[0].caught) + results.marks[0].unmade > 4
    assert results.marks[0].good[-1].prints == plan.blank
    (curves,) = results.curves
    assert (curves.good, [(one.kind, one.place, one.prints) for one in curves.cells]) == (
        plan.judged,
        [("spot", "paper", 2), ("void", "border", 2), ("missing glyph", "text", 2)],
    )
    text = (tmp_path / "out" / "visible.md").read_text(encoding="utf-8")
    assert "--part marks --part curves" in text
    assert all(one.name in text for one in marks.NAMED)
    again = study.run_visible_study(
        tmp_path / "out", cache=tmp_path / "cache", plan=plan, parts=("marks", "curves"), processes=1
    )
    assert again == results  # kept, not printed anew
    assert any("building the press" in one for one in said)


def test_an_unknown_part_is_refused() -> None:
    with pytest.raises(RequestError, match="there is no 'mark'"):
        visible(part=["mark"])
