"""``prooflight job zones`` and ``prooflight zones``: zones on the pages of a job, their price, and their pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from prooflight.cli import faults, show
from prooflight.cli.options import Detector, JobPath, Json, Pages, PressArtefact, Profile, Seed
from prooflight.errors import RequestError
from prooflight.reporting.wording import count

if TYPE_CHECKING:
    from prooflight.commissioning.zones.price import Price
    from prooflight.inspection.inspector import Inspector
    from prooflight.pages.job import Job
    from prooflight.pages.zones.rules import Rules
    from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
    from prooflight.press.artefact import Press

ANY_DPI: Final = 72.0
"""Resolution for jobs of which only the sizes of pages are needed."""
MOST_PRINTS: Final = 100_000
ZonesPath = Annotated[Path, typer.Argument(metavar="ZONES", help="job.zones.json.")]
Picture = Annotated[
    Path | None, typer.Option(metavar="F.png", help="Draw the first page that has zones, with them.")
]


def zones_in_force(path: Path | None, job: Job, inspector: Inspector) -> JobZones | None:
    """Return the zones of a run, and report overlaps; None without zones. JobError, RequestError: see ``JobZones``."""
    if path is None:
        return None
    from prooflight.detectors.optional import Recalibrates
    from prooflight.pages.zones.zones_file import JobZones

    zones_of_job = JobZones.read(path, job.page_sizes_mm)
    press, detector = inspector.press, inspector.detector.name
    zones_of_job.refuse_unpriced(press.digest, detector, where=path)
    for line in zones_of_job.contested():
        faults.report(line)
    model = press.detectors.get(detector)
    if (
        isinstance(model, Recalibrates)
        and model.recalibrations
        and not model.recalibrations[-1].rests_on(zones_of_job.zones_digest)
    ):
        faults.report(
            f"{path.name}: press {press.name} was recalibrated with pages without these zones, so that its guaranteed "
            "false-alarm rate holds for those only; watch with --sample and recalibrate it with pages that have them"
        )
    return zones_of_job


def register(app: typer.Typer) -> None:
    """Add these commands to the program."""
    from prooflight.cli.jobs.check import check

    job = typer.Typer(
        help="Check and prepare a job before it is printed, and make zones from its marked places.",
        no_args_is_help=True,
    )
    job.callback()(_job)
    job.command("check")(check)
    job.command("zones")(job_zones)
    zones = typer.Typer(help="Price and draw zones.", no_args_is_help=True)
    zones.command("price")(price)
    zones.command("show")(show_zones)
    zones.command("drop")(drop)
    app.add_typer(job, name="job")
    app.add_typer(zones, name="zones")


def _job() -> None:
    """Check a job before it is printed, and make zones from its marked places."""


def job_zones(
    job: JobPath,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="F.json", help="File to write the zones to.")],
    layer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=KIND", help="Kind of zone for an optional-content layer: ignore, normal or careful."
        ),
    ] = None,
    annotation: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=KIND", help="Kind of zone for annotations of this sort, field, title or subject."
        ),
    ] = None,
    outside_bleed: Annotated[
        str | None, typer.Option(metavar="KIND", help="Kind of zone for the area outside the BleedBox.")
    ] = None,
    edge_mm: Annotated[
        float,
        typer.Option("--edge", metavar="MM", help="Ignore a strip along the page's edges.", min=0, max=50),
    ] = 0.0,
    press: Annotated[
        Path | None,
        typer.Option(
            "--press", metavar="X.press", help="Press whose readable bar codes become careful zones."
        ),
    ] = None,
    pages: Pages = None,
    profile: Profile = None,
    json: Json = False,
) -> None:
    """Write zones of a job by rules: layers and annotations by name, boxes, bar codes.

    The TrimBox is printed: nothing outside it is ever inspected. The zones are in force once their price was
    shown and saved: `prooflight zones price`.
    """
    from prooflight.pages.job import JobSource, parse_pages
    from prooflight.pages.zones.rules import Rule, Rules, on_all_pages
    from prooflight.pages.zones.zones_file import JobZones
    from prooflight.press.artefact import Press
    from prooflight.press.pages import job_source

    rules = Rules(
        layers=tuple(Rule.parse("--layer", one) for one in layer or ()),
        annotations=tuple(Rule.parse("--annotation", one) for one in annotation or ()),
        outside_bleed=None
        if outside_bleed is None
        else Rule.parse("--outside-bleed", f"x={outside_bleed}").kind,
        edge_mm=edge_mm,
    )
    loaded = None if press is None else Press.load(press)
    if loaded is None:
        source = JobSource(path=job, dpi=ANY_DPI, profile=profile)
    else:
        source = job_source(job, loaded, profile=profile)
    with source.open() as opened:
        numbers = parse_pages(pages, len(opened)) if pages else tuple(range(1, len(opened) + 1))
        sizes = opened.page_sizes_mm
        walked = numbers if json else show.progress(numbers, total=len(numbers), what="looking for zones")
        entries, unmet = _entries(opened, walked, rules, loaded)
    if not entries:
        what = "; ".join(unmet) or "no page has a layer, annotation or code that these rules name"
        raise RequestError(
            job, what, remedy="name layers or annotations that it has, or give --press for its codes"
        )
    new_zones = JobZones.create(on_all_pages(entries, len(sizes)), sizes, where=job)
    new_zones.save(out)
    for line in (*unmet, *new_zones.contested()):
        faults.report(line)
    if json:
        show.print_json(
            {"zones": new_zones.document.model_dump(mode="json", by_alias=True), "digest": new_zones.digest}
        )
        return
    show.people.print(_table(new_zones, job.name))
    show.written(out)


def _entries(job: Job, numbers: Any, rules: Rules, press: Press | None) -> tuple[list[ZoneEntry], list[str]]:
    """Return zones of pages, and the rules that matched nothing."""
    from prooflight.inspection.codes.finding import code_zones

    entries, seen = [], []
    for number in numbers:
        marks, size = job.marks(number), job.page_size_mm(number)
        seen += [] if marks is None else [marks]
        entries += rules.entries(marks, number, size)
        if press is not None:
            entries += code_zones(job, number, press)
    return entries, rules.unmet(seen)


def _table(zones: JobZones, title: str) -> Any:
    table = show.table_of(
        f"zones of {title}", ("zone", "kind", "pages", "mm"), text_columns=("zone", "kind", "pages", "mm")
    )
    for entry in zones.document.zones:
        if entry.rectangle_mm is not None:
            x, y, width, height = entry.rectangle_mm
            place = f"{width:.0f} x {height:.0f} at {x:.0f}, {y:.0f}"
        else:
            place = f"{len(entry.polygon_mm or ())} corners"
        table.add_row(entry.name, entry.kind, entry.pages, place)
    return table


def price(
    zones: ZonesPath,
    job: JobPath,
    press: PressArtefact,
    save: Annotated[
        bool, typer.Option("--save", help="Put the zones in force: write the price into ZONES.")
    ] = False,
    prints: Annotated[
        int, typer.Option(help="Number of good prints that calibrate the zones.", min=12, max=MOST_PRINTS)
    ] = 90,
    trials: Annotated[
        int,
        typer.Option(
            help="Number of prints with a defect, of each sort in each zone; 0: none.", min=0, max=MOST_PRINTS
        ),
    ] = 24,
    detector: Detector = None,
    picture: Picture = None,
    profile: Profile = None,
    seed: Seed = 1,
    json: Json = False,
) -> None:
    """Price zones by the smallest spot, streak and loss of density caught at 99 % with and without them.

    Good prints of the job's pages are simulated; they also calibrate the zones, so that the press's
    false-alarm rate holds page-wide with them in force. Nothing is written without --save.
    """
    from prooflight.commissioning.zones.price import price_of
    from prooflight.pages.zones.zones_file import JobZones
    from prooflight.press.artefact import Press
    from prooflight.press.pages import job_source

    loaded = Press.load(press)
    source = job_source(job, loaded, profile=profile)
    with source.open() as opened:
        zones_of_job = JobZones.read(zones, opened.page_sizes_mm)
    for line in zones_of_job.contested():
        faults.report(line)
    priced = price_of(
        source,
        loaded,
        zones_of_job,
        prints=prints,
        trials=trials,
        seed=seed,
        detector=detector,
        shown=lambda items, total, what: items if json else show.progress(items, total=total, what=what),
    )
    if picture is not None:
        _draw(picture, source, zones_of_job)
    if save:
        zones_of_job.priced(priced.entry).save(zones)
    if json:
        show.print_json(_plain(priced, saved=save))
        return
    _say(priced)
    if save:
        show.written(zones)
    else:
        show.people.print("Nothing was saved: --save puts the zones in force.")


def _say(price: Price) -> None:
    """Print the price, for people."""
    from prooflight.commissioning.zones.defects import SORTS

    text_columns = ("zone", "kind", "what is caught at 99 %")
    table = show.table_of(
        "price of the zones", (*text_columns, "without zones", "with them"), text_columns=text_columns
    )
    for area in price.areas:
        for at, sort in enumerate(SORTS):
            if sort.name in area.before:
                sizes = (_least(area.before[sort.name], sort.unit), _least(area.after[sort.name], sort.unit))
                first = ("", "") if at else (area.name, "" if area.kind == "rest" else area.kind)
                table.add_row(*first, WHAT[sort.name], *sizes)
    if price.areas:
        show.people.print(table)
    show.people.print(
        f"False alarms: at most one good page in {1 / price.promised:,.0f}, without zones and with them. "
        f"Of {price.good} good prints {price.alarmed_before} alarm without zones, {price.alarmed_after} with them."
    )
    if price.extrapolated:
        show.people.print(
            "The careful zones' share of that is extrapolated: more --prints confirm it by count."
        )


WHAT: Final = {
    "spot": "smallest spot",
    "streak": "faintest streak, 0.5 mm wide",
    "density": "least loss of all inks",
}


def _least(one: Any, unit: str) -> str:
    if not one.ever:
        return "none"
    high = f"{one.high:.2g}" if one.high < float("inf") else "more"
    return f"{one.least:.2g} {unit} ({one.low:.2g} to {high})"


def _plain(price: Price, *, saved: bool) -> dict[str, Any]:
    return {
        "zones": list(price.entry.told),
        "promised": price.promised,
        "good_prints": price.good,
        "alarmed_before": price.alarmed_before,
        "alarmed_after": price.alarmed_after,
        "extrapolated": price.extrapolated,
        "saved": saved,
    }


def show_zones(
    zones: ZonesPath, job: JobPath, picture: Picture = None, profile: Profile = None, json: Json = False
) -> None:
    """List the zones of a job's pages, with the price that was shown when they were saved; draw them."""
    from prooflight.pages.job import JobSource
    from prooflight.pages.zones.zones_file import JobZones

    source = JobSource(path=job, dpi=DRAWN_DPI, profile=profile)
    with source.open() as opened:
        zones_of_job = JobZones.read(zones, opened.page_sizes_mm)
    for line in zones_of_job.contested():
        faults.report(line)
    if picture is not None:
        _draw(picture, source, zones_of_job)
    if json:
        show.print_json(
            {
                "zones": zones_of_job.document.model_dump(mode="json", by_alias=True),
                "digest": zones_of_job.digest,
            }
        )
        return
    show.people.print(_table(zones_of_job, job.name))
    price_entry = zones_of_job.document.price
    status = (
        "not priced yet, and not in force"
        if price_entry is None
        else f"priced by {count(price_entry.prints, 'good print')}"
    )
    show.people.print(f"{status}; digest {zones_of_job.digest[:12]}")


