from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import stats
from tests.fuzz.press_mutants import bytes_spoilt

from prooflight.detectors.paper.bayes import window_statistics
from prooflight.detectors.paper.evidence import INTERVALS
from prooflight.prediction.predict import predict
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.misprints.kinds import KINDS
from prooflight_studies.harness.measures import (
    FIRST_SHARE,
    MEAN,
    MINIMUM,
    WINDOWS,
    window_means,
    window_numbers,
)
from prooflight_studies.harness.protocol import (
    SETS,
    PilotWork,
    Plan,
    WatchWork,
    noisier,
    noisier_tables,
    variation_models,
)
from prooflight_studies.harness.result_cache import digest_of, minutes_spent, run_pieces, stored
from prooflight_studies.harness.versions import ALGORITHMS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight_studies.harness.result_cache import Rows


@dataclass(frozen=True, slots=True)
class SmallPages:
    make: Callable[..., Page]

    def page(self, index: int) -> Page:
        return self.make(index, number=index + 1)


PLAN = Plan(
    seed=5,
    world="ideal",
    pilot=2,
    learn=4,
    tune=2,
    test=4,
    good_copies=2,
    misprints=3,
    designs_per_day=2,
    noises=(1.0, 3.0),
)


@pytest.fixture(scope="module")
def pages(make_page: Callable[..., Page]) -> SmallPages:
    return SmallPages(make_page)


def watcher(plan: Plan, two_sensor_press: Press, pages: SmallPages) -> WatchWork:
    pilot = PilotWork(press=two_sensor_press, pages=pages, plan=plan)
    (day,) = plan.days("pilot")
    return WatchWork(press=two_sensor_press, pages=pages, plan=plan, variations=variation_models(pilot(day)))


@pytest.fixture(scope="module")
def watch(two_sensor_press: Press, pages: SmallPages) -> WatchWork:
    return watcher(PLAN, two_sensor_press, pages)


@pytest.fixture(scope="module")
def rows(watch: WatchWork) -> Rows:
    return watch(PLAN.days("learn")[0])


def test_no_design_and_no_day_is_in_two_sets() -> None:
    plan = replace(PLAN, pilot=7, learn=23, tune=11, test=30, designs_per_day=5)
    designs = [set(plan.designs(of)) for of in SETS]
    assert [len(of) for of in designs] == [7, 23, 11, 30]
    assert len(set().union(*designs)) == 71
    days = plan.days(*SETS)
    assert [index for day in days for index in day.designs] == list(range(71))
    for day in days:
        assert set(day.designs) <= set(plan.designs(day.of))


def test_a_row_for_every_scan_and_kinds_take_turns(rows: Rows) -> None:
    designs, copies, noises = 2, PLAN.good_copies + PLAN.misprints, len(PLAN.noises)
    made = designs * copies - len(rows["unmade_kind"])
    for name, column in rows.items():
        if name != "unmade_kind":
            assert len(column) == made * noises, name
    wrong = rows["kind"] != ""
    assert (rows["kind"] == "").sum() == designs * PLAN.good_copies * noises
    first = PLAN.designs("learn").start * PLAN.misprints
    turns = [KINDS[(first + n) % len(KINDS)] for n in range(designs * PLAN.misprints)]
    assert sorted([*rows["kind"][wrong][::noises], *rows["unmade_kind"]]) == sorted(turns)
    assert (rows["draws"][wrong] >= 1).all()
    assert ((rows["severity"] >= 0) & (rows["severity"] <= 1)).all()
    assert np.isfinite(rows["peers"][rows["noise"] == 1]).all()
    assert np.isnan(rows["peers"][rows["noise"] != 1]).all()


def test_good_scans_are_what_was_expected_whatever_the_noise(rows: Rows) -> None:
    """4 good scans at each noise, two sensors each: Pearson's statistic is chi-square with 15 degrees of freedom."""
    for noise in PLAN.noises:
        good = (rows["kind"] == "") & (rows["noise"] == noise)
        total = rows["chi_square"][good].sum()
        law = stats.chi2(rows["chi_square"][good].size * (INTERVALS - 1))
        assert law.ppf(1e-4) < total < law.isf(1e-4)
        separate = rows["windows"][good][
            :, 0, :, 1
        ]  # 8 x 8: half of about 2000 means, sd 0.011, lie below 0.675
        np.testing.assert_allclose(separate[..., FIRST_SHARE], 0.5, atol=0.05)


def test_misprints_are_farther_off_than_good_scans(rows: Rows) -> None:
    at_one = rows["noise"] == 1
    good, wrong = (rows["peers"][at_one & ((rows["kind"] != "") == bad), 0, -1] for bad in (False, True))
    assert np.median(wrong) > good.max()


