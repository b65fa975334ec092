"""``prooflight press rip-model``: identify the parameters of a press's RIP, and write them into a press file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prooflight.cli import show
from prooflight.errors import RequestError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.commissioning.rip_identification import Identified
    from prooflight.detectors.base import Inspection
    from prooflight.pages.pdf.rip_model import RipModel
    from prooflight.pages.raster import Page
    from prooflight.press.press_file import PressFile

WHY = "identified by press rip-model"


def register(app: typer.Typer) -> None:
    """Add the command to ``prooflight press``."""
    app.command("rip-model")(rip_model)


def rip_model(
    press_file: Annotated[
        Path | None, typer.Argument(metavar="PRESS.toml", help="Press file, which states [rip] dpi.")
    ] = None,
    job: Annotated[Path | None, typer.Argument(metavar="JOB.pdf", help="The PDF.")] = None,
    rasters: Annotated[
        Path | None,
        typer.Option(metavar="PAGES", help="CMYK TIFFs of its pages, as the press's front end makes them."),
    ] = None,
    scans: Annotated[
        list[Path] | None,
        typer.Option(metavar="SCANS", help="Scans of good prints of it; again for each further copy."),
    ] = None,
    press: Annotated[
        Path | None, typer.Option(metavar="X.press", help="With --scans: the press that printed them.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="NEW.toml", help="Where to write the press file with its [rip]."),
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Overwrite an existing file.")] = False,
    test_page: Annotated[
        Path | None,
        typer.Option(metavar="TEST.pdf", help="Write a page with edges, hairlines and tints of every ink."),
    ] = None,
) -> None:
    """Identify how a press's RIP makes pixels of shapes, from its rasters or from scans of good pages."""
    for path in (out, test_page):
        if path is not None and path.exists() and not replace:
            raise RequestError(path, "exists already", remedy="name another file, or add --replace")
    if test_page is not None:
        from prooflight.commissioning.rip_identification import test_pdf
        from prooflight.files.atomic import whole_file

        with whole_file(test_page) as unfinished:
            unfinished.write_bytes(test_pdf())
        show.people.print(
            show.strong(test_page), "written: have the press rip or print it, then give it as the job"
        )
        return
    if press_file is None or job is None or (rasters is None) == (not scans):
        what = "needs a press file, a PDF, and either its rasters or scans of it"
        raise RequestError(
            "rip-model", what, remedy="give PRESS.toml JOB.pdf --rasters PAGES, or --scans SCANS --press X"
        )
    from prooflight.pages.pdf.rip_model import UNSTATED
    from prooflight.press.press_file import PressFile

    settings = PressFile.read(press_file)
    if rasters is not None:
        identified = _from_rasters(settings, job, rasters)
    elif press is not None and scans:
        identified = _from_scans(job, scans, press)
    else:
        raise RequestError(
            "rip-model", "--scans needs the press that printed them", remedy="add --press X.press"
        )
    for sentence in identified.sentences:
        show.people.print(sentence)
    if out is not None:
        if identified.model == UNSTATED:
            what = "has no edges from which the RIP could be identified"
            raise RequestError(job, what, remedy="use the page that --test-page writes")
        _write(settings, identified.model, out)
        show.people.print(show.strong(out), "written: build the press from it")


def _from_rasters(settings: PressFile, job: Path, rasters: Path) -> Identified:
    from prooflight.commissioning.rip_identification import identified_from_rasters
    from prooflight.pages.job import Job, JobSource
    from prooflight.pages.pdf.rip import PdfJob

    dpi = settings.rip_dpi
    if dpi is None:
        raise RequestError(
            settings.path, "states no [rip] dpi", remedy="add the resolution of the press's RIP"
        )
    step = show.steps(quiet=False)
    engine = None if settings.rip_engine.name == "mupdf" else settings.rip_engine
    with Job(JobSource(path=rasters, dpi=dpi)) as given, PdfJob(job, engine=engine) as pdf:
        count = len(given)
        if count > len(pdf):
            what = f"holds {count} pages, and the job {len(pdf)}"
            raise RequestError(rasters, what, remedy="give rasters of the job's first pages, in their order")
        pages = [page.cmyk for page in given]
        for number, page in enumerate(given, 1):
            if abs(page.dpi / dpi - 1) > 0.01:
                what = f"page {number} has {page.dpi:g} dpi where [rip] states {dpi:g}"
                raise RequestError(rasters, what, remedy="give rasters of that resolution")

        def drawn(model: RipModel) -> list[NDArray[np.uint8]]:
            step(f"drawing by the rule {model.fill or 'of ' + settings.rip_engine.name}")
            result = []
            for number, like in enumerate(pages, 1):
                cmyk = pdf.page(number, dpi, drawn_dpi=dpi, rip=model).cmyk
                if max(abs(a - b) for a, b in zip(cmyk.shape[:2], like.shape[:2], strict=True)) > 2:
                    wanted = f"{cmyk.shape[1]} x {cmyk.shape[0]}"
                    size = f"{like.shape[1]} x {like.shape[0]} pixels where the page has {wanted}"
                    raise RequestError(
                        rasters, f"page {number} has {size}", remedy="give rasters of the printed box"
                    )
                result.append(cmyk[: like.shape[0], : like.shape[1]])
            return result

        first = drawn(settings.rip_model)
        pages = [page[: like.shape[0], : like.shape[1]] for page, like in zip(pages, first, strict=True)]
        return identified_from_rasters(pages, drawn, dpi=dpi, is_own_engine=engine is None)


def _from_scans(job: Path, copies: Sequence[Path], press_path: Path) -> Identified:
    from prooflight.commissioning.rip_identification import identified_from_scans
    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.job import pair
    from prooflight.press.artefact import Press
    from prooflight.press.pages import open_job

    press, step = Press.load(press_path), show.steps(quiet=False)
    inspector = Inspector(press)
    with open_job(job, press) as pages:

        def inspected() -> Iterator[tuple[Page, Inspection]]:
            for scans in copies:
                for page, scan in pair(pages, scans, partly=True):
                    step(f"measuring edges of {page.name} in {scans}")
                    yield page, inspector.inspect(page, scan)

        return identified_from_scans(inspected(), press)


def _write(settings: PressFile, model: RipModel, out: Path) -> None:
    """Write the press file with these parameters in ``[rip]``; PressFileError: it would be invalid."""
    from prooflight.commissioning.file_edit import Edit, edited
    from prooflight.files.atomic import whole_file
    from prooflight.pages.pdf.rip_model import UNSTATED
    from prooflight.press.press_file import PressFile

    edits = []
    for field in RIP_FIELDS:
        value: Any = getattr(model, field)
        if value != getattr(UNSTATED, field):
            plain = list(value) if isinstance(value, tuple) else value
            edits.append(Edit(block="rip", field=field, value=plain, why=WHY))
    text = edited(settings.text, edits)
    PressFile(out, text)
    with whole_file(out) as unfinished:
        unfinished.write_bytes(text.encode())


RIP_FIELDS = ("fill", "growth_um", "growth_sd_um", "edge_sd_um")
