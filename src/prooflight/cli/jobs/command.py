"""Commands on jobs: demo, rip, simulate, inspect."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from prooflight.cli import faults, imposition, show
from prooflight.cli.options import (
    ClusterAt,
    Detector,
    JobPath,
    Json,
    LayoutOption,
    OnDevice,
    Pages,
    PressArtefact,
    Profile,
    Seed,
    Zones,
)
from prooflight.cli.workers import workers
from prooflight.errors import RequestError
from prooflight.reporting.wording import count

if TYPE_CHECKING:
    from prooflight.cli.jobs.comparison import Comparison
    from prooflight.cli.jobs.inspected import Inspected
    from prooflight.inspection.guarantee import GuaranteeMonitor, Judged
    from prooflight.pages.check import EarlyWarnings
    from prooflight.pages.parallel import Processes
    from prooflight.pages.warnings import PageWarning
    from prooflight.press.artefact import Press
    from prooflight.reporting.report import PageEntry
    from prooflight.simulation.worlds import World as PressWorld

InRun = TypeVar("InRun", "Judged", "PageEntry")


World = Annotated[
    str,
    typer.Option(
        help="ideal: a good scan is the expected one plus sensor noise; press: prints also move and drift; "
        "measured: they vary as real sheets do, and are screened."
    ),
]


def register(app: typer.Typer) -> None:
    """Add these commands to the program."""
    for command in (demo, rip, simulate, inspect):
        app.command()(command)


def demo(
    job: Annotated[
        Path | None, typer.Option(metavar="F.pdf", help="Job to print; default a sample job.")
    ] = None,
    pages: Annotated[
        int | None,
        typer.Option(
            help="Number of sheets to print; default 14 of the sample job, each page of another.", min=1
        ),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where to write.")] = Path("prooflight-demo"),
    world: World = "press",
    profile: Profile = None,
    seed: Seed = 1,
    json: Json = False,
) -> None:
    """Print a job on the simulated press with some misprints, inspect every sheet, write report.html.

    In the press world, prints move and drift as real ones do, and the matched-filter detector inspects them;
    in the ideal world, that of the paper, its first detector does.
    """
    from prooflight.cli.jobs import demonstration
    from prooflight.inspection.inspector import Inspector
    from prooflight.pages.parallel import in_order
    from prooflight.press.pages import job_source
    from prooflight.reporting.report import RunSummary, write_report
    from prooflight.simulation.worlds import world_named

    into = world_named(world)
    say = show.steps(quiet=json)
    if job is None and pages is None:
        pages = demonstration.SAMPLE_PRINTS
    job, press, titles = _job_and_press(job, out, world=into, profile=profile, seed=seed, json=json)
    press.save(out / f"{press.name}.press")
    source = job_source(job, press, profile=profile)
    with source.open() as opened:
        sizes, name = opened.page_sizes_mm, opened.name
    sheets = demonstration.plan(len(sizes), pages, seed=seed)
    work = demonstration.PrintAndInspect(job=source, press=press, world=into, seed=seed, titles=titles)
    started = time.perf_counter()
    done = list(
        _shown(
            in_order(work.with_pictures(sheets), sheets), len(sheets), "printing and inspecting", quiet=json
        )
    )
    entries = [one.entry for one in done]
    pages_per_s = len(entries) / (time.perf_counter() - started)
    inspector = Inspector.of(press, demonstration.DETECTOR[into])
    summary = RunSummary.today(inspector, job=name, pages_per_s=pages_per_s, world=into, seed=seed)
    report = out / "report.html"
    say("writing the report")
    write_report(
        report,
        entries,
        summary,
        worlds=next((one.worlds for one in done if one.worlds), None),
        visible=done[0].visible,
    )
    _print_totals(entries, title=f"{name} on press {press.name}", pages_per_s=pages_per_s, json=json)
    if not json:
        show.people.print("Open", show.strong(report))


def _job_and_press(
    job: Path | None, out: Path, *, world: PressWorld, profile: Path | None, seed: int, json: bool
) -> tuple[Path, Press, tuple[str, ...]]:
    """Return the job, a press for its pages, and the titles of the sample job, which is composed meanwhile."""
    from prooflight.cli.jobs import demonstration
    from prooflight.pages.job import JobSource
    from prooflight.pages.parallel import worker_processes

    say = show.steps(quiet=json)
    with worker_processes(1) as composer:
        if job is None:
            # An extra that is missing is named at once.
            import_module("prooflight.simulation.corpus.sample_job.sample_job")
            job = out / "sample-job.pdf"
            titles = demonstration.stored_sample_job(job, seed=seed)
            composed = None
            if titles is None:
                say("composing the sample job")
                composed = composer.submit(demonstration.sample_job, job, seed=seed)
            sizes: Sequence[tuple[float, float]] = [demonstration.SAMPLE_SIZE_MM]
        else:
            composed = titles = None
            with JobSource(path=job, dpi=1.0, profile=profile).open() as opened:
                sizes = opened.page_sizes_mm
        press = demonstration.demo_press(
            sizes,
            world=world,
            seed=seed,
            progress=say,
            shown=lambda days, total, what: _shown(days, total, what, quiet=json),
        )
        if composed is not None:
            titles = composed.result()
    return job, press, titles or ()


def _print_totals(entries: Sequence[PageEntry], *, title: str, pages_per_s: float, json: bool) -> None:
    """Print how many sheets were misprints, and how many of these were caught."""
    from prooflight.reporting.report import counts

    of_run = counts(entries)
    if json:
        totals = {name: getattr(of_run, name) for name in ("pages", "misprints", "caught", "false_alarms")}
        show.print_json(totals | {"pages_per_s": round(pages_per_s, 3)})
        return
    show.people.print(show.verdict_table((entry.verdict for entry in entries), title=title))
    show.people.print(
        f"{of_run.pages} sheets, {of_run.misprints} misprints printed, {of_run.caught} caught, "
        f"false alarms: {of_run.false_alarms}; {pages_per_s:.2f} sheets/s simulated and inspected"
    )


def rip(
    job: Annotated[Path, typer.Argument(metavar="JOB.pdf", help="PDF, or a folder of PDFs and images.")],
    dpi: Annotated[float, typer.Option(help="Resolution [pixels/inch].")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Where to write.")],
    profile: Profile = None,
    pages: Pages = None,
    json: Json = False,
) -> None:
    """Write each page as a CMYK TIFF, as the press would print it."""
    from prooflight.pages.files import write_tiff
    from prooflight.pages.job import JobSource, parse_pages

    rows: list[dict[str, Any]] = []
    with JobSource(path=job, dpi=dpi, profile=profile).open() as opened:
        numbers = parse_pages(pages, len(opened)) if pages else tuple(range(1, len(opened) + 1))
        out.mkdir(parents=True, exist_ok=True)
        for number in _shown(numbers, len(numbers), "ripping", quiet=json):
            page = opened.page(number)
            path = out / f"{page.name}.tif"
            write_tiff(page, path)
            rows.append(
                {
                    "page": page.name,
                    "file": str(path),
                    "width_mm": round(page.width_mm, 2),
                    "height_mm": round(page.height_mm, 2),
                    "dpi": page.dpi,
                    "pixels": [page.cmyk.shape[1], page.cmyk.shape[0]],
                }
            )
    if json:
        show.print_json(rows)
    else:
        show.people.print(count(len(rows), "page"), "in", show.strong(out))


def simulate(
    job: JobPath,
    press: PressArtefact,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Where to write.")],
    world: World = "ideal",
    misprint: Annotated[
        str | None, typer.Option(metavar="KIND[:SEVERITY]", help="Misprint on every page.")
    ] = None,
    layout: LayoutOption = None,
    pages: Pages = None,
    profile: Profile = None,
    seed: Seed = 1,
    json: Json = False,
) -> None:
    """Print and scan a job on the simulated press: one TIFF of raw digital numbers a page, and truth.json.

    Pages that are printed again replace theirs in DIR and in its truth.json; all others stay.
    """
    from prooflight.pages.job import parse_pages
    from prooflight.pages.parallel import in_order
    from prooflight.press.artefact import Press
    from prooflight.press.pages import job_source
    from prooflight.simulation.files import ScanToFile, stored_truths, write_truth
    from prooflight.simulation.scans import MisprintRequest
    from prooflight.simulation.worlds import world_named

    world_named(world)
    loaded = Press.load(press)
    source = job_source(job, loaded, profile=profile)
    source, _ = imposition.imposed(source, layout, loaded.geometry)
    request = MisprintRequest.parse(misprint) if misprint else None
    with source.open() as opened:
        numbers = parse_pages(pages, len(opened)) if pages else tuple(range(1, len(opened) + 1))
        job_pages, names = len(opened), {source.page_name(number) for number in numbers}
    stored_before = stored_truths(out / "truth.json", names, world=world, seed=seed, press=loaded)
    out.mkdir(parents=True, exist_ok=True)
    work = ScanToFile(
        job=source, press=loaded, out=out, request=request, seed=seed, job_pages=job_pages, world=world
    )
    truths = list(_shown(in_order(work, numbers), len(numbers), "printing and scanning", quiet=json))
    write_truth(out / "truth.json", [*stored_before, *truths], world=world, seed=seed, press=loaded)
    if json:
        show.print_json(truths)
    else:
        show.people.print(count(len(truths), "scan"), "and truth.json in", show.strong(out))


def inspect(
    job: JobPath,
    scans: Annotated[
        Path | None,
        typer.Argument(
            metavar="SCANS",
            help="Folder of scans, or a TIFF in page order; with --golden JOB may be left out.",
        ),
    ] = None,
    press: Annotated[
        Path | None,
        typer.Option("--press", metavar="X.press", help="Press artefact; optional only with --golden."),
    ] = None,
    golden: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="SCAN",
            help="A good scan, or a folder of one for each page; repeat it for more copies. It needs no job.",
        ),
    ] = None,
    scanner: Annotated[
        bool,
        typer.Option(
            "--scanner",
            help="SCANS are an office scanner's: PDF, TIFF, JPEG or PNG, in any order; needs no press.",
        ),
    ] = False,
    scan_dpi: Annotated[
        float | None,
        typer.Option(metavar="DPI", help="With --scanner: resolution of scans whose file states none."),
    ] = None,
    tone: Annotated[
        str | None,
        typer.Option(
            metavar="srgb|linear|GAMMA[:BLACK:WHITE]",
            help="With --scanner: curve of the scans, black and white in per cent; default their profile, or sRGB.",
        ),
    ] = None,
    layout: LayoutOption = None,
    detector: Detector = None,
    device: OnDevice = "cpu",
    report: Annotated[Path | None, typer.Option(metavar="DIR", help="Write DIR/report.html.")] = None,
    zones: Zones = None,
    profile: Profile = None,
    cluster: ClusterAt = None,
    json: Json = False,
) -> None:
    """Compare scans with the job, and give one verdict a page in job order.

    Exits 1 if there is a misprint, 3 if a page was not inspected.
    """
    if not scanner:
        _refuse_without_scanner(tone, scan_dpi)
    if golden:
        others = {"--detector": detector, "--layout": layout, "--cluster": cluster}
        _refuse_with_golden(
            others | {"--scanner": scanner or None, "--device": None if device == "cpu" else device}
        )
        from prooflight.cli.jobs.golden import inspect_golden

        own_job, seen = (None, job) if scans is None else (job, scans)
        _leave(
            inspect_golden(
                golden, seen, job=own_job, press=press, profile=profile, zones=zones, report=report, json=json
            )
        )
        return
    if scans is None or (press is None and not scanner):
        missing = "SCANS" if scans is None else "--press"
        remedy = (
            "give JOB SCANS --press X.press, or --scanner where an office scanner made them, or --golden SCAN"
        )
        raise RequestError("inspect", f"{missing} is missing", remedy=remedy)
    from prooflight.cli.jobs.comparison import Options, on_press, on_scanner

    options = Options(
        layout=layout, detector=detector, device=device, zones=zones, profile=profile, json=json
    )
    if cluster is not None and device != "cpu":
        raise RequestError("--device", "does not go with --cluster", remedy="leave one of them out")
    if press is None or scanner:
        comparison = on_scanner(job, scans, press, options, tone=tone, scan_dpi=scan_dpi)
    else:
        comparison = on_press(job, scans, press, options)
    with workers(cluster) as processes:
        done = _compared(comparison, report, device=device, processes=processes, json=json)
    _leave(done)


def _refuse_with_golden(options: Mapping[str, object]) -> None:
    """Raise RequestError if an option is given that needs the job's raster, which a good scan replaces."""
    for option, given in options.items():
        if given is not None:
            remedy = "leave it out: it needs the job's raster"
            raise RequestError(option, "does not go with --golden", remedy=remedy)