def test_the_pilot_is_scanned_at_the_first_noise(two_sensor_press: Press, pages: SmallPages) -> None:
    """Weights of a pixel fall with its noise; what a good scan lies outside of is no more than the noise it states."""
    moments = []
    for noise in (1.0, 6.0):
        plan = replace(PLAN, noises=(noise,))
        (day,) = plan.days("pilot")
        moments.append(
            PilotWork(press=two_sensor_press, pages=pages, plan=plan)(day)["moments"].sum(axis=(0, 1))
        )
    quiet, noisy = moments
    assert noisy[0, 0] < quiet[0, 0] / 2
    assert noisy[0, 3] < 0
    assert quiet[0, 3] < 0


def test_rows_depend_on_the_plan_and_not_on_the_order(watch: WatchWork, rows: Rows) -> None:
    watch(PLAN.days("test")[0])
    again = watch(PLAN.days("learn")[0])
    for name, column in rows.items():
        np.testing.assert_array_equal(again[name], column)


def test_a_press_day_prints_pages_off_their_place_and_finds_them(
    two_sensor_press: Press, pages: SmallPages
) -> None:
    plan = replace(PLAN, world="press", noises=(1.0,), designs_per_day=1, pilot=1, misprints=1)
    found = watcher(plan, two_sensor_press, pages)(plan.days("learn")[0])
    assert found["peers"].shape[1:] == (2, 6)  # raw, registered
    good = found["kind"] == ""
    mean_difference = found["peers"][good][:, :, 1]
    assert (mean_difference[:, 1] < 0.6 * mean_difference[:, 0]).all()


