"""Sheets of the demonstration: which pages are printed, and what goes wrong."""

from __future__ import annotations

from collections import Counter

import pytest

from prooflight.cli.jobs.demonstration import FEWEST_PRINTS, SAMPLE_PRINTS, plan


@pytest.mark.parametrize(("job_pages", "prints"), [(30, SAMPLE_PRINTS), (30, 29), (5, 1), (200, 12)])
def test_fewer_sheets_than_pages_are_spread_over_the_job(job_pages: int, prints: int) -> None:
    pages = [sheet.page for sheet in plan(job_pages, prints, seed=1)]
    assert len(set(pages)) == prints
    gaps = [after - page for page, after in zip([0, *pages], [*pages, job_pages + 1], strict=True)]
    assert max(gaps) <= job_pages // prints + 1
    assert all(sheet.copy == 1 for sheet in plan(job_pages, prints, seed=1))


@pytest.mark.parametrize(("job_pages", "prints", "sheets"), [(3, None, 9), (30, None, 30), (4, 10, 10)])
def test_a_short_job_is_printed_several_times(job_pages: int, prints: int | None, sheets: int) -> None:
    planned = plan(job_pages, prints, seed=1)
    assert len(planned) == sheets >= FEWEST_PRINTS
    assert max(Counter((sheet.page, sheet.copy) for sheet in planned).values()) == 1


@pytest.mark.parametrize("seed", range(5))
def test_each_misprint_of_the_sample_job_is_of_another_kind(seed: int) -> None:
    kinds = [sheet.first_kind for sheet in plan(30, SAMPLE_PRINTS, seed=seed) if sheet.first_kind]
    assert len(kinds) == len(set(kinds)) == 4