def _compared(
    comparison: Comparison, report: Path | None, *, device: str, processes: Processes, json: bool
) -> Inspected[Any]:
    """Inspect every pair, and show verdicts, warnings and, where it is asked for, the report."""
    from prooflight.cli.jobs.check import tell_warnings
    from prooflight.inspection.guarantee import GuaranteeMonitor
    from prooflight.pages.parallel import FEWEST_FOR_PROCESSES

    # Each process compiles for a card, and needs its memory; and a process takes longer to start than a few pages.
    few = sum(scan is not None for _, scan in comparison.pairs) < FEWEST_FOR_PROCESSES
    if processes is None and (few or device != "cpu"):
        processes = 1
    guarantee = GuaranteeMonitor.of(comparison.work.inspector.detector)
    if report is None:
        done: Inspected[Any] = _tried(comparison, guarantee, processes=processes, json=json)
    else:
        done = _reported(comparison, report, guarantee, processes=processes, json=json)
    tell_warnings(_later(done, comparison.early), json=json)
    plan = comparison.plan
    if not json:
        each = "page" if plan is None else "side"
        show.judged(done.verdicts, title=f"{comparison.job} on press {comparison.press}", each=each)
        if report is not None:
            show.people.print("Open", show.strong(report / "report.html"))
    if plan is not None:
        imposition.print_job(imposition.of_job(plan, done.verdicts), json=json)
    if guarantee.suspended:
        faults.report(guarantee.suspended)
    return done


