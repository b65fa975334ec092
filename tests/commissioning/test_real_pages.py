"""Real good pages take the place of simulated ones; no scan counts twice."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training.adapting import adapted, own_scores
from prooflight.commissioning.training.learn import Pages
from prooflight.commissioning.training.real_pages import (
    FEWEST_REAL,
    LearnedPages,
    learn_pages,
    recalibrated,
    waiting_path,
)
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.glyphs.scoring import NONE
from prooflight.detectors.matched_filter.variation import AMOUNTS
from prooflight.detectors.optional import ScannedPage
from prooflight.errors import PressError, RequestError

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press


def seen(
    press: Press, count: int, *, seed: int = 1, times: float = 1.0, another: int = 0
) -> list[ScannedPage]:
    """Pages like the simulated ones of this press, their statistics so many times as great; some show another page."""
    assert "matched_filter" in press.detectors
    rng, like = np.random.default_rng(seed), model_of(press).pages
    pages = []
    for number in range(count):
        row = int(rng.integers(len(like.values)))
        noise = np.exp(0.1 * rng.standard_normal(like.values.shape[1]))
        pages.append(
            ScannedPage(
                name=f"p{number + 1:04d}",
                score=0.0,
                evidence={
                    "values": (like.values[row] * noise * times).astype(np.float32),
                    "page_features": like.page_features[row],
                    "wrong_page": np.array(number < another),
                    "glyphs": np.array(NONE),
                },
                digest=f"{seed}-{number}",
                variation=np.full((len(AMOUNTS), 2), number + 1, np.float32),
            )
        )
    return pages


def digests(pages: list[ScannedPage]) -> dict[str, str]:
    return {page.name: page.digest for page in pages}


def rows_of(pages: list[ScannedPage]) -> Pages:
    return Pages(
        values=np.stack([page.evidence["values"] for page in pages]),
        page_features=np.stack([page.evidence["page_features"] for page in pages]),
        design=np.arange(len(pages)),
        kind=np.full(len(pages), ""),
        press=np.zeros(len(pages), np.int64),
    )


def test_what_real_pages_do_takes_the_place_of_what_simulated_ones_did(trained_press: Press) -> None:
    """This press's pages are three times as far out in everything: as such they are good."""
    matched_filter = model_of(trained_press)
    assert matched_filter is not None
    pages = seen(trained_press, 40, times=3.0)
    learned = recalibrated(trained_press, pages, digests(pages), false_alarm_rate=0.05)
    assert "matched_filter" in learned.detectors
    rows, none = rows_of(pages), np.zeros(40, bool)
    assert model_of(learned).model.shift == pytest.approx(adapted(matched_filter.model, rows).shift)
    expected = np.sort(own_scores(matched_filter.model, rows, none, real=True))
    assert model_of(learned).scores.own.worst == pytest.approx(expected)
    assert model_of(learned).references is matched_filter.references
    assert (
        model_of(learned).guarantee.real,
        model_of(learned).guarantee.simulated,
    ) == (40, 0)
    assert model_of(learned).guarantee.rate == 0.05
    assert learned.digest != trained_press.digest
    later = rows_of(seen(trained_press, 40, seed=2, times=3.0))
    before = matched_filter.model.score(later.values, later.page_features)
    after = model_of(learned).model.score(later.values, later.page_features)
    assert after.mean() < before.mean()
    assert (after > model_of(learned).threshold).mean() < 0.2


def test_many_real_pages_promise_by_themselves(trained_press: Press) -> None:
    pages = seen(trained_press, 63)
    learned = recalibrated(trained_press, pages, digests(pages), false_alarm_rate=0.1)
    assert "matched_filter" in learned.detectors
    assert (
        model_of(learned).guarantee.real,
        model_of(learned).guarantee.reference,
    ) == (63, 0)
    # ceil(64 x 0.92) = 59th smallest: glyphs and floor have a tenth of the rate each.
    assert model_of(learned).threshold == model_of(learned).scores.own.worst[58]


