"""``python -m tests.frozen``: measure the frozen figures again, and how far they move between processors.

It is right only for a change that is meant to change these figures, and says so in a fragment of the kind ``figures``.
``--values``: measure the figures alone, in a minute; their tolerances stay as they are.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from tests.frozen.cases import CASES
from tests.frozen.comparison import SPREAD, Spread
from tests.frozen.runs import FROZEN, measured, runs
from tests.frozen.test_frozen import FIGURES
from tests.stand_ins import SHARED

if TYPE_CHECKING:
    from pathlib import Path


def main() -> int:
    """Write both files; 2: they cannot be measured here, 1: a verdict depends on the processor."""
    parser = argparse.ArgumentParser(prog="python -m tests.frozen", description=__doc__)
    parser.add_argument(
        "--values", action="store_true", help="measure the figures alone, not how far they move"
    )
    alone = parser.parse_args().values
    if not SHARED.is_dir():
        sys.stderr.write("the case real_pages needs the folder `shared` beside the repository\n")
        return 2
    every = [FROZEN] if alone else runs()
    sys.stdout.write(f"{len(every)} runs of all cases, two at a time, each of half a minute or more\n")
    done = measured(every, say=lambda run: print(run, flush=True))  # noqa: T201
    frozen = done[0]
    spreads = {}
    if not alone:
        for case in (case.__name__ for case in CASES):
            shaken, still = (
                [
                    figures[case]
                    for run, figures in zip(every, done, strict=True)
                    if bool(run.shaken) is wanted
                ]
                for wanted in (True, False)
            )
            spreads[case] = Spread.of(still, shaken, frozen[case])
    undecided = [
        f"{case}/{path}"
        for case, spread in spreads.items()
        for path in sorted(spread.open)
        if path.endswith("words/verdict")
    ]
    if undecided:
        sys.stderr.write(f"these depend on the processor, which no verdict may: {', '.join(undecided)}\n")
        return 1
    _write(FIGURES, frozen)
    if spreads:
        cases = {case: spread.rounded() for case, spread in spreads.items()}
        _write(SPREAD, {"runs": [str(run) for run in every], "cases": cases})
    return 0


def _write(file: Path, found: dict[str, Any]) -> None:
    file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