def _refuse_without_scanner(tone: str | None, dpi: float | None) -> None:
    """Raise RequestError if an option is given that says something of an office scanner's scans only."""
    for option, given in {"--tone": tone, "--scan-dpi": dpi}.items():
        if given is not None:
            raise RequestError(
                option, "is for scans of an office scanner", remedy="add --scanner, or leave it out"
            )


def _in_run(items: Iterable[InRun], guarantee: GuaranteeMonitor) -> Iterator[InRun]:
    """Yield inspected items in the order of the job, each with the run's state of the false-alarm rate by then."""
    for place, item in enumerate(items):
        guarantee.add(item.verdict, item.summary, place)
        yield replace(item, verdict=guarantee.marked(item.verdict), summary=None)


def _later(done: Inspected[Any], early: EarlyWarnings) -> list[PageWarning]:
    """Return warnings of pages that were not printed before the first of them."""
    every = dict.fromkeys(warning for item in done.items for warning in item.warnings)
    return [warning for warning in every if warning not in early.at_start]


def _leave(done: Inspected[Any]) -> None:
    """Report pages that were not inspected, and end with the run's exit code."""
    if code := done.code():
        raise typer.Exit(code)


def _tried(
    comparison: Comparison, guarantee: GuaranteeMonitor, *, processes: Processes, json: bool
) -> Inspected[Judged]:
    """Inspect, and keep the verdicts."""
    from prooflight.cli.jobs.inspected import inspected
    from prooflight.inspection.guarantee import Judged
    from prooflight.inspection.job import Tried
    from prooflight.pages.parallel import in_order

    work, pairs = comparison.work, comparison.pairs
    tried = Tried(work, work.name, Judged)
    return inspected(
        _in_run(
            in_order(tried, pairs, processes=processes, killed=tried.killed, files=work.files), guarantee
        ),
        attrgetter("verdict"),
        names=[work.name(pair) for pair in pairs],
        unseen=lambda _place, verdict: Judged(guarantee.marked(verdict)),
        json=json,
    )