def test_pages_add_up_over_runs(trained_press: Press) -> None:
    pages, more = seen(trained_press, 30), seen(trained_press, 30, seed=2)
    first = recalibrated(trained_press, pages, digests(pages), false_alarm_rate=0.1)
    again = digests(more[1:])
    second = recalibrated(first, more, again, false_alarm_rate=0.1)
    assert "matched_filter" in second.detectors
    assert model_of(second).guarantee.real == 59
    at_once = recalibrated(
        trained_press,
        [*pages, *(page for page in more if page.name in again)],
        digests(pages) | {page.name: page.digest for page in more if page.name in again},
        false_alarm_rate=0.1,
    )
    assert "matched_filter" in at_once.detectors
    assert len(model_of(at_once).pages.values) == 59
    np.testing.assert_array_equal(model_of(second).pages.values, model_of(at_once).pages.values)
    assert model_of(second).threshold == model_of(at_once).threshold


def test_too_few_real_pages_are_refused(trained_press: Press, press: Press) -> None:
    few, enough = seen(trained_press, FEWEST_REAL - 1), seen(trained_press, 30)
    with pytest.raises(RequestError, match=f"give {FEWEST_REAL} or more"):
        recalibrated(trained_press, few, digests(few), false_alarm_rate=0.1)
    known = {page.name: page.digest for page in enough[: FEWEST_REAL - 1]}
    with pytest.raises(RequestError, match=f"{FEWEST_REAL - 1} good pages"):
        recalibrated(trained_press, enough, known, false_alarm_rate=0.1)
    with pytest.raises(RequestError, match="was not trained for 'matched_filter'"):
        recalibrated(press, enough, digests(enough), false_alarm_rate=0.1)


@pytest.mark.parametrize(
    ("another", "told"), [(1, "p0001 shows"), (7, "p0001, p0002, p0003, p0004, p0005 show")]
)
def test_scans_of_other_pages_are_named_and_teach_nothing(
    trained_press: Press, another: int, told: str
) -> None:
    pages = seen(trained_press, 30, another=another)
    with pytest.raises(RequestError, match=f"{told} another page"):
        recalibrated(trained_press, pages, digests(pages), false_alarm_rate=0.1)
    rest = {page.name: page.digest for page in pages if not page.another}
    assert "matched_filter" in recalibrated(trained_press, pages, rest, false_alarm_rate=0.1).detectors


# --- calls add up ---


def copies(press: Press, copy: int, *, pages: int = 6) -> list[ScannedPage]:
    """One printed copy of a paper; each copy has scans of its own, and the same designs."""
    return [replace(page, design=f"d{at}") for at, page in enumerate(seen(press, pages, seed=100 + copy))]


def learned(artefact: Path, press: Press, pages: list[ScannedPage], out: Path | None = None) -> LearnedPages:
    return learn_pages(artefact, press, pages, false_alarm_rate=0.1, out=out or artefact)


def test_copies_of_a_paper_add_up_until_they_suffice(trained_press: Press, tmp_path: Path) -> None:
    artefact = tmp_path / "x.press"
    trained_press.save(artefact)
    before = artefact.read_bytes()
    said = [learned(artefact, trained_press, copies(trained_press, copy)) for copy in range(3)]
    assert [one.waiting for one in said] == [True] * 3
    assert said[0].sentence == "6 of 20 pages so far (6 designs); learn 14 more"
    assert said[2].sentence == "18 of 20 pages so far (6 designs, 3 copies of each); learn 2 more"
    assert artefact.read_bytes() == before
    again = learned(artefact, trained_press, copies(trained_press, 1))
    assert (again.new, len(again.designs)) == (0, 18)
    last = learned(artefact, trained_press, copies(trained_press, 3, pages=2))
    assert not last.waiting
    assert last.sentence == (
        "20 pages learned (6 designs, 3 to 4 copies of each): by themselves they support no rate below one in 21 "
        "copies of these designs, and one in 7 pages of new designs"
    )
    assert not waiting_path(artefact).exists()
    stored = type(trained_press).load(artefact)
    assert "matched_filter" in stored.detectors
    assert model_of(stored).real == 20
    everything = [page for copy in range(3) for page in copies(trained_press, copy)]
    everything += copies(trained_press, 3, pages=2)
    once = learned(tmp_path / "once.press", trained_press, everything)
    assert once.press.digest == stored.digest
    more = learned(artefact, stored, copies(trained_press, 4))
    assert (more.waiting, more.new, len(more.designs)) == (False, 6, 26)