def drop(
    zones: ZonesPath,
    job: JobPath,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the zone, as `zones show` lists it.")],
    profile: Profile = None,
    json: Json = False,
) -> None:
    """Remove a zone from a job's zones; the others must be priced again. A file without zones is removed."""
    from prooflight.pages.job import JobSource
    from prooflight.pages.zones.zones_file import JobZones

    with JobSource(path=job, dpi=ANY_DPI, profile=profile).open() as opened:
        sizes = opened.page_sizes_mm
    zones_of_job = JobZones.read(zones, sizes)
    left = zones_of_job.without(name)
    if left:
        share = zones_of_job.document.careful_share
        JobZones.create(left, sizes, careful_share=share, where=zones).save(zones)
    else:
        zones.unlink()
    if json:
        show.print_json({"zones": str(zones) if left else None, "left": [one.name for one in left]})
        return
    show.people.print(f"{name}: removed; {count(len(left), 'zone')} left")


DRAWN_DPI: Final = 100.0


def _draw(picture: Path, source: Any, zones: JobZones) -> None:
    from dataclasses import replace

    from prooflight.files.atomic import whole_file
    from prooflight.reporting.zones_picture import zones_picture

    number = next(iter(zones.of_pages))
    with replace(source, dpi=DRAWN_DPI).open() as opened:
        drawn = zones_picture(opened.page(number), zones.of_pages[number])
    with whole_file(picture) as unfinished:
        drawn.save(unfinished, format="PNG")
    show.written(picture)
