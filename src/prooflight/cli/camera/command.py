"""``prooflight camera``: a camera's response and sharpness, variants of its design, and its measured sensor block.

Those for connected cameras are of the package prooflight-line.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from prooflight.cli import show
from prooflight.cli.camera import tables
from prooflight.cli.options import Json
from prooflight.errors import RequestError
from prooflight.files.given import shortly

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import LineSensor
    from prooflight.commissioning.camera.exposures import ExposureRequest

app = typer.Typer(
    help="Compute a camera's response and sharpness, compare designs, measure a sensor.",
    no_args_is_help=True,
)

PressFileArgument = Annotated[Path, typer.Argument(metavar="PRESS.toml", help="Press file.")]
Picture = Annotated[Path | None, typer.Option(metavar="F.png", help="Draw the curves.")]


def register(program: typer.Typer) -> None:
    """Add these commands to the program."""
    program.add_typer(app, name="camera")


@app.command()
def respond(
    press_file: PressFileArgument,
    reflectance: Annotated[
        str,
        typer.Option(
            metavar="R.json", help='{"wave_nm": [...], "reflectance": [[...], ...]}; - for standard input.'
        ),
    ],
    json: Json = False,
) -> None:
    """Compute irradiance, electrons, volts, digital numbers and their noise for even colours, on the lens's axis."""
    from prooflight.camera import camera as sensing
    from prooflight.camera.reflectances import parse_reflectances
    from prooflight.press.press_file import PressFile

    camera = PressFile.read(press_file).camera()
    text, where = _text_of(reflectance)
    answers = sensing.respond(camera, parse_reflectances(text, where=where))
    if json:
        show.print_json({"sensors": answers})
        return
    for answer in answers:
        show.people.print(tables.response_table(answer))


@app.command()
def mtf(
    press_file: PressFileArgument,
    wave: Annotated[float, typer.Option(metavar="NM", help="Wavelength [nm].")] = 550.0,
    freq: Annotated[
        str | None,
        typer.Option(
            metavar="0,10,..", help="Frequencies on the sensor [cycles/mm]; default up to one a pixel."
        ),
    ] = None,
    sensor: Annotated[
        int, typer.Option(metavar="N", help="Number of the sensor, if there are several.", min=1)
    ] = 1,
    picture: Picture = None,
    json: Json = False,
) -> None:
    """Compute the modulation transfer of lens and system across the web and along it.

    Along the web it includes motion, TDI smear and binning.
    """
    import numpy as np

    from prooflight.camera.sharpness import nyquist_per_mm, sharpness
    from prooflight.press.press_file import PressFile

    camera = PressFile.read(press_file).camera()
    chosen = _sensor(camera, sensor)
    if not (np.isfinite(wave) and wave > 0):
        raise RequestError("--wave", f"{wave:g} is not a wavelength", remedy="give nanometres, e.g. 550")
    nyquist = nyquist_per_mm(chosen)
    frequency = np.linspace(0, 2 * nyquist, 21) if freq is None else np.array(_frequencies(freq))
    if picture is not None:
        fine = np.linspace(0, max(float(frequency.max()), nyquist), 200)
        title = f"MTF at {wave:g} nm, working F-number {camera.lens.working_f_number:.3g}"
        curves = sharpness(camera, chosen, fine, wave_nm=wave)
        tables.draw_sharpness(picture, fine, curves, nyquist=nyquist, title=title)
    transfer = sharpness(camera, chosen, frequency, wave_nm=wave)
    if json:
        show.print_json(
            {
                "freq": frequency,
                "lens": transfer.lens,
                "system": transfer.across,
                "system_along": transfer.along,
            }
        )
        return
    title = f"MTF of sensor {chosen.name} at {wave:g} nm"
    magnification = camera.lens.magnification
    show.people.print(tables.sharpness_table(title, frequency, transfer, magnification=magnification))


@app.command()
def explore(
    press_file: PressFileArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="FIELD=a,b,c",
            help="Values of a field, e.g. lens.f_number=2.8,4; several options make a grid.",
        ),
    ],
    picture: Picture = None,
    json: Json = False,
) -> None:
    """Compute signal, noise, sharpness and speed for variants of the press file."""
    from prooflight.commissioning.camera import exploring
    from prooflight.press.press_file import PressFile

    variations = [exploring.Variation.parse(text) for text in vary]
    total = math.prod(len(variation.values) for variation in variations)
    rows = exploring.designs(PressFile.read(press_file), variations)
    designs = list(rows if json else show.progress(rows, total=total, what="exploring"))
    if picture is not None:
        tables.draw_designs(picture, designs)
    if json:
        show.print_json(designs)
        return
    for table in tables.design_tables(designs):
        show.people.print(table)


