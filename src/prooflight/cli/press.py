"""``prooflight press``: build a press artefact, show its content, train its detectors."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from prooflight.cli import rip_model, show, visible_marks
from prooflight.cli.options import ClusterAt, Json
from prooflight.cli.workers import workers
from prooflight.commissioning.training import DESIGNS
from prooflight.errors import PressFileError, RequestError
from prooflight.files.given import shortly

if TYPE_CHECKING:
    from prooflight.commissioning.characterise import TableAccuracy
    from prooflight.commissioning.training.real_pages import StatedAndLearned
    from prooflight.press.artefact import Press

app = typer.Typer(help="Build a press artefact, show its content, train its detectors.", no_args_is_help=True)

rip_model.register(app)

FULL = 160
TRAINING = {"full": FULL}
"""Number of designs that ways of training print where it is not ``DESIGNS``."""
TRAINED = {"none": (), "quick": ("matched_filter",), "full": ("matched_filter", "bayes")}
"""Detectors that each way of training trains."""

OWN_RIP_IS_BEST = (
    'For PDF jobs, state the press\'s own RIP by [rip] engine = "command", or give its rasters as the job; '
    "no RIP is stated here, so that edges are expected within a pixel of 600 dpi"
)

ASSUMED_WORLD = (
    "The press file does not state how sheets vary, so that the guarantee holds for sheets that vary as in the press "
    'world; state world = "either" in [variation] unless you know that yours do'
)
SCANNER = "scanner"
"""Preset of office scanners."""

Artefact = Annotated[Path, typer.Argument(metavar="X.press", help="Press artefact.")]


def register(program: typer.Typer) -> None:
    """Add these commands to the program."""
    program.add_typer(app, name="press")


@app.command()
def build(
    press_file: Annotated[Path, typer.Argument(metavar="PRESS.toml", help="Press file.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="X.press", help="Where to write the artefact.")],
    detector: Annotated[
        str,
        typer.Option(
            metavar="none|quick|full|NAME",
            help="Detectors trained by simulation. quick: the matched filter; full: the paper's learned one too; NAME: "
            "this detector alone.",
        ),
    ] = "quick",
    designs: Annotated[
        int | None,
        typer.Option(
            help="Number of page designs that are printed for it, in each world that the press file states; "
            f"default {DESIGNS}, full {FULL}.",
            min=1,
        ),
    ] = None,
    columns: Annotated[
        Path | None,
        typer.Option(
            metavar="PRESS.set-up.json", help="Protocol of `camera set-up`: the real camera's columns."
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(help="Seed of the simulated camera specimen and its prints.", min=0)
    ] = 1,
    cluster: ClusterAt = None,
    json: Json = False,
) -> None:
    """Make a press ready: characterise camera and inks, calibrate columns, train detectors, write one file."""
    from prooflight.commissioning.build import build_press
    from prooflight.commissioning.characterise import measured_columns, table_accuracy
    from prooflight.commissioning.training.train import DEFAULT_RATE, Plan
    from prooflight.detectors.entry import Training
    from prooflight.detectors.registry import names, promises, training_functions
    from prooflight.press.pages import drawn_dpi
    from prooflight.press.press_file import PressFile
    from prooflight.rng import stream

    if detector not in TRAINED and detector not in names():
        remedy = f"choose from {', '.join((*TRAINED, *names()))}"
        raise RequestError("detector", f"there is no {shortly(detector)!r}", remedy=remedy)
    wanted = TRAINED.get(detector, (detector,))
    functions = training_functions(wanted)
    if wanted:
        Plan.of(designs or TRAINING.get(detector, DESIGNS))  # too few end before any work
    started = time.perf_counter()
    settings = PressFile.read(press_file)
    if settings.rip_engine.missing:
        raise PressFileError(
            press_file, f"rip.engine: {settings.rip_engine.missing}", remedy=settings.rip_engine.remedy
        )
    if not json and settings.rip_dpi is None and settings.rip_engine.name == "mupdf":
        show.people.print(OWN_RIP_IS_BEST)
    if not json and functions and not settings.variation():
        show.people.print(ASSUMED_WORLD)
    measured = None if columns is None else measured_columns(columns, settings.camera())
    press = build_press(settings, seed=seed, columns=measured, progress=show.steps(quiet=json))
    accuracy = table_accuracy(
        settings.camera(), settings.inks(), press.sensors, stream(seed, "trial-recipes")
    )
    training = Training(
        designs=designs or TRAINING.get(detector, DESIGNS),
        seed=seed,
        false_alarm_rate=1 / settings.good_pages_per_false_alarm if settings.states_rate else DEFAULT_RATE,
        progress=show.steps(quiet=json),
        shown=lambda days, total, what: iter(days) if json else show.progress(days, total=total, what=what),
    )
    with workers(cluster if functions else None) as processes:
        for train, of in functions.items():
            for name, model in train(press, of, replace(training, processes=processes)).items():
                press = press.with_detector(name, model)
    differing = _rip_differences(press, quiet=json)
    digest = press.save(out)
    seconds = round(time.perf_counter() - started, 2)
    if json:
        facts = {"press": str(out), "digest": digest, "seconds": seconds, "detectors": promises(press)}
        rip = {"engine": press.rip_engine.name, "dpi": drawn_dpi(press), "differs": differing}
        show.print_json(facts | {"tables": accuracy, "rip": rip})
        return
    show.people.print(show.strong(out), f"written in {seconds} s, digest {digest[:16]}")
    _print_promises(press, accuracy)
    show.people.print(_rip_sentence(press, differing))


def _print_promises(press: Press, accuracy: list[TableAccuracy]) -> None:
    """Print how accurate the tables of a press are, and what its detectors promise."""
    from prooflight.detectors.optional import StatesTrials
    from prooflight.detectors.registry import promises

    for entry in accuracy:
        show.people.print(
            f"sensor {entry.sensor}: tables within {entry.mean_rms_sigma} sigma rms of the exact model "
            f"({entry.white_sigma} at paper white, {entry.mean_max_sigma} at most), "
            f"sigma within {entry.sigma_rms_percent} %"
        )
    for name, promise in promises(press).items():
        show.people.print(f"detector {name}: {promise}")
    for model in press.detectors.values():
        if isinstance(model, StatesTrials):
            show.people.print(model.trials)


def _rip_differences(press: Press, *, quiet: bool) -> tuple[str, ...] | None:
    """Return the differences of the press's RIP on a test page; None without PyMuPDF, so that no PDF can be read."""
    from importlib.util import find_spec

    from prooflight.pages.pdf.engine_check import differences
    from prooflight.press.pages import drawn_dpi

    if find_spec("pymupdf") is None:
        return None
    show.steps(quiet=quiet)(f"drawing a test page with {press.rip_engine.name}")
    return differences(press.rip_engine, drawn_dpi(press))


