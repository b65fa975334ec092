"""``python -m tests.fuzz``: spoil files, read them, print what came of it; exit 1 if a reader did what none may do."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tests.fuzz.harness import FAILURES, OUTCOMES, fuzz
from tests.fuzz.registry import TARGETS


def main() -> int:
    options = _options()
    chosen = [target for target in TARGETS if not options.reader or target.name in options.reader]
    unknown = set(options.reader) - {target.name for target in TARGETS}
    if unknown:
        known = ", ".join(target.name for target in TARGETS)
        sys.stderr.write(f"no such reader: {', '.join(sorted(unknown))}; choose from {known}\n")
        return 2
    seconds = options.seconds if options.seconds or options.mutants else 60.0
    tallies = fuzz(
        chosen,
        seed=options.seed,
        mutants=options.mutants,
        seconds=seconds,
        jobs=options.jobs,
        keep=options.keep,
    )
    heads = ("reader", "mutants", *OUTCOMES, "slowest [s]")
    sys.stdout.write(f"| {' | '.join(heads)} |\n|---|{'---:|' * (len(heads) - 1)}\n")
    for name, tally in tallies.items():
        counts = [str(tally.counts[outcome]) for outcome in OUTCOMES]
        row = (name, str(tally.counts.total()), *counts, f"{tally.slowest_s:.1f}")
        sys.stdout.write(f"| {' | '.join(row)} |\n")
    bad = sum(tally.counts[outcome] for tally in tallies.values() for outcome in FAILURES)
    sys.stdout.write(f"\nSeed {options.seed}. ")
    sys.stdout.write(f"{bad} kept in {options.keep}\n" if bad else "Nothing that no reader may do.\n")
    return 1 if bad else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--mutants", type=int, metavar="N", help="of each reader")
    parser.add_argument(
        "--seconds",
        type=float,
        metavar="S",
        help="of each job, for all readers, without what they take to start; 60 if neither is given",
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="processes that read")
    parser.add_argument("--reader", action="append", default=[], metavar="NAME", help="this one only")
    kept = Path(tempfile.gettempdir()) / "prooflight-fuzz"
    parser.add_argument("--keep", type=Path, default=kept, metavar="DIR", help="where offenders go")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
