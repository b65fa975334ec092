"""The harness itself: every way in which a reader may fail is seen, counted and kept."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.fuzz.harness import FAILURES, Limits, Target, fuzz
from tests.fuzz.registry import TARGETS
from tests.fuzz.spoiling import spoil_bytes, spoil_text

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Callable

WAYS = ("good", "clean", "unclear", "two lines", "traceback", "slow", "memory", "died")


def samples() -> list[bytes]:
    return [b"good"]


def mutate(data: bytes, rng: np.random.Generator) -> bytes:
    return WAYS[int(rng.integers(len(WAYS)))].encode()


def mutate_mildly(data: bytes, rng: np.random.Generator) -> bytes:
    return WAYS[int(rng.integers(5))].encode()


def read(path: Path) -> None:
    match path.read_text():
        case "clean":
            raise RequestError(path, "is spoilt", remedy="mend it")
        case "unclear":
            raise RequestError("something", "is spoilt", remedy="mend it")
        case "two lines":
            raise RequestError(path, "is\nspoilt", remedy="mend it")
        case "traceback":
            np.log(np.zeros(1))  # only a warning elsewhere
        case "slow":
            while True:
                time.perf_counter()
        case "memory":
            bytearray(2**31)
        case "died":
            os._exit(7)


def target(mutate: Callable[[bytes, np.random.Generator], bytes] = mutate) -> Target:
    return Target(name="pretended", suffix=".txt", samples=samples, mutate=mutate, read=read)


def test_every_way_to_fail_is_counted_and_kept(tmp_path: Path) -> None:
    """Seed 170: of each way one mutant, so that few processes are started again. An error's two lines become one."""
    limits = Limits(seconds=1.0, bytes_more=2**30)
    tallies = fuzz([target()], seed=170, mutants=len(WAYS), jobs=1, limits=limits, keep=tmp_path / "kept")
    counts = tallies["pretended"].counts
    assert counts == {"clean": 2, "accepted": 1, **dict.fromkeys(FAILURES, 1)}
    kept = [path for path in (tmp_path / "kept").iterdir() if path.suffix == ".txt"]
    assert len(kept) == sum(counts[outcome] for outcome in FAILURES)
    for path in kept:
        outcome = path.stem.rpartition("-")[2]
        assert path.read_text() == outcome
        assert path.with_suffix(".why").read_text()


def waiting(path: Path) -> None:
    if path.read_text() != "good":
        time.sleep(600)


def test_a_reader_that_waits_is_not_waited_for() -> None:
    waits = Target(name="waits", suffix=".txt", samples=samples, mutate=mutate_mildly, read=waiting)
    tallies = fuzz([waits], seed=2, mutants=1, jobs=1, limits=Limits(seconds=60.0, seconds_waited=1.0))
    assert tallies["waits"].counts == {"slow": 1}


def test_the_same_seed_makes_the_same_mutants() -> None:
    once, again, other = (
        fuzz([target(mutate_mildly)], seed=seed, mutants=40, jobs=jobs)["pretended"].counts
        for seed, jobs in ((1, 2), (1, 1), (2, 1))
    )
    assert once == again
    assert once != other


def refused(path: Path) -> None:
    raise RequestError(path, "is spoilt", remedy="mend it")


def test_a_reader_that_refuses_a_good_sample_ends_the_run() -> None:
    strict = Target(name="strict", suffix=".txt", samples=samples, mutate=mutate, read=refused)
    with pytest.raises(RuntimeError, match="strict cannot be tried"):
        fuzz([strict], seed=1, mutants=1)


def test_targets_have_names_of_their_own() -> None:
    assert len({each.name for each in TARGETS}) == len(TARGETS) >= 15


@pytest.mark.parametrize("spoil", [spoil_bytes, spoil_text])
def test_anything_can_be_spoilt(spoil: Callable[[bytes, np.random.Generator], bytes]) -> None:
    changed = 0
    for seed in range(200):
        for data in (b"", b"a", b"a = 1\nb = 2.5\n", bytes(range(256))):
            spoilt = spoil(data, np.random.default_rng(seed))
            assert spoilt == spoil(data, np.random.default_rng(seed))
            changed += spoilt != data
    assert changed > 400