def _rip_sentence(press: Press, differing: tuple[str, ...] | None) -> str:
    from prooflight.pages.pdf.engine_check import sentence
    from prooflight.press.pages import drawn_dpi

    if differing is None:
        return f"RIP {press.rip_engine.name}: not checked, since PyMuPDF, which reads PDFs, is not installed"
    return sentence(press.rip_engine, drawn_dpi(press), differing)


@app.command()
def preset(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="prototype, two-sensors or rgb-line: a press with a line camera; scanner: an office scanner.",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PRESS.toml", help="Where to write; default: print.")
    ] = None,
    dpi: Annotated[
        float | None,
        typer.Option(help="Scanner: resolution of the scans; default 150. [pixels/inch]", min=72, max=5080),
    ] = None,
    grey: Annotated[
        bool, typer.Option("--grey", help="Scanner: scans are grey, by one sensor instead of three.")
    ] = False,
    width: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Scanner: width of the field; default 216.", min=20, max=1000),
    ] = None,
) -> None:
    """Write the press file of a preset, to be changed and built."""
    from prooflight.files.atomic import whole_file
    from prooflight.press.press_file import LINE_CAMERA_PRESETS, line_camera_press_text
    from prooflight.press.scanner import PRESET_DPI, WIDTHS_MM, press_dpi, scanner_press_text

    if name == SCANNER:
        text = scanner_press_text(dpi=press_dpi(dpi or PRESET_DPI), grey=grey, width_mm=width or WIDTHS_MM[0])
    elif name not in LINE_CAMERA_PRESETS:
        choices = ", ".join((*LINE_CAMERA_PRESETS, SCANNER))
        raise RequestError("preset", f"there is no {shortly(name)!r}", remedy=f"choose from {choices}")
    elif grey or dpi is not None or width is not None:
        what = f"--dpi, --grey and --width do not apply to {name!r}"
        raise RequestError("preset", what, remedy=f"omit them, or choose {SCANNER}")
    else:
        text = line_camera_press_text(name)
    if out is None:
        typer.echo(text, nl=False)
        return
    with whole_file(out) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
    show.people.print(show.strong(out))


