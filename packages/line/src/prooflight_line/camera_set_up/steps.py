"""Steps of a line camera's set-up, in their order: a person's task and the measurement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.commissioning.file_edit import Edit
from prooflight.errors import RequestError, ScanError
from prooflight.files.given import shortly
from prooflight_line.camera_set_up import exposure_steps, page_steps
from prooflight_line.camera_set_up.bench import StepResult

if TYPE_CHECKING:
    from prooflight.camera.sensor import LineSensor
    from prooflight_line.camera_set_up.bench import Bench


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Step of a set-up."""

    key: str
    title: str
    do: str
    """Task of a person before the measurement; empty: none."""
    measure: Callable[[Bench], StepResult]
    again: bool = False
    """Whether it is repeated when a stopped set-up is resumed."""
    spared: Callable[[Bench], str] = lambda _bench: ""
    """Reason why this camera does not need it; empty: it does."""


def _fits(bench: Bench) -> StepResult:
    """Compare width and depth of the camera's lines with the press file."""
    line_reader, sensors = bench.line_reader, bench.camera().sensors
    form = f"{line_reader.sensors} x {line_reader.pixels} pixels, {line_reader.form.name}"
    edits: list[Edit] = []
    if bench.begun and not bench.described:
        if line_reader.sensors != len(sensors):
            what = (
                f"sends {line_reader.sensors} sensors, but {bench.press.path.name} describes {len(sensors)}"
            )
            raise ScanError(
                bench.where, what, remedy="start with a press file that has as many [[sensor]] blocks"
            )
        edits = _of_data_sheet(bench)
    else:
        _refuse_other(bench, sensors)
    rate = bench.line_reader.feature("line_rate_hz")
    rate_text = f", {float(rate.value):g} lines/s as it reports" if rate is not None and rate.value else ""
    return StepResult(good=True, remarks=(f"{bench.where}: {form}{rate_text}",), edits=tuple(edits))


def _refuse_other(bench: Bench, sensors: Sequence[LineSensor]) -> None:
    line_reader, file = bench.line_reader, bench.press.path.name
    if line_reader.pixels != sensors[0].pixels:
        what = f"sends lines of {line_reader.pixels} pixels, but {file} states sensor.pixels = {sensors[0].pixels}"
        raise ScanError(
            bench.where,
            what,
            remedy=f"set Width = {sensors[0].pixels} under [camera.features], or correct pixels",
        )
    if line_reader.sensors != len(sensors):
        what = f"sends {line_reader.form.name}, {line_reader.sensors} sensors, but {file} describes {len(sensors)}"
        raise ScanError(bench.where, what, remedy="set camera.pixel_format, or describe each [[sensor]]")
    bits = sensors[0].bits
    if line_reader.form.bits not in (bits, 16):
        what = f"sends {line_reader.form.name}, {line_reader.form.bits} bits, but {file} states sensor.bits = {bits}"
        raise ScanError(bench.where, what, remedy=f'set camera.pixel_format, e.g. "Mono{bits}"')


DATA_SHEET: Final = (
    ("lens", "focal_length_mm", "Focal length of the lens [mm]"),
    ("lens", "f_number", "F-number that the lens is set to"),
    ("sensor", "pixel_pitch_um", "Pixel pitch on the sensor [um]"),
    ("sensor", "tdi_stages", "TDI stages (1: no TDI)"),
)
"""Fields that exposures do not give, and a data sheet does: block, field, question."""


def _of_data_sheet(bench: Bench) -> list[Edit]:
    """Return a new press file's edits: fields that the camera reports, and those of its data sheet."""
    line_reader, camera = bench.line_reader, bench.camera()
    every = range(line_reader.sensors)
    edits = [
        Edit(block="sensor", field="pixels", value=line_reader.pixels, why="as the camera sends", number=at)
        for at in every
    ]
    bits = line_reader.form.bits
    if bits == 16:
        bits = int(
            _number(bench, "bits", "Bits of the converter (its values are sent as 16 bits)", 12, whole=True)
        )
    edits += [
        Edit(block="sensor", field="bits", value=bits, why=f"as {line_reader.form.name} sends", number=at)
        for at in every
    ]
    for block, name, question in DATA_SHEET:
        source = camera.lens if block == "lens" else camera.sensors[0]
        before = getattr(source, name)
        value = _number(bench, name, question, before, whole=isinstance(before, int))
        why = "stated: data sheet" if value != before else "assumed: no other value was given at set-up"
        numbers = every if block == "sensor" else (0,)
        edits += [Edit(block=block, field=name, value=value, why=why, number=at) for at in numbers]
    present = {"pixel_format": line_reader.form.name}
    lines = line_reader.feature("block_lines")
    edits += [
        Edit(block="camera", field=name, value=value, why="as the camera had it")
        for name, value in present.items()
    ]
    if lines is not None and lines.value:
        edits.append(
            Edit(block="camera", field="block_lines", value=int(lines.value), why="as the camera had it")
        )
    return edits


def _number(bench: Bench, key: str, question: str, usual: float, *, whole: bool) -> float:
    answer = bench.ask(key, question, f"{usual:g}")
    try:
        value = int(answer) if whole else float(answer)
    except ValueError:
        value = -1
    if not 0 < value < 1e6:
        raise RequestError(
            key, f"{shortly(answer)!r} is not a number that fits", remedy=f"give e.g. {usual:g}"
        )
    return value


def _aligned(_bench: Bench) -> StepResult:
    raise AssertionError  # several cameras are set up elsewhere; one is never asked


STEPS: Final = (
    Step(key="camera", title="Camera and press file", do="", measure=_fits, again=True),
    Step(key="dark", title="Dark", do="Cover the lens.", measure=exposure_steps.dark),
    Step(
        key="flat",
        title="Even light",
        do="Uncover the lens; place white paper under its whole line, with the lamp on.",
        measure=exposure_steps.flat,
    ),
    Step(
        key="focus",
        title="Focus",
        do="Let a ruler page pass, or place it under the camera with a comb below the line.",
        measure=page_steps.focus,
    ),
    Step(key="width", title="Width", do="Let a whole ruler page pass.", measure=page_steps.width),
    Step(key="pitch", title="Encoder", do="Let a whole ruler page pass once more.", measure=page_steps.pitch),
    Step(key="paper", title="Light on paper", do="", measure=page_steps.paper),
    Step(
        key="colour",
        title="Colour lines",
        do="",
        measure=page_steps.colour,
        spared=lambda bench: "the camera has one sensor line" if bench.line_reader.sensors == 1 else "",
    ),
    Step(
        key="alignment",
        title="Camera alignment",
        do="",
        measure=_aligned,
        spared=lambda _bench: "one camera is set up",
    ),
)
QUESTIONS: Final = (
    *(step.key for step in STEPS if step.do),
    *(f"{step.key}.keep" for step in STEPS),
    *(name for _, name, _ in DATA_SHEET),
    "bits",
    "flat.level",
    "sheet.across",
    "sheet.along",
)
