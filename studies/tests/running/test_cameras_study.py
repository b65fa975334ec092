"""The study of cameras: what it counts of losses, and a page of all its parts."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from prooflight.scans.lines import LineBlock
from prooflight_studies.cameras.losses import KINDS, count_losses
from prooflight_studies.cameras.rig import PIXELS, Rig
from prooflight_studies.cameras.step import step_figures
from prooflight_studies.cameras.study import PARTS, Plan, cameras_results
from prooflight_studies.harness.page import page_text, plain


def small_rig() -> Rig:
    """Without press or job: lines of noise."""
    lines = np.random.default_rng(1).integers(1, 4096, (3 * 456, PIXELS), np.uint16)
    nowhere = Path("nowhere")
    return Rig(folder=nowhere, press=nowhere, job=nowhere, lines=lines, prints=3, trigger=456)


def test_every_loss_is_named_on_exactly_its_lines() -> None:
    blocks: list[LineBlock] = []
    found = count_losses(small_rig(), losses=60, sheets=30, seed=4, given=blocks.append)
    assert found["losses"] == found["named_exactly"] == 60
    assert found["kinds"] == dict.fromkeys(KINDS, 20)
    assert found["lines_named"] == found["lines_lost"] > 0
    assert found["other_lines"] == 0
    assert found["block_turns"] == found["trigger_turns"] == 1
    assert sum(len(block.faults) for block in blocks) >= 60


def test_two_cameras_stay_in_step_on_a_few_sheets() -> None:
    found = step_figures(sheets=12, seed=1, progress=lambda _step: None)
    assert found["sheets"] >= 12
    assert found["other_lines"] == 0
    assert found["measured"] >= 2
    assert abs(found["mean_off"]) < 0.05
    assert found["most_held"] < 4096


def row(**more: object) -> dict[str, object]:
    return {"backend": "aravis", "lacks": "", **more}


def test_the_page_says_what_every_part_found_and_leaves_out_what_was_not_measured() -> None:
    plan = Plan.of(quick=True)
    known = {
        "job": [
            row(
                lines=9000,
                other_lines=0,
                faults=0,
                sheets=6,
                same_verdicts=6,
                same_scores=5,
                good=5,
                misprints=1,
                lines_hz=8000.0,
                watched_hz=1000.0,
            ),
            {"backend": "viva", "lacks": "it is not installed"},
        ],
        "losses": {
            "losses": 12,
            "kinds": dict.fromkeys(KINDS, 4),
            "block_turns": 1,
            "trigger_turns": 2,
            "named_exactly": 12,
            "lines_named": 300,
            "lines_lost": 300,
            "other_lines": 0,
            "sheets": 8,
            "out_of_step": 0,
            "said_lost": 7,
            "not_inspected": 1,
            "good_before": 8,
            "false_misprints": 0,
            "misprints_before": 0,
            "misprints_kept": 0,
            "prints": 3,
            "prints_good": 3,
            "score_change_median": 0.02,
            "score_change_95": 0.5,
            "without": {
                "alarms": [
                    {"job_page": 2, "score": 3.1, "threshold": 1.9, "family": "swap", "reason": "dark"}
                ],
                "share": {"value": 1 / 3, "low": 0.008, "high": 0.906},
                "promised": 0.01,
            },
            "alarms": [
                {
                    "sheet": 5,
                    "job_page": 5,
                    "kind": "streak",
                    "family": "streak",
                    "score": 2.5,
                    "threshold": 1.9,
                    "p_value": 0.009,
                    "reason": "streak at x = 12 mm",
                    "score_before": 1.5,
                }
            ],
        },
        "unseen": [
            {
                "detector": "bayes",
                "world": "press",
                "prints": 2,
                "runs": 8,
                "good": 2,
                "good_runs": 8,
                "made_misprints": 0,
                "made_misprints_unfilled": 3,
                "skipped": 1,
                "misprint_runs": 0,
                "misprints_kept": 0,
                "score_median": 1.0,
                "score_most": None,
            }
        ],
        "deaths": {
            "deaths": [
                {
                    "kind": kind,
                    "noticed_after_s": 1.5,
                    "back_after_s": 0.25,
                    "said": "it is gone",
                    "away_s": 4.0,
                    "sheets_lost": 3,
                }
                for kind in ("hung", "frozen")
            ],
            "taken": [{"noticed_after_s": 1.25, "back_after_s": 0.5, "said": "taken"}],
            "sheets": 20,
            "not_inspected": 6,
            "wrongly_judged": 0,
            "good": 14,
            "line_hz": 1000.0,
            "sheets_per_s": 2.2,
        },
        "away": {
            "minutes": 60.0,
            "noticed_after_s": 1.5,
            "back_after_s": 0.5,
            "first_mb": 700.0,
            "last_mb": 701.0,
            "most_mb": 702.0,
            "mb_an_hour": 0.25,
            "sheets": 20,
            "not_inspected": 1,
            "as_usual": 19,
        },
        "step": step_figures(sheets=5, seed=1, progress=lambda _step: None),
        "speed": [
            row(
                asked_mb_s=34.0,
                reached_mb_s=33.9,
                lines_per_s=8300.0,
                lines_lost=0,
                resends=0,
                cpu_ms_a_mb=4.0,
                core_percent=13.0,
                threads=2,
            )
        ],
    }
    assert set(known) == set(PARTS)
    text = page_text({"study": "cameras", **plain(cameras_results(known, seed=1, plan=plan))})
    for words in (
        "| aravis | 9,000 | 0 | 0 | 6 | 6 | 5 | 5 | 1 |",
        "viva: not measured, it is not installed.",
        "| losses reported on exactly their lines | 12 of 12 |",
        "| 5 | 1.5, 2.5, 1.9 | streak at x = 12 mm |",
        "1 of 3 prints alarm, 33.3 % (0.8 to 90.6 % by the count, at 95 %)",
        "guarantees 1 %: consistent with the guaranteed rate.",
        "| 2 | 3.1, 1.9 | `swap` | dark |",
        "| bayes | press | 2 of 2 | 8 | 0 | 3 | 1 | 0 | 0 | 1.000, - |",
        "| hung | 1 | 1.5 to 1.5 | 0.2 to 0.2 | 3 to 3 | 9 to 9 |",
        "700 MB of memory at the start of the disconnection, 701 MB at its end, and at most 702 MB: +0.25 MB per hour.",
        "| aravis | 34 | 33.9 | 8,300 | 0 | 0 | 4.00 | 13 % |",
    ):
        assert words in text
    bare = page_text({"study": "cameras", **plain(cameras_results({}, seed=1, plan=plan))})
    assert "##" not in bare
    assert str(asdict(plan)["prints"]) in bare