def _reported(
    comparison: Comparison, report: Path, guarantee: GuaranteeMonitor, *, processes: Processes, json: bool
) -> Inspected[PageEntry]:
    """Inspect, and write ``report.html`` into the folder."""
    from prooflight.cli.jobs.inspected import inspected
    from prooflight.inspection.inspector import raster_of
    from prooflight.inspection.job import UNUSABLE
    from prooflight.pages.check import warning_text
    from prooflight.pages.parallel import in_order
    from prooflight.reporting.report import PicturedPage, RunSummary, unpictured_entry, write_report
    from prooflight.reporting.visibility_picture import VisibleOnPage

    work, pairs, early = comparison.work, comparison.pairs, comparison.early
    started, pictured = time.perf_counter(), PicturedPage(work)
    done = inspected(
        _in_run(
            in_order(pictured, pairs, processes=processes, killed=pictured.killed, files=work.files),
            guarantee,
        ),
        attrgetter("verdict"),
        names=[work.name(pair) for pair in pairs],
        unseen=lambda place, verdict: unpictured_entry(pairs[place][0], guarantee.marked(verdict)),
        json=json,
    )
    report.mkdir(parents=True, exist_ok=True)
    pages_per_s = len(pairs) / (time.perf_counter() - started)
    summary = RunSummary.today(
        work.inspector,
        job=comparison.job,
        pages_per_s=pages_per_s,
        suspended=guarantee.suspended,
        warnings=[warning_text(warning) for warning in (*early.warnings, *_later(done, early))],
    )
    sheets = () if comparison.plan is None else imposition.of_job(comparison.plan, done.verdicts)
    visible = None
    with suppress(*UNUSABLE):  # its entry says why the page cannot be used
        visible = VisibleOnPage.of(work.inspector, raster_of(work.design(1)))
    write_report(report / "report.html", done.items, summary, visible=visible, sheets=sheets)
    return done


def _shown(items: Iterable[Any], total: int, what: str, *, quiet: bool) -> Iterator[Any]:
    return iter(items) if quiet else show.progress(items, total=total, what=what)
