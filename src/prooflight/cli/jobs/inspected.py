"""Collection of verdicts page after page, whatever happens to one of them: printed, stored, and summed up."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from prooflight.cli import faults, show
from prooflight.cli.exit_codes import of_run
from prooflight.detectors.verdict import Verdict
from prooflight.errors import ProoflightError
from prooflight.inspection.job import first_reason
from prooflight.inspection.reasons import reason_of
from prooflight.reporting.wording import count, not_inspected

Item = TypeVar("Item")


@dataclass(slots=True)
class Inspected(Generic[Item]):
    """The pages of a job, each with its verdict, though the inspection may have ended before the last."""

    items: list[Item]
    verdict_of: Callable[[Item], Verdict]
    fault: Exception | None = None
    """A defect of Prooflight itself that ended the inspection."""

    @property
    def verdicts(self) -> list[Verdict]:
        """Verdicts of all pages."""
        return [self.verdict_of(item) for item in self.items]

    @property
    def judged(self) -> bool:
        """Whether any page was inspected."""
        return any(self.verdict_of(item).verdict != "not-inspected" for item in self.items)

    def code(self) -> int:
        """Report pages that were not inspected, in one line, and return the exit code.

        A defect of Prooflight itself is raised.
        """
        verdicts = self.verdicts
        if self.fault is not None:
            raise self.fault
        unseen = [verdict for verdict in verdicts if verdict.verdict == "not-inspected"]
        if unseen:
            what = f"{len(unseen):,} of {count(len(verdicts), 'page')}"
            faults.report(not_inspected(what, len(unseen), f"{unseen[0].page}: {unseen[0].reason}"))
        misprints = sum(verdict.verdict == "misprint" for verdict in verdicts)
        return of_run(misprints=misprints, complete=not unseen)


def inspected(
    items: Iterable[Item],
    verdict_of: Callable[[Item], Verdict],
    *,
    names: Sequence[str],
    unseen: Callable[[int, Verdict], Item],
    json: bool,
) -> Inspected[Item]:
    """Collect inspected items as they come, each verdict a line of JSON for programs, a progress bar for people.

    ``names`` are the names of the pages. ``unseen`` makes the item of a page, by its index in them, that was
    not reached because Ctrl-C or a defect of Prooflight ended the inspection. ProoflightError: no page could
    be inspected at all; then nothing is shown.
    """
    done, shown = Inspected[Item](items=[], verdict_of=verdict_of), 0
    stopped: BaseException | None = None
    try:
        for item in items if json else show.progress(items, total=len(names), what="inspecting"):
            done.items.append(item)
            shown = _printed(done, shown) if json else 0
    except (KeyboardInterrupt, Exception) as error:
        stopped = error
    if not done.judged:
        raise stopped or ProoflightError(first_reason(done.verdicts))
    if stopped is not None:
        why = _why(stopped)
        rest = range(len(done.items), len(names))
        done.items += [unseen(place, Verdict.skipped(names[place], why)) for place in rest]
        if isinstance(stopped, Exception) and not isinstance(stopped, (ProoflightError, OSError)):
            done.fault = stopped
    if json:
        _printed(done, shown)
    return done


def _printed(done: Inspected[Any], shown: int) -> int:
    """Print verdicts from index ``shown`` on, once any page has been inspected; return how many are printed now."""
    if not done.judged:
        return 0
    for item in done.items[shown:]:
        show.print_json(show.verdict_facts(done.verdict_of(item)))
    return len(done.items)


def _why(stopped: BaseException) -> str:
    if isinstance(stopped, KeyboardInterrupt):
        return "the inspection was stopped before this page"
    if isinstance(stopped, (ProoflightError, OSError)):
        return f"the inspection ended early: {reason_of(stopped, of='inspecting')}"
    return f"the inspection ended with an internal error: {type(stopped).__name__}"
