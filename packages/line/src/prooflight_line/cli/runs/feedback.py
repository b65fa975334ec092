"""Labels of sheets, and their use: ``run mark``, ``run sampled``, ``run tolerances``, ``press recalibrate``,
``go-back``.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from prooflight.cli import show
from prooflight.cli.options import Detector, Json
from prooflight.errors import RequestError
from prooflight.reporting.wording import count
from prooflight_line.cli.runs.journals import JournalUrl, RunNumber, reading, run_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_line.journal.records import RunRow
    from prooflight_line.run.labelled_sheets import Replayed, SampledSheet
    from prooflight_line.run.tolerances import Proposal

REPLAYED_RUNS: Final = 5
ANY_DPI: Final = 72.0
"""Resolution for jobs of which only the sizes of pages are needed."""
SHOWN: Final = 40
"""Number of sheets that are listed."""
MARKS: Final = ("misprint", "good", "unknown")
UNDO: Final = "undo"


def register_of_runs(app: typer.Typer) -> None:
    """Add the commands of ``prooflight run``."""
    app.command()(mark)
    app.command()(sampled)
    app.command()(tolerances)


def register_of_presses(app: typer.Typer) -> None:
    """Add the commands of ``prooflight press``."""
    app.command()(recalibrate)
    app.command("go-back")(go_back)


def mark(
    run: RunNumber,
    sheet: Annotated[int, typer.Argument(metavar="SHEET", help="Number of the sheet in its run.", min=0)],
    word: Annotated[
        str,
        typer.Argument(
            metavar="WORD", help="Label: misprint, good or unknown; undo: removes the last label."
        ),
    ],
    by: Annotated[str, typer.Option("--by", metavar="NAME", help="Name of the person who labels.")],
    why: Annotated[str, typer.Option("--why", metavar="TEXT", help="Note to the label.")] = "",
    journal: JournalUrl = None,
    json: Json = False,
) -> None:
    """Label a sheet, also during its run. Labels are added, none is replaced; the last one counts."""
    from prooflight_line.journal.labels import GOOD, MOST_NOTE, Labels, LabelStore, run_key

    if word not in (*MARKS, UNDO):
        raise RequestError(
            "word", f"there is no label {word[:40]!r}", remedy=f"use {', '.join((*MARKS, UNDO))}"
        )
    if len(why) > MOST_NOTE:
        raise RequestError("--why", f"has {len(why):,} letters", remedy=f"give {MOST_NOTE:,} at most")
    with reading(journal) as opened:
        run_row = run_of(opened, run)
        page = opened.page(run_row.id, sheet)
        label_store, key, now_s = LabelStore(opened.path), run_key(run_row), time.time()
        if word == UNDO:
            last = Labels(label_store.of_run(key)).of(sheet)
            if last is None:
                what = f"sheet {sheet} of run {run_row.id} has no label"
                raise RequestError("undo", what, remedy="see `prooflight run sampled --all`")
            label = label_store.undo(last.id, run=key, by=by, at_s=now_s)
        else:
            label = label_store.say(word, run=key, sheet=sheet, by=by, at_s=now_s, note=why)
    if json:
        show.print_json(
            {"run": run_row.id} | {name: value for name, value in asdict(label).items() if name != "run"}
        )
        return
    counts = (
        ""
        if page.asked is not None
        else "; it is not in the random sample, so it does not affect the threshold"
    )
    if label.word == GOOD and page.verdict.verdict == "not-inspected":
        counts += ", and it was not inspected: release it manually in the console, or print it again"
    show.people.print(f"sheet {sheet} of run {run_row.id}: {label.word}, labelled by {label.by}{counts}")


def sampled(
    run: RunNumber = "last",
    journal: JournalUrl = None,
    every: Annotated[bool, typer.Option("--all", help="List labelled sheets as well.")] = False,
    json: Json = False,
) -> None:
    """List the sheets that await a label, and the rates that the labelled sheets of the run show."""
    from prooflight_line.journal.labels import LabelStore
    from prooflight_line.run.labelled_sheets import counts_of, sample_of_run

    with reading(journal) as opened:
        run_row = run_of(opened, run)
        sheets = sample_of_run(opened, LabelStore(opened.path), run_row)
    counts = counts_of(run_row, sheets)
    listed = [one for one in sheets if every or not one.state]
    if json:
        show.print_json(
            {
                "run": run_row.id,
                **asdict(counts),
                "false_alarms": None if counts.false_alarms is None else asdict(counts.false_alarms),
                "missed": None if counts.missed is None else asdict(counts.missed),
                "sheets": [_sampled_facts(one) for one in listed],
            }
        )
        return
    title = f"Run {run_row.id}: sheets sampled for review" + ("" if every else ", not yet labelled")
    headings = ("sheet", "page", "verdict", "drawn with", "label")
    table = show.table_of(title, headings, text_columns=("page", "verdict", "label"))
    for one in listed[:SHOWN]:
        record = one.record
        table.add_row(
            str(record.sheet),
            record.verdict.page,
            record.verdict.verdict,
            f"{record.asked:g}",
            one.state or "-",
        )
    show.people.print(table)
    if (more := len(listed) - SHOWN) > 0:
        show.people.print(f"and {count(more, 'more sheet')}")
    for line in sample_lines(run_row, sheets):
        show.people.print(line)


def sample_lines(run: RunRow, sheets: list[SampledSheet]) -> list[str]:
    """Return the rates that the sheets sampled for review show, for people."""
    from prooflight_line.run.labelled_sheets import counts_of

    counts = counts_of(run, sheets)
    alarms = f"{counts.labelled_alarms} of {count(counts.alarms, 'alarm')}"
    text = f"{counts.labelled_passed} of the sheets that passed and {alarms}"
    lines = [f"labelled: {text}"]
    if (rate := counts.false_alarms) is not None:
        lines.append(
            f"false alarms: {rate.value:.2%} of good sheets (95 %: {rate.low:.2%} to {rate.high:.2%}), "
            f"{counts.alarms_good} of the alarms that were labelled"
        )
    if (missed := counts.missed) is not None:
        lines.append(
            f"misprints missed: about {missed.value:.0f} of {counts.passed:,} sheets that passed "
            f"(95 %: {missed.low:.0f} to {missed.high:.0f})"
        )
    return lines


def tolerances(
    journal: JournalUrl = None,
    runs: Annotated[int, typer.Option(metavar="N", help="Number of last runs to analyse.", min=1)] = 20,
    grant: Annotated[
        int | None, typer.Option(metavar="N", help="Put proposal N into --zones.", min=1)
    ] = None,
    zones: Annotated[
        Path | None,
        typer.Option(metavar="F.json", help="Zones of the job; the file is created if it does not exist."),
    ] = None,
    job: Annotated[Path | None, typer.Option(metavar="JOB", help="The job that was printed.")] = None,
    json: Json = False,
) -> None:
    """List false alarms that recur at one place, each as a tolerance that could be granted, with its price.

    Nothing is applied but the proposal that --grant names: its place becomes an ignored zone of the job, in
    force once its price was shown and saved (`prooflight zones price --save`). `prooflight zones drop`
    revokes it.
    """
    from prooflight_line.journal.labels import LabelStore
    from prooflight_line.run.tolerances import proposals

    with reading(journal) as opened:
        listed = proposals(opened, LabelStore(opened.path), opened.runs(damaged=lambda _: None)[-runs:])
    if grant is not None:
        _grant(listed, grant, zones=zones, job=job, json=json)
        return
    if json:
        show.print_json([asdict(one) for one in listed])
        return
    if not listed:
        show.people.print("No false alarm occurs often enough at one place to propose a tolerance.")
        return
    for number, one in enumerate(listed, 1):
        show.people.print(f"{number}.", show.strong(f"{one.kind} {one.where}"), f"on {', '.join(one.pages)}")
        for line in one.sentences:
            show.people.print(f"  {line}")
    show.people.print("None of these is applied: --grant N puts one into the zones of its job.")


def _grant(listed: list[Proposal], number: int, *, zones: Path | None, job: Path | None, json: bool) -> None:
    """Write one proposal's zone into a job's zones, which makes their price invalid."""
    from prooflight.pages.job import JobSource
    from prooflight.pages.zones.zones_file import JobZones
    from prooflight_line.run.tolerances import granted, with_zone

    if zones is None or job is None:
        raise RequestError("--grant", "needs the job and its zones", remedy="give --zones F.json --job JOB")
    if number > len(listed):
        what = f"there {'is' if len(listed) == 1 else 'are'} {count(len(listed), 'proposal')}"
        raise RequestError("--grant", what, remedy="see `prooflight run tolerances` for their numbers")
    proposal = listed[number - 1]
    with JobSource(path=job, dpi=ANY_DPI).open() as opened:
        sizes = opened.page_sizes_mm
    zones_of_job = JobZones.read(zones, sizes) if zones.exists() else None
    entry = granted(proposal, sizes)
    share = {} if zones_of_job is None else {"careful_share": zones_of_job.document.careful_share}
    JobZones.create(with_zone(zones_of_job, entry), sizes, where=zones, **share).save(zones)
    if json:
        show.print_json({"zones": str(zones), "granted": entry.model_dump(mode="json", exclude_none=True)})
        return
    for line in proposal.sentences:
        show.people.print(f"  {line}")
    show.people.print(
        "A zone has no kind and no amount: every defect in it will pass, which is more than was proposed."
    )
    show.written(zones)
    show.people.print(
        f"Not in force until its price is saved: `prooflight zones price {zones} {job} --press X.press --save`; "
        f"`prooflight zones drop {zones} {job} {entry.name!r}` removes it."
    )


def recalibrate(
    artefact: Annotated[Path, typer.Argument(metavar="X.press", help="Press artefact.")],
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="Y.press", help="Where to write the new artefact.")
    ],
    journal: Annotated[
        list[str] | None,
        typer.Option(
            "--journal", metavar="URL", help="Journal with labels of its sheets; may be given repeatedly."
        ),
    ] = None,
    promise: Annotated[
        float | None,
        typer.Option(metavar="N", help="One good page in N may alarm; default the rate of X.press.", min=2),
    ] = None,
    half_life: Annotated[
        float | None,
        typer.Option(
            "--half-life",
            metavar="DAYS",
            help="Age in days at which pages count half; default no decay.",
            min=0.01,
        ),
    ] = None,
    detector: Detector = None,
    replay: Annotated[
        int, typer.Option(metavar="N", help="Replay the last N runs at the new threshold.", min=0)
    ] = REPLAYED_RUNS,
    json: Json = False,
) -> None:
    """Set the threshold again by the labels of alarms and of the random sample; X.press stays as it is."""
    from prooflight.press.artefact import Press
    from prooflight_line.run.recalibrating import recalibrated

    press = Press.load(artefact)
    if out.exists() and out.samefile(artefact):
        raise RequestError(out, "is the press artefact to be replaced", remedy="give another --out")
    with ExitStack() as stack:
        given: list[str | None] = [*journal] if journal else [None]
        done = recalibrated(
            press,
            [stack.enter_context(reading(one)) for one in given],
            detector=detector,
            guaranteed_pages=promise,
            half_life_days=half_life,
            replay=replay,
            now_s=time.time(),
            where=artefact,
        )
    digest = done.press.save(out)
    if json:
        show.print_json(
            {
                "press": str(out),
                "digest": digest,
                "replaces": done.replaces,
                "promise": done.guarantee,
                "threshold_before": done.threshold_before,
                "threshold": done.threshold,
                "sampled": int(done.labelled.passed.sum()),
                "false_alarms": int((~done.labelled.passed).sum()),
                "replayed": [asdict(one) for one in done.replays],
            }
        )
        return
    before, now = f"{done.threshold_before:.2f} before", f"{done.threshold:.2f} now"
    show.people.print(f"threshold {before}, {now}: {done.guarantee}")
    _show_replays(done.replays)
    show.people.print(show.strong(out), f"written, digest {digest[:16]}; it replaces {done.replaces[:16]}")


def _show_replays(replays: Sequence[Replayed]) -> None:
    """Print which alarms of runs would vanish and which would appear at another threshold."""
    if not replays:
        return
    headings = ("run", "sheets", "alarms", "would vanish", "of these labelled", "would appear")
    table = show.table_of("At the new threshold", headings, text_columns=("of these labelled",))
    for one in replays:
        text = ", ".join(f"{number} {word or 'nothing'}" for word, number in one.gone_told.items())
        table.add_row(
            str(one.run), f"{one.sheets:,}", str(one.alarms), str(len(one.gone)), text, str(len(one.come))
        )
    show.people.print(table)
    for one in replays:
        for what, sheets in (("would no longer alarm", one.gone), ("would alarm", one.come)):
            if sheets:
                listed = ", ".join(map(str, sheets[:SHOWN])) + (", ..." if len(sheets) > SHOWN else "")
                show.people.print(f"run {one.run}: {what}: sheets {listed}")


def go_back(
    artefact: Annotated[
        Path, typer.Argument(metavar="Y.press", help="Press artefact that was recalibrated.")
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="X.press", help="Where to write the previous artefact.")
    ],
    json: Json = False,
) -> None:
    """Restore the press artefact that `press recalibrate` replaced, with the same digest; the new one contains it."""
    from prooflight.press.artefact import Press
    from prooflight_line.run.recalibrating import before_recalibration

    before = before_recalibration(Press.load(artefact), artefact)
    digest = before.save(out)
    if json:
        show.print_json({"press": str(out), "digest": digest})
        return
    show.people.print(show.strong(out), f"written, digest {digest[:16]}")


def _sampled_facts(one: SampledSheet) -> dict[str, Any]:
    record, word = one.record, one.label
    return {
        "sheet": record.sheet,
        "page": record.verdict.page,
        "verdict": record.verdict.verdict,
        "sample_probability": record.asked,
        "label": one.state or None,
        "by": None if word is None else word.by,
        "why": "" if word is None else word.note,
    }
