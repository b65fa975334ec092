"""Studies that are measured part by part: what earlier calls measured stays, and an interrupted study resumes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path


def stored_results(page: Path) -> dict[str, Any]:
    """Return the results that ``page.write_page`` stored beside a page; empty if there are none."""
    return {name: value for name, value in _read(page.with_suffix(".json")).items() if name != "study"}


def measure_parts(
    parts: Sequence[str],
    measure: Callable[[str], Any],
    stored: Path,
    *,
    again: bool,
    progress: Callable[[str], None],
    write: Callable[[dict[str, Any]], None],
) -> dict[str, Any]:
    """Measure the parts that are not stored yet, and return the figures of all stored parts.

    stored: file of the figures, written after each part. again: measure all parts named. write: writes the page from
    all figures, after each part as well.
    """
    for part in parts:
        if part in _read(stored) and not again:
            progress(f"{part}: known")
            continue
        progress(part)
        figures = {part: measure(part)}
        stored.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(stored) as unfinished:
            # Read again: another call may have measured other parts meanwhile.
            unfinished.write_text(json.dumps(_read(stored) | figures, indent=1))
        write(_read(stored))
    write(_read(stored))
    return _read(stored)


def _read(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}
