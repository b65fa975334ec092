"""The records of many presses measured, in parts that are stored apart: shipping through faults, after a week,
searches, upgrades.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight import __version__
from prooflight.rng import stream
from prooflight_studies.harness.page import stored_results, write_page
from prooflight_studies.records.backlog import measure_backlog
from prooflight_studies.records.migrating import measure_migrations
from prooflight_studies.records.searching import measure_searches
from prooflight_studies.records.shipping import measure_shipping

if TYPE_CHECKING:
    from collections.abc import Callable

PARTS: Final = ("shipping", "backlog", "search", "migration")


def run_records_study(
    out: Path, part: str, *, seed: int, quick: bool, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Measure one part and write ``records.md``; the others stay as they were measured."""
    if part == "shipping":
        with tempfile.TemporaryDirectory(prefix="prooflight-records-") as folder:
            Path(folder).chmod(0o755)  # the server runs as another user
            figures = measure_shipping(
                Path(folder),
                presses=4 if quick else 40,
                sheets_per_s=5.0,
                minutes=1.0 if quick else 10.0,
                progress=progress,
            )
    elif part == "backlog":
        # 3,024,000 sheets: all hours of a week, which is more than any press prints.
        with tempfile.TemporaryDirectory(prefix="prooflight-backlog-") as folder:
            Path(folder).chmod(0o755)
            figures = measure_backlog(
                Path(folder),
                sheets=60_000 if quick else int(5.0 * 7 * 24 * 3600),
                tried_s=2.0 if quick else 70.0,
                followed_s=5.0 if quick else 60.0,
                rng=stream(seed, "record-backlog"),
                progress=progress,
            )
    elif part == "migration":
        figures = measure_migrations(sheets=40_000 if quick else 1_000_000, progress=progress)
    else:
        sheets, searches = (200_000, 100) if quick else (10_000_000, 2000)
        figures = measure_searches(sheets=sheets, searches=searches, seed=seed, progress=progress)
    figures |= {"quick": quick, "version": __version__, "seed": seed}
    page = out / "records.md"
    write_page(page, "records", dict.fromkeys(PARTS) | stored_results(page) | {part: figures})
    return figures
