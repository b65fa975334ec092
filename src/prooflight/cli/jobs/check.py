"""``prooflight job check``: the content of each page of a job, and deviations of its print from the file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.text import Text

from prooflight.cli import faults, show
from prooflight.cli.exit_codes import EXIT_MISPRINT, NOT_ALL_INSPECTED
from prooflight.cli.options import JobPath, Json, Pages, Profile
from prooflight.errors import visible
from prooflight.reporting.wording import count

if TYPE_CHECKING:
    from prooflight.cli.jobs.stated_spots import StatedSpots
    from prooflight.pages.check import CheckedPage, EarlyWarnings
    from prooflight.pages.job import Job
    from prooflight.pages.pdf.facts import PlacedImage
    from prooflight.pages.raster import Page
    from prooflight.pages.warnings import PageWarning
    from prooflight.press.artefact import Press

ANY_DPI: Final = 75.0
"""Resolution without a press, at twice which pages are drawn."""
PICTURE_PX: Final = 1200
NAMED: Final = 12
"""Most layers, fonts and spot colours of a page that are named for people; JSON has all."""


def check(
    job: JobPath,
    press: Annotated[
        Path | None,
        typer.Option("--press", metavar="X.press", help="Press that draws the pages; default MuPDF."),
    ] = None,
    pictures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write a picture of each page, as it will look in print."),
    ] = None,
    pages: Pages = None,
    profile: Profile = None,
    json: Json = False,
) -> None:
    """Check a job before it is printed: sizes, inks, spots, layers, fonts, images, and every warning.

    Exits 1 if there is a warning, 3 if a page cannot be used and would not be inspected.
    """
    from prooflight.cli.jobs.stated_spots import StatedSpots
    from prooflight.pages.check import checked_page
    from prooflight.pages.job import JobSource, parse_pages
    from prooflight.press.artefact import Press
    from prooflight.press.pages import job_source
    from prooflight.press.print_condition import condition_warnings

    loaded = None if press is None else Press.load(press)
    if loaded is None:
        source = JobSource(path=job, dpi=ANY_DPI, profile=profile)
    else:
        source = job_source(job, loaded, profile=profile)
    done: list[CheckedPage] = []
    with source.open() as opened:
        spots = StatedSpots.of(opened, loaded)
        numbers = parse_pages(pages, len(opened)) if pages else tuple(range(1, len(opened) + 1))
        draw = None if pictures is None else _drawing(pictures, loaded)
        for number in numbers if json else show.progress(numbers, total=len(numbers), what="checking"):
            checked, page = checked_page(opened, number)
            done.append(checked)
            if draw is not None and page is not None:
                draw(page)
            if json:
                show.print_json(_plain(checked, loaded, spots))
        of_files = [warning for warning in opened.warnings if warning.page < 0]
        if loaded is not None:
            of_files += [*condition_warnings(opened, loaded.print_condition), *spots.warnings]
        name = opened.name
    if json:
        tell_warnings(of_files, json=True)
    else:
        title = f"{name}, as {'MuPDF draws it' if loaded is None else f'press {loaded.name} prints it'}"
        _show(done, of_files, title, loaded, spots)
        if pictures is not None and any(page.coverage is not None for page in done):
            show.written(pictures)
    refused = sum(bool(page.refused) for page in done)
    if refused:
        raise typer.Exit(NOT_ALL_INSPECTED)
    if of_files or any(page.warnings for page in done):
        raise typer.Exit(EXIT_MISPRINT)


def checked_early(job: Job, *, json: bool, more: Sequence[PageWarning] = ()) -> EarlyWarnings:
    """Print warnings of a job before its first sheet: lines of JSON for programs, standard error for people.

    more: warnings that are known already.
    """
    from prooflight.pages.check import early_warnings

    def shown(numbers: Iterable[int], total: int) -> Iterable[int]:
        return numbers if json else show.progress(numbers, total=total, what="checking the job")

    early = early_warnings(job, shown=shown)
    early = replace(early, warnings=(*more, *early.warnings))
    tell_warnings(early.warnings, json=json)
    if early.remark and not json:
        faults.report(early.remark)
    return early


def tell_warnings(warnings: Iterable[PageWarning], *, json: bool) -> None:
    """Print each warning on a line."""
    from prooflight.pages.check import plain, warning_text

    for warning in warnings:
        if json:
            show.print_json({"warning": plain(warning)})
        else:
            faults.report(f"warning: {warning_text(warning)}")


def _drawing(folder: Path, press: Press | None) -> Callable[[Page], None]:
    """Return a function that writes the picture of a page into a folder."""
    from prooflight.commissioning.characterise import appearance_srgb
    from prooflight.inks.built_in import built_in_inks
    from prooflight.reporting.pictures import raster_picture

    colours = appearance_srgb(built_in_inks()) if press is None else press.appearance_srgb
    folder.mkdir(parents=True, exist_ok=True)

    def draw(page: Page) -> None:
        raster_picture(page, colours, width_px=PICTURE_PX).save(folder / f"{page.name}.png")

    return draw


def _plain(page: CheckedPage, press: Press | None, stated: StatedSpots) -> dict[str, Any]:
    """Return the data of one page for programs; ink is in per cent."""
    from prooflight.cmyk import INK_NAMES
    from prooflight.pages.check import plain

    facts = {} if page.facts is None else asdict(page.facts)
    spots = [
        spot
        | {
            "cmyk_percent": _percent(page.spots.get(spot["name"])),
            "srgb": _srgb(page, spot["name"], press),
            "delta_e00": stated.delta_e00(spot["name"], page.spots.get(spot["name"])),
            "spectrum": stated.spectrum(spot["name"]),
            "own_unit": spot["name"] in stated.units,
            "light_off_percent": stated.light_off_percent(spot["name"]),
        }
        for spot in facts.pop("spots", [])
    ]
    size = page.size_mm
    return {
        "page": page.name,
        "width_mm": None if size is None else round(size[0], 2),
        "height_mm": None if size is None else round(size[1], 2),
        "coverage_percent": None
        if page.coverage is None
        else {name: round(100 * share, 2) for name, share in zip(INK_NAMES, page.coverage, strict=True)},
        "spots": spots,
        **facts,
        "warnings": [plain(warning) for warning in page.warnings],
        "refused": page.refused,
    }


def _percent(cmyk: Sequence[int] | None) -> list[float] | None:
    return None if cmyk is None else [round(100 * ink / 255, 1) for ink in cmyk]


def _srgb(page: CheckedPage, name: str, press: Press | None) -> str | None:
    """Return the appearance of a spot colour in the inks of a press, paper shown white; None without a press."""
    import numpy as np

    from prooflight.reporting.pictures import appearance

    cmyk = page.spots.get(name)
    if press is None or cmyk is None:
        return None
    red, green, blue = appearance(np.array([[cmyk]], np.uint8), press.appearance_srgb)[0, 0]
    return f"#{red:02x}{green:02x}{blue:02x}"


def _show(
    done: Sequence[CheckedPage],
    of_files: Sequence[Any],
    title: str,
    press: Press | None,
    stated: StatedSpots,
) -> None:
    """Print one row a page for people, then what its cells only count, then every warning."""
    from prooflight.pages.check import warning_text

    text_columns = ("page", "size [mm]", "inks [%]", "transparency, overprint", "made of")
    table = show.table_of(title, text_columns, text_columns=text_columns)
    table.columns[0].no_wrap = True
    for page in done:
        table.add_row(page.name, *_cells(page))
    show.people.print(table)
    _show_spots(done, press, stated)
    for title, lines in (
        ("Output intents", _by_page(done, lambda facts: [facts.output_intent or "none"])),
        (
            "Layers that are not printed",
            _by_page(done, lambda facts: [x.name for x in facts.layers if not x.printed]),
        ),
        (
            "Layers that are printed",
            _by_page(done, lambda facts: [x.name for x in facts.layers if x.printed]),
        ),
        (
            "Fonts that are not embedded",
            _by_page(done, lambda facts: [x.name for x in facts.fonts if not x.embedded]),
        ),
    ):
        for line in lines:
            show.people.print(f"{title}: {line}")
    warnings = [*of_files, *(warning for page in done for warning in page.warnings)]
    for warning in warnings:
        shown = Text.assemble(("warning ", "yellow"), visible(warning_text(warning)))
        show.people.print(shown, soft_wrap=True)
    for page in done:
        if page.refused:
            faults.report(f"{page.name} cannot be used and would not be inspected: {page.refused}")
    refused = sum(bool(page.refused) for page in done)
    parts = [count(len(done), "page"), count(len(warnings), "warning")]
    show.people.print(", ".join(parts + ([f"{refused:,} cannot be used"] if refused else [])))


def _cells(page: CheckedPage) -> list[str]:
    """Return the cells of a page's row after its name; absent features are left out."""
    from prooflight.cmyk import INK_LETTERS

    size, facts = page.size_mm, page.facts
    sides = [] if size is None else [f"{size[0]:.1f} x {size[1]:.1f}"]
    inks = [
        f"{letter} {100 * share:.1f}" for letter, share in zip(INK_LETTERS, page.coverage or (), strict=False)
    ]
    printed = ["  ".join(inks[:2]), "  ".join(inks[2:])] if inks else ["cannot be drawn"]
    if facts is None:
        return ["\n".join(sides), "\n".join(printed), "", ""]
    spots = _some("spot", [spot.painted for spot in facts.spots], "painted")
    effects = [*facts.transparency, *(f"overprint {mode}" for mode in facts.overprint)]
    content = (
        _some("layer", [layer.printed for layer in facts.layers], "printed"),
        _some("font", [font.embedded for font in facts.fonts], "embedded"),
        _images(facts.images),
    )
    return [
        "\n".join([*sides, facts.box]),
        "\n".join(filter(None, (*printed, spots))),
        "\n".join(effects),
        "\n".join(filter(None, content)),
    ]


