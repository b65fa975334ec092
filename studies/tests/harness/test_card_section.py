"""The section on a graphics card, from made-up figures."""

from __future__ import annotations

from prooflight_studies.speed.card import Compared, card_section

FIGURES = {
    "card": "gpu: made up",
    "numba_cuda": "0.30",
    "host_cores": 16,
    "threshold": 1.5,
    "camera_mpx": 5.85,
    "compiled_s": 40.0,
    "pages": 24,
    "prints": 1200,
    "misprints": 400,
    "score_off": [0.0, 0.05, 0.1, 0.4],
    "differing": [],
    "other_kinds": 1,
    "farthest": [],
    "sheet_ms": 2.5,
    "upload_ms": 0.3,
    "in_flight": {"1": 400.0, "8": 540.0},
    "gpu_per_s": {"1": 6.0, "8": 44.0},
    "cpu_per_s": {"1": 4.0, "8": 30.0},
    "gpu_cpu_s": 0.23,
    "cpu_cpu_s": 0.43,
}


def test_prints_that_are_judged_otherwise_are_listed_with_their_scores() -> None:
    one = Compared(
        page="p0003",
        misprint="",
        cpu="good",
        gpu="misprint spot",
        cpu_score=1.4,
        gpu_score=1.6,
        statistics_off=0.1,
    )
    assert one.differs
    assert "- p0003, good: good (score 1.40) on the processor, misprint spot (1.60)" in card_section(
        FIGURES | {"differing": [{name: getattr(one, name) for name in one.__dataclass_fields__}]}
    )


def test_a_misprint_of_another_kind_is_no_other_verdict() -> None:
    same = Compared(
        page="p0003",
        misprint="spot",
        cpu="misprint spot",
        gpu="misprint void",
        cpu_score=9.0,
        gpu_score=9.1,
        statistics_off=0.1,
    )
    assert not same.differs


def test_rates_stand_in_a_table_where_they_were_measured() -> None:
    assert "| 8 | 44.0 | 30.0 |" in card_section(FIGURES)
    assert "| workers |" not in card_section(FIGURES | {"gpu_per_s": {}, "cpu_per_s": {}})
