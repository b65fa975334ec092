"""The cache of trained presses: the same press by the same program is trained once, anything else anew."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from prooflight.commissioning.training import cache

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press


@pytest.fixture
def trainings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[dict[str, Any]]:
    """Plans that were carried out, each of which gives the press another name instead of training it."""
    plans: list[dict[str, Any]] = []

    def trained(press: Press, corpus: object, **plan: Any) -> Press:
        plans.append(plan | {"corpus": corpus})
        return replace(press, name=f"trained {len(plans)}")

    monkeypatch.setattr(cache, "trained", trained)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return plans


def test_the_same_press_is_trained_once(press: Press, trainings: list[dict[str, Any]]) -> None:
    words: list[str] = []
    first = cache.trained_once(press, designs=24, seed=1, progress=words.append)
    assert not words
    second = cache.trained_once(press, designs=24, seed=1, progress=words.append)
    assert len(trainings) == 1
    assert second.digest == first.digest
    assert str(cache.cache_folder()) in words[0]


@pytest.mark.parametrize(
    "other",
    [{"designs": 25}, {"seed": 2}, {"false_alarm_rate": 0.02}, {"paper": True}],
    ids=lambda other: next(iter(other)),
)
def test_another_plan_is_carried_out(
    press: Press, trainings: list[dict[str, Any]], other: dict[str, Any]
) -> None:
    cache.trained_once(press, designs=24, seed=1)
    cache.trained_once(press, **({"designs": 24, "seed": 1} | other))
    assert len(trainings) == 2


def test_another_press_and_another_program_are_trained(
    press: Press, trainings: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    cache.trained_once(press, designs=24, seed=1)
    cache.trained_once(replace(press, name="another"), designs=24, seed=1)
    monkeypatch.setattr(cache, "program_digest", lambda: "changed")
    cache.trained_once(press, designs=24, seed=1)
    assert len(trainings) == 3


def test_a_damaged_file_is_replaced_and_named(
    press: Press, trainings: list[dict[str, Any]], caplog: pytest.LogCaptureFixture
) -> None:
    cache.trained_once(press, designs=24, seed=1)
    (kept,) = cache.cache_folder().glob("*.press")
    kept.write_bytes(kept.read_bytes()[:-9])
    cache.trained_once(press, designs=24, seed=1)
    assert len(trainings) == 2
    assert str(kept) in caplog.text
    cache.trained_once(press, designs=24, seed=1)
    assert len(trainings) == 2


def test_the_presses_used_last_stay(press: Press, trainings: list[dict[str, Any]]) -> None:
    for seed in range(cache.MOST_PRESSES):
        cache.trained_once(press, designs=24, seed=seed)
    for age, path in enumerate(sorted(cache.cache_folder().glob("*.press"))):
        os.utime(path, (age, age))
    cache.trained_once(press, designs=24, seed=0)  # is used again, so it is not the oldest now
    cache.trained_once(press, designs=24, seed=99)
    assert len(list(cache.cache_folder().glob("*.press"))) == cache.MOST_PRESSES
    made = len(trainings)
    cache.trained_once(press, designs=24, seed=0)
    assert len(trainings) == made


def test_where_nothing_can_be_kept_each_build_trains(
    press: Press, trainings: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    for _ in range(2):
        assert cache.trained_once(press, designs=24, seed=1).name.startswith("trained")
    assert len(trainings) == 2