@app.command()
def learn(
    artefact: Artefact,
    job: Annotated[Path, typer.Argument(metavar="JOB", help="Job that was printed.")],
    scans: Annotated[Path, typer.Argument(metavar="SCANS", help="Scans of its pages, as for `inspect`.")],
    good: Annotated[
        bool, typer.Option("--good", help="Confirm that you have examined these pages, and all are good.")
    ] = False,
    promise: Annotated[
        float | None,
        typer.Option(metavar="N", help="One good page in N may alarm; default as in the press file.", min=2),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="Y.press", help="Where to write; default X.press.")
    ] = None,
    profile: Annotated[Path | None, typer.Option(metavar="ICC", help="CMYK profile of the job.")] = None,
    json: Json = False,
) -> None:
    """Calibrate the matched-filter detector for this press by its real good pages, so that they do not alarm."""
    if not good:
        raise RequestError("learn", "learns from good pages alone", remedy="check them, and add --good")
    with _alone(artefact):
        _learn(artefact, job, scans, guaranteed_pages=promise, out=out, profile=profile, json=json)


@contextmanager
def _alone(artefact: Path) -> Iterator[None]:
    """Let no other call learn for this press meanwhile: each would write over the pages of the other.

    RequestError: another one does.
    """
    from prooflight.files.lock import WriterLock

    if not artefact.is_file():  # the press is read next, and says so
        yield
        return
    lock = WriterLock.take(
        artefact,
        error=RequestError,
        wait="wait until the other call has ended, then give these pages again",
        elsewhere="give an artefact in a writable folder",
    )
    try:
        yield
    finally:
        lock.release()


def _learn(
    artefact: Path,
    job: Path,
    scans: Path,
    *,
    guaranteed_pages: float | None,
    out: Path | None,
    profile: Path | None,
    json: bool,
) -> None:
    from prooflight.commissioning.training.real_pages import FEWEST_REAL, learn_pages
    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.job import InspectPage, ScanPage, paired
    from prooflight.pages.parallel import in_order
    from prooflight.press.artefact import Press
    from prooflight.press.pages import job_source

    press = Press.load(artefact)
    inspector = Inspector.of(press)
    source = job_source(job, press, profile=profile)
    with source.open() as opened:
        pairs = [
            (number, scan)
            for number, scan in paired(opened, scans, sensors=len(press.sensors))
            if scan is not None
        ]
    work = ScanPage(InspectPage(job=source, inspector=inspector))
    rows = in_order(work, pairs)
    seen = list(rows if json else show.progress(rows, total=len(pairs), what="analysing good pages"))
    done = learn_pages(
        artefact,
        press,
        seen,
        false_alarm_rate=1 / guaranteed_pages if guaranteed_pages else None,
        out=out or artefact,
    )
    facts = {
        "press": str(artefact if done.waiting else out or artefact),
        "digest": done.press.digest,
        "pages": len(seen),
        "new": done.new,
        "alarms_before": done.alarms_before,
        "threshold": done.threshold,
        "promise": done.guarantee,
        "learned": 0 if done.waiting else len(done.designs),
        "waiting": len(done.designs) if done.waiting else 0,
        "needed": FEWEST_REAL,
        "designs": len(set(done.designs)),
        "support": done.sentence,
    }
    if json:
        show.print_json(facts)
        return
    show.people.print(
        f"{len(seen)} good pages, {done.new} of them new; {done.alarms_before} would have alarmed before. "
        f"{done.sentence}."
    )
    if done.waiting:
        show.people.print(show.strong(artefact), "is unchanged; the pages are stored next to it.")
        return
    show.people.print(f"Now: {facts['promise']}")
    show.people.print(show.strong(out or artefact), f"written, digest {done.press.digest[:16]}")


@app.command("show")
def show_press(
    artefact: Artefact,
    picture: Annotated[
        Path | None, typer.Option(metavar="F.png", help="Write tables, columns and footprint as a picture.")
    ] = None,
    job: Annotated[
        Path | None, typer.Option(metavar="JOB", help="Show what would be caught on a page of this job.")
    ] = None,
    page: Annotated[
        int | None, typer.Option(metavar="N", help="Number of the page; default 1.", min=1)
    ] = None,
    map_picture: Annotated[
        Path | None,
        typer.Option("--map", metavar="F.png", help="Draw what would be caught at each place of the page."),
    ] = None,
    profile: Annotated[Path | None, typer.Option(metavar="ICC", help="CMYK profile of the job.")] = None,
    json: Json = False,
) -> None:
    """Show the content of a press artefact, and which marks it would catch."""
    from prooflight.commissioning.training.real_pages import stated_and_learned
    from prooflight.press.artefact import Press

    number = visible_marks.page_number(job, page, map_picture)
    press = Press.load(artefact)
    if job is not None:
        rows = visible_marks.on_page(press, job, number, picture=map_picture, profile=profile)
    facts, learned = _facts(press), stated_and_learned(press)
    caught = visible_marks.on_tints(press)
    if picture is not None:
        from prooflight.reporting.press_pictures import draw_press

        draw_press(picture, press)
    if json:
        more = {"learned": [asdict(row) for row in learned], "catches": visible_marks.plain(caught)}
        if job is not None:
            more["catches_on_page"] = visible_marks.plain(rows)
        show.print_json(facts | more)
        return
    table = Table(title=f"Press {facts['name']}", title_justify="left", show_header=False)
    sensors = facts.pop("sensors")
    for key, value in facts.items():
        table.add_row(key.replace("_", " "), _in_lines(value))
    show.people.print(table)
    of_sensors = show.table_of("Sensors", ("", *(sensor["name"] for sensor in sensors)), text_columns=("",))
    for key in list(sensors[0])[1:]:
        of_sensors.add_row(key.replace("_", " "), *(str(sensor[key]) for sensor in sensors))
    show.people.print(of_sensors)
    if learned:
        _print_learned(learned)
    if caught:
        visible_marks.print_tints(caught)
    if job is not None:
        visible_marks.print_page(rows, f"What would be caught on page {number} of {job.name}")
    if caught:
        show.people.print(visible_marks.EXPLAINED)
    for path in (picture, map_picture):
        if path is not None:
            show.written(path)