def test_days_differ_in_the_press_world(two_sensor_press: Press, page: Page) -> None:
    days = [SimulatedDay.begin("press", two_sensor_press, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    seen = [day.seen(day.good(page), np.random.default_rng(7)).expected_dn for day in days]
    np.testing.assert_array_equal(seen[0], seen[1])
    assert np.abs(seen[2] - seen[0]).max() > 1


def test_noise_scales_but_rounding_does_not(two_sensor_press: Press, page: Page) -> None:
    expected = predict(page, sensors=two_sensor_press.sensors, geometry=two_sensor_press.geometry)
    tables = noisier_tables(expected, 3.0)
    np.testing.assert_allclose(tables.variance_dn2 - 1 / 12, 9 * (expected.variance_dn2 - 1 / 12), rtol=1e-4)
    assert noisier_tables(expected, 1.0) is expected
    # a day whose true sigma is the table's scales as the tables do, where no halftone adds to it
    day = SimulatedDay.begin("press", two_sensor_press, np.random.default_rng(3))
    assert day.session is not None
    seen = day.seen(day.good(page), np.random.default_rng(4))
    added = noisier(day, seen, 3.0).variance_dn2 - seen.variance_dn2
    for sensor, own in enumerate(day.session.sensors):
        paper = np.abs(seen.expected_dn[sensor] - seen.expected_dn[sensor].max()) < 20
        table = two_sensor_press.sensors[sensor].variance_dn2[0, 0, 0, 0] - 1 / 12
        assert np.median(added[sensor][paper]) == pytest.approx(8 * table * own.sigma_error**2, rel=0.05)


def test_numbers_of_windows_are_the_detectors_statistics() -> None:
    z = np.random.default_rng(3).normal(size=(2, 70, 90)).astype(np.float32)
    numbers = window_numbers(z)
    for cut, windows in enumerate(WINDOWS):
        means = window_means(z, side=windows.side, overlapping=windows.overlapping)
        signed = numbers[:, cut][:, [MEAN, MINIMUM, FIRST_SHARE]]
        np.testing.assert_allclose(signed, window_statistics(means), rtol=1e-5, atol=1e-6)
        wider = numbers[:, cut][:, [2, 3, FIRST_SHARE + 2]]
        want = window_statistics(means, reading="absolute", unit=4.0) * [4, 4, 1]
        np.testing.assert_allclose(wider, want, rtol=1e-5, atol=1e-6)


# ----- results are kept


@dataclass(frozen=True, slots=True)
class Counting:
    folder: Path

    def __call__(self, piece: int, /) -> Rows:
        if piece < 0:
            message = "no such piece"
            raise ValueError(message)
        (self.folder / f"{piece}-{len(list(self.folder.iterdir()))}").touch()
        return {"piece": np.full(piece, piece), "names": np.array([f"p{piece}"])}


def test_an_interrupted_study_goes_on_where_it_was(tmp_path: Path) -> None:
    (tmp_path / "made").mkdir()
    work, digest = Counting(tmp_path / "made"), digest_of({"seed": 1})
    with pytest.raises(ValueError, match="no such piece"):
        run_pieces(work, [3, 1, -1], tmp_path / "kept", digest=digest, processes=1)
    told: list[tuple[int, int]] = []
    rows = run_pieces(
        work, [3, 1, 2], tmp_path / "kept", digest=digest, processes=1, progress=lambda *now: told.append(now)
    )
    np.testing.assert_array_equal(rows["piece"], [3, 3, 3, 1, 2, 2])
    assert rows["names"].tolist() == ["p3", "p1", "p2"]
    assert told == [(2, 3), (3, 3)]
    assert sorted(path.name[0] for path in (tmp_path / "made").iterdir()) == ["1", "2", "3"]
    # What pieces took is kept beside their rows, and is no column of them.
    assert set(rows) == {"piece", "names"}
    spent = minutes_spent([3, 1, 2], tmp_path / "kept", digest=digest)
    assert spent > 0
    run_pieces(work, [3, 1, 2], tmp_path / "kept", digest=digest, processes=1)
    assert minutes_spent([3, 1, 2], tmp_path / "kept", digest=digest) == spent


def test_a_study_that_grows_makes_only_what_is_new(tmp_path: Path) -> None:
    (tmp_path / "made").mkdir()
    work, digest = Counting(tmp_path / "made"), digest_of({"seed": 1})
    run_pieces(work, [3, 1], tmp_path / "kept", digest=digest, processes=1)
    grown = run_pieces(work, [2, 3, 1, 4], tmp_path / "kept", digest=digest, processes=1)
    assert grown["names"].tolist() == ["p2", "p3", "p1", "p4"]
    assert stored([5, 2, 4], tmp_path / "kept", digest=digest) == [2, 4]
    assert sorted(path.name[0] for path in (tmp_path / "made").iterdir()) == ["1", "2", "3", "4"]
    # What it took is said of the pieces that are asked for.
    few, all_of_them = (
        minutes_spent(asked, tmp_path / "kept", digest=digest) for asked in ([3, 1], [2, 3, 1, 4])
    )
    assert few < all_of_them


def test_a_damaged_result_is_made_again_and_another_digest_is_another_study(tmp_path: Path) -> None:
    (tmp_path / "made").mkdir()
    work = Counting(tmp_path / "made")
    first = run_pieces(work, [2, 4], tmp_path, digest=digest_of({"seed": 1}), processes=1)
    kept = sorted(tmp_path.glob("*/*.npz"))[0]
    kept.write_bytes(kept.read_bytes()[:-40])
    again = run_pieces(work, [2, 4], tmp_path, digest=digest_of({"seed": 1}), processes=1)
    np.testing.assert_array_equal(again["piece"], first["piece"])
    assert len(list((tmp_path / "made").iterdir())) == 3
    run_pieces(work, [2, 4], tmp_path, digest=digest_of({"seed": 2}), processes=1)
    assert len(list((tmp_path / "made").iterdir())) == 5


def test_digest_is_of_content_alone() -> None:
    assert digest_of({"a": 1, "b": [2.0]}) == digest_of({"b": [2.0], "a": 1})
    assert digest_of({"a": 1}) != digest_of({"a": 2})


def test_whatever_became_of_a_kept_result_it_is_made_again_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Seeds (7, 0) to (7, 59): bits turned and pieces lost; then archives that ask for more than they hold."""
    (tmp_path / "made").mkdir()
    work, digest = Counting(tmp_path / "made"), digest_of({"seed": 1})

    def rows() -> Rows:
        return run_pieces(work, [2], tmp_path / "kept", digest=digest, processes=1)

    first = rows()
    (kept,) = tmp_path.glob("kept/*/*.npz")
    whole = kept.read_bytes()
    spoilt = [bytes_spoilt(whole, np.random.default_rng([7, index])) for index in range(60)]
    for header in (
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
        "{'descr': '|O'}",
    ):
        made = io.BytesIO()
        with zipfile.ZipFile(made, "w") as archive:
            told = header.encode() + b"\n"
            archive.writestr("piece.npy", b"\x93NUMPY\x01\x00" + len(told).to_bytes(2, "little") + told)
        spoilt.append(made.getvalue())
    damaged = 0
    for source in [*spoilt, b"", b"PK"]:
        kept.write_bytes(source)
        caplog.clear()
        again = rows()
        assert again.keys() == first.keys()
        np.testing.assert_array_equal(again["piece"], first["piece"])
        if caplog.records:
            damaged += 1
            assert caplog.messages == [caplog.messages[0]]
            assert str(kept) in caplog.text
            assert "is computed again" in caplog.text
    assert damaged > 40


def test_rows_are_kept_by_plan_press_pages_and_versions_alone(
    press: Press, monkeypatch: pytest.MonkeyPatch
) -> None:
    facts = PLAN.facts(press, "designs")
    known = digest_of(facts)
    assert digest_of(PLAN.facts(press, "designs")) == known
    others = [replace(PLAN, seed=6).facts(press, "designs"), PLAN.facts(press, "others")]
    others.append(PLAN.facts(replace(press, name="another"), "designs"))
    for room in ALGORITHMS:
        monkeypatch.setitem(ALGORITHMS, room, ALGORITHMS[room] + 1)
        others.append(PLAN.facts(press, "designs"))
    assert len({known, *map(digest_of, others)}) == 1 + len(others)
    assert set(facts) - set(PLAN.__dataclass_fields__) == {"press", "worlds", "designs", "algorithms"}