def _some(what: str, are: Sequence[bool], so: str) -> str:
    """Return the number of items, and how many of them have the property; empty if there are none."""
    if not are:
        return ""
    those = "all" if all(are) and len(are) > 1 else "" if all(are) else f"{sum(are)}" if any(are) else "not"
    return f"{count(len(are), what)}, {those} {so}".replace(",  ", ", ")


def _images(images: Sequence[PlacedImage]) -> str:
    """Return the number of images, and the range of their resolutions.

    Lines of single pixels are gradients, and have no resolution.
    """
    if not images:
        return ""
    dpi = [round(min(image.dpi)) for image in images if min(image.width_px, image.height_px) > 1]
    if not dpi:
        return count(len(images), "image")
    span = f"{min(dpi)}" if min(dpi) == max(dpi) else f"{min(dpi)} to {max(dpi)}"
    return f"{count(len(images), 'image')}, {span} dpi"


def _by_page(done: Sequence[CheckedPage], names_of: Callable[[Any], Sequence[str]]) -> list[str]:
    """Return the names of pages' features, each set once with the pages that have it."""
    pages: dict[tuple[str, ...], list[str]] = {}
    for page in done:
        names = () if page.facts is None else tuple(dict.fromkeys(names_of(page.facts)))
        if names:
            pages.setdefault(names, []).append(page.name)
    return [f"{_few(names)} ({_few(where)})" for names, where in pages.items()]


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def _show_spots(done: Sequence[CheckedPage], press: Press | None, stated: StatedSpots) -> None:
    """Print the inks of each spot colour, with the pages that list it."""
    rows: dict[tuple[str, tuple[int, ...], bool], list[CheckedPage]] = {}
    for page in done:
        for spot in () if page.facts is None else page.facts.spots:
            rows.setdefault((spot.name, tuple(page.spots.get(spot.name, ())), spot.painted), []).append(page)
    if not rows:
        return
    text_columns = ("spot colour", "looks like", "painted", "pages")
    table = show.table_of(
        "What is printed of spot colours, in per cent", text_columns[:1], text_columns=text_columns
    )
    for letter in "CMYK":
        table.add_column(letter, justify="right")
    for heading in text_columns[1:] if press is not None else text_columns[2:]:
        table.add_column(heading)
    for (name, cmyk, painted), pages in rows.items():
        inks = [f"{ink:g}" for ink in _percent(cmyk) or ()] or ["–"] * 4
        colour = _srgb(pages[0], name, press)
        swatch = (
            []
            if press is None
            else [Text.assemble(("   ", f"on {colour}"), f" {colour}") if colour else Text("–")]
        )
        shown = "yes" if painted else "no"
        table.add_row(visible(name), *inks, *swatch, shown, _few([page.name for page in pages]))
    show.people.print(table)
    for name, cmyk in {
        name: cmyk for name, cmyk, _ in rows if name in stated.spectra.inks or name in stated.units
    }.items():
        show.people.print(Text(visible(_spectral(stated, name, cmyk))), soft_wrap=True)


def _spectral(stated: StatedSpots, name: str, cmyk: tuple[int, ...]) -> str:
    """Return where an ink's spectrum is from, by what it is printed, and how far off it is, in one line."""
    light, colour = stated.light_off_percent(name), stated.delta_e00(name, cmyk or None)
    by = "its own unit" if name in stated.units else "process inks"
    off = [] if colour is None else [f"{colour:.1f} CIEDE2000 off its colour"]
    off += [] if light is None else [f"{light:.1f} % of white off its signal"]
    return f"Spectrum of {name}: {stated.spectrum_text(name)}; printed by {', '.join([by, *off])}"