def test_a_design_is_not_scored_by_a_model_that_its_copies_adapted(trained_press: Press) -> None:
    matched_filter = model_of(trained_press)
    assert matched_filter is not None
    pages = [page for copy in range(4) for page in copies(trained_press, copy)]
    rows, none = rows_of(pages), np.zeros(24, bool)
    of_designs = replace(rows, design=np.tile(np.arange(6), 4))
    fitted = recalibrated(
        trained_press,
        [replace(page, name=page.digest) for page in pages],
        {page.digest: page.digest for page in pages},
        false_alarm_rate=0.1,
    )
    assert "matched_filter" in fitted.detectors
    expected = np.sort(own_scores(matched_filter.model, of_designs, none, real=True))
    assert model_of(fitted).scores.own.worst == pytest.approx(expected)
    assert model_of(fitted).guarantee.real == 24


def test_a_refused_call_keeps_what_waits(trained_press: Press, tmp_path: Path) -> None:
    artefact = tmp_path / "x.press"
    learned(artefact, trained_press, copies(trained_press, 0))
    waiting = waiting_path(artefact).read_bytes()
    with pytest.raises(RequestError, match="shows another page"):
        learned(artefact, trained_press, seen(trained_press, 16, another=1))
    assert waiting_path(artefact).read_bytes() == waiting
    assert not artefact.exists()


def test_pages_that_were_learned_when_the_process_ended_do_not_count_twice(
    trained_press: Press, tmp_path: Path
) -> None:
    artefact = tmp_path / "x.press"
    pages = seen(trained_press, 24)
    learned(artefact, trained_press, pages[:18])
    waiting = waiting_path(artefact).read_bytes()
    done = learned(artefact, trained_press, pages)
    waiting_path(artefact).write_bytes(waiting)  # as if it had ended between the two files
    after = learned(artefact, done.press, seen(trained_press, 1, seed=9))
    assert (after.new, len(after.designs)) == (1, 25)


def test_pages_wait_for_their_press_while_another_file_learns_them(
    trained_press: Press, tmp_path: Path
) -> None:
    artefact, out = tmp_path / "x.press", tmp_path / "y.press"
    done = learned(artefact, trained_press, seen(trained_press, 20), out)
    assert not done.waiting
    assert (out.exists(), artefact.exists(), waiting_path(artefact).exists()) == (True, False, True)
    more = learned(artefact, trained_press, seen(trained_press, 6, seed=2), out)
    assert len(more.designs) == 26


def test_a_waiting_file_of_another_build_or_damaged_is_refused_and_stays(
    trained_press: Press, tmp_path: Path
) -> None:
    artefact, few = tmp_path / "x.press", copies(trained_press, 0)
    learned(artefact, trained_press, few)
    matched_filter = model_of(trained_press)
    assert matched_filter is not None
    adapted_since = replace(
        matched_filter, model=replace(matched_filter.model, shift=matched_filter.model.shift + 1.0)
    )
    learned(artefact, trained_press.with_detector("matched_filter", adapted_since), few)  # measures as before
    other = replace(trained_press, supersampling=trained_press.supersampling + 1)
    with pytest.raises(
        PressError, match=r"x\.press\.waiting: another build .* measured the pages .*; remove it"
    ):
        learned(artefact, other, few)
    whole = waiting_path(artefact).read_bytes()
    for spoilt in (whole[:-40], b"", b"x" * 200, whole.replace(b'"schema":"1"', b'"schema":"2"')):
        waiting_path(artefact).write_bytes(spoilt)
        with pytest.raises(PressError, match="remove it, and learn its pages again"):
            learned(artefact, trained_press, few)
        assert waiting_path(artefact).read_bytes() == spoilt