@app.command()
def characterise(
    exposures: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="DARK... FLAT...", help="TIFF files or folders; the darkest are taken as dark."
        ),
    ] = None,
    dark: Annotated[
        list[str] | None,
        typer.Option(
            metavar="D.tif[@HZ]",
            help="Exposures with the lens covered; @HZ: at another line rate than the flat ones.",
        ),
    ] = None,
    flat: Annotated[
        list[str] | None,
        typer.Option(metavar="F.tif", help="Exposures of uniform light, at 8 or more levels."),
    ] = None,
    like: Annotated[
        Path | None,
        typer.Option(metavar="PRESS.toml", help="Press file for the values that exposures do not show."),
    ] = None,
    voltage_swing_v: Annotated[
        float | None, typer.Option(metavar="V", help="Full scale of the converter [V]; default as in --like.")
    ] = None,
    bits: Annotated[
        int | None, typer.Option(help="Bits of the converter; default as in --like.", min=1, max=16)
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="SENSOR.toml", help="Write the block.")
    ] = None,
    picture: Picture = None,
    json: Json = False,
) -> None:
    """Measure a sensor block from dark and flat exposures by photon transfer (EMVA 1288)."""
    from prooflight.commissioning.camera.exposures import ExposureRequests, read_exposures
    from prooflight.commissioning.camera.sensor_block import Given, characterise_sensors
    from prooflight.files.atomic import whole_file
    from prooflight.press.press_file import PressFile

    if voltage_swing_v is not None and not 0 < voltage_swing_v < float("inf"):
        raise RequestError(
            "--voltage-swing-v", f"{voltage_swing_v:g} is not a swing", remedy="give volts above 0"
        )
    likes = PressFile.read(like).camera().sensors if like else ()
    given = Given(like_name=like.name if like else "", voltage_swing_v=voltage_swing_v, bits=bits)
    requests = ExposureRequests.parse(dark=dark or (), flat=flat or (), either=exposures or ())
    darks, flats = read_exposures(requests, sensors=len(likes) or None, shown=iter if json else _reading)
    blocks = characterise_sensors(darks, flats, likes=likes, given=given)
    text = "\n".join(block.toml() for block in blocks)
    if out is not None:
        with whole_file(out) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    if picture is not None:
        tables.draw_photon_transfer(picture, blocks)
    if json:
        for block in blocks:
            show.print_json(tables.block_json(block))
        return
    for block in blocks:
        show.people.print(tables.block_table(block))
        for note in block.notes:
            show.people.print(f"- {note}", highlight=False)
    if out is None:
        sys.stdout.write(text)
    else:
        show.people.print(show.strong(out), "written")


def _reading(requests: Sequence[ExposureRequest]) -> Iterator[ExposureRequest]:
    return show.progress(requests, total=len(requests), what="reading exposures")


def _text_of(name: str) -> tuple[str, str]:
    """Return the text of a file or of standard input, and its name for errors."""
    from prooflight.camera.reflectances import REFLECTANCE_FILES as FILES

    if name != "-":
        return FILES.read_text(Path(name)), name
    where = "standard input"
    try:
        data = sys.stdin.read(FILES.most_bytes + 1).encode(errors="surrogateescape")
    except UnicodeDecodeError as error:
        raise RequestError(where, "is not text", remedy=FILES.remedy) from error
    return FILES.text(FILES.bounded(data, where=where), where=where), where


def _sensor(camera: Camera, number: int) -> LineSensor:
    if number > len(camera.sensors):
        remedy = f"choose 1 to {len(camera.sensors)}"
        raise RequestError("--sensor", f"there is no sensor {number}", remedy=remedy)
    return camera.sensors[number - 1]


def _frequencies(text: str) -> list[float]:
    remedy = "give cycles/mm on the sensor, 0 or more, e.g. 0,10,20"
    numbers = []
    for item in text.split(","):
        try:
            number = float(item)
        except ValueError as error:
            raise RequestError("--freq", f"{shortly(item)!r} is not a number", remedy=remedy) from error
        if not 0 <= number < float("inf"):
            raise RequestError("--freq", f"{shortly(item)} is not a frequency", remedy=remedy)
        numbers.append(number)
    return numbers