def _print_learned(rows: list[StatedAndLearned]) -> None:
    title = "How much good prints vary: [variation]"
    table = show.table_of(
        title, ("amount", "stated", "learned", "between", "pages"), text_columns=("amount",)
    )
    for row in rows:
        if row.learned is not None:
            estimate = row.learned
            between = f"{estimate.low:.3g} and {estimate.high:.3g}"
            names = "\n+ ".join(row.names)
            table.add_row(names, f"{row.stated:.3g}", f"{estimate.value:.3g}", between, str(estimate.pages))
    show.people.print(table)
    for row in rows:
        if row.remark:
            show.people.print(f"{' + '.join(row.names)}: {row.remark}")
    show.people.print(
        "Amounts joined by + can only be measured in sum. Intervals are at 90 %, for independent "
        "pages, but pages of one session share some amounts. sigma_error: its greatest factor."
    )


def _in_lines(value: Any) -> str:
    if not isinstance(value, dict):
        return str(value)
    return "\n".join(f"{name}: {one}" for name, one in value.items()) or "as in the press world"


def _facts(press: Press) -> dict[str, Any]:
    from prooflight.detectors.cost import floor_text
    from prooflight.detectors.registry import promises

    geometry = press.geometry
    return {
        "name": press.name,
        "digest": press.digest,
        "inks": press.origin.get("inks", ""),
        "pixels_a_line": geometry.pixels,
        "field_mm": round(geometry.field_mm, 2),
        "pixel_pitch_mm": round(geometry.pixel_pitch_mm, 5),
        "line_pitch_mm": round(geometry.line_pitch_mm, 5),
        "lead_in_mm": geometry.lead_in_mm,
        "lead_out_mm": geometry.lead_out_mm,
        "supersampling": press.supersampling,
        "raster_dpi": round(press.dpi, 2),
        "rip_dpi": press.rip_dpi,
        "rip_model": asdict(press.rip_model),
        "screen": None if press.screen is None else asdict(press.screen),
        "spot_units": [] if press.spot_units is None else [unit.name for unit in press.spot_units.units],
        "rip_engine": " ".join((press.rip_engine.name, *press.rip_engine.command)),
        "good_pages_per_false_alarm": press.good_pages_per_false_alarm,
        "misprint_rate": press.costs.misprint_rate,
        "false_alarm_cents": press.costs.false_alarm_cents,
        "missed_misprint_cents": press.costs.missed_misprint_cents,
        "alpha": round(press.costs.alpha, 4),
        "fringes": press.fringes,
        "floor_percent_of_white": round(100 * press.floor_share, 6),
        "floor": floor_text(press.floor_share) or "none",
        "variation": dict(press.variation),
        "detectors": promises(press),
        "sensors": [
            {
                "name": sensor.name,
                "white_dn": round(sensor.white_dn, 1),
                "white_sigma_dn": round(float(sensor.variance_dn2[0, 0, 0, 0]) ** 0.5, 2),
                "darkest_dn": round(float(sensor.mean_dn.min()), 1),
                "dark_sigma_dn": round(sensor.dark_variance_dn2**0.5, 2),
                "backing_dn": round(sensor.backing_dn, 1),
                "top_code_dn": sensor.top_code_dn,
                "column_gain_min": round(float(sensor.column_gain.min()), 4),
                "column_gain_max": round(float(sensor.column_gain.max()), 4),
                "clipped_black_percent": None if share is None else round(100 * share.black, 3),
                "clipped_saturation_percent": None if share is None else round(100 * share.saturation, 3),
            }
            for sensor, share in zip_longest(press.sensors, press.clipped)
        ],
    }
