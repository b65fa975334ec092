"""Steps with a ruler page: focus, width, encoder, light on paper, colour lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.camera.fixed_pattern import Measured
from prooflight.commissioning.file_edit import Edit
from prooflight.errors import RequestError, ScanError
from prooflight.files.given import shortly
from prooflight_line.camera_set_up.bench import StepResult
from prooflight_line.camera_set_up.seen import focus_of
from prooflight_line.ruler.finding import find_ruler, relative_light
from prooflight_line.ruler.reading import read_ruler

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import LineSensor
    from prooflight_line.camera_set_up.bench import Bench
    from prooflight_line.ruler.reading import SensorReading

SHARP_LEAST: Final = 0.75
"""Least MTF50 over that of the press file's lens. assumed: lenses fall short of diffraction by a fifth."""
TILT_MOST: Final = 0.2
"""Greatest difference of MTF50 between places along the line, as a share of its mean."""
UNCHECKED: Final = 0.003
"""Relative error of the length of a page that was not measured.

assumed: usual of presses and of fed paper.
"""
RULE_MM: Final = 0.25
"""Standard error of a length read off a steel rule. assumed: half its finest division."""
PITCH_OFF: Final = 0.05
"""Relative difference of the line pitch from the press file's that is tolerated."""
SMEAR_MOST: Final = 0.5
"""Greatest TDI smear. [pixel]"""
PAGES_LINES: Final = 24_000
"""Number of lines in which a ruler page must have passed: two pages of 420 mm at 0.042 mm a line, and the gap."""
FOCUS_LINES: Final = 4096
"""Number of lines in which sharpness is measured: a group of a ruler page, 92 mm, at 0.022 mm a line."""
TRIED_LINES: Final = 512
"""Number of lines after which the measurement is repeated."""
TRIED_MORE: Final = 1.25
"""Growth of the number of lines from one try to the next: an analysis of many lines takes longer."""
WRONG_ORIENTATION: Final = ("upside down", "sideways", "mirrored")
"""Parts of messages on a page that lies wrong: waiting does not correct it."""


def focus(bench: Bench) -> StepResult:
    """Measure MTF50 from a ruler page that passes or lies still."""
    result, tried = None, 0
    for last in bench.line_reader.endless(FOCUS_LINES):
        if last.came - tried < TRIED_LINES:
            continue
        tried = last.came
        result = focus_of(last.lines(), where=bench.where)[0]
        passes = result is not None and result.along is not None
        # A page that passes tells more than edges that lie still: it is waited for.
        if passes or (result is not None and tried >= FOCUS_LINES // 2) or tried >= PAGES_LINES // 2:
            break
    if result is None:
        what = "sees no edges from which sharpness can be measured"
        raise ScanError(bench.where, what, remedy="place a page of `prooflight chart make --ruler` under it")
    camera = bench.camera()
    wanted = lens_mtf50(camera, camera.sensors[0])
    good = result.across.value >= SHARP_LEAST * wanted
    remarks = [
        f"MTF50 across {result.across.value:.3f} +- {result.across.standard_error:.3f} cycles/pixel by {result.by};"
        f" the press file's lens would give {wanted:.3f}"
    ]
    values = {"mtf50_across_per_pixel": result.across}
    if result.along is not None:
        remarks.append(
            f"MTF50 along {result.along.value:.3f} +- {result.along.standard_error:.3f} cycles/line"
        )
        values["mtf50_along_per_line"] = result.along
    if len(result.places) > 1:
        at, sharp = zip(*result.places, strict=True)
        spread = (max(sharp) - min(sharp)) / np.mean(sharp)
        remarks.append(
            f"along the line {min(sharp):.3f} to {max(sharp):.3f}, lowest at {100 * at[int(np.argmin(sharp))]:.0f} %"
        )
        if spread > TILT_MOST:
            good = False
            remarks.append(
                "sharpness differs along the line: the camera is tilted, or the lens does not suit it"
            )
    if result.across.value < SHARP_LEAST * wanted:
        remarks.append("turn the lens while `prooflight camera view` shows its MTF50, then repeat this step")
    return StepResult(good=good, remarks=tuple(remarks), values=values)


def lens_mtf50(camera: Camera, sensor: LineSensor) -> float:
    """Return MTF50 across of the press file's lens and pixel. [cycles/pixel]"""
    per_pixel = np.linspace(0, 1, 401)
    mtf = camera.white_mtf(sensor, per_pixel / (sensor.pixel_pitch_um * 1e-3)) * np.sinc(per_pixel)
    return float(per_pixel[int(np.argmax(mtf < 0.5))])


def _read_page(bench: Bench) -> tuple[SensorReading, ...]:
    """Read the next ruler page that passes whole."""
    top, where = bench.top_code_dn, bench.where
    tried = 0
    for last in bench.line_reader.endless(PAGES_LINES):
        if last.came < min(max(tried + TRIED_LINES, TRIED_MORE * tried), PAGES_LINES):
            continue
        tried, lines = last.came, last.lines()
        try:
            ruler = find_ruler(relative_light(lines), where=where)
        except ScanError as error:
            if tried >= PAGES_LINES or any(part in error.what for part in WRONG_ORIENTATION):
                raise
            continue
        if ruler.whole(lines.shape[1]) or tried >= PAGES_LINES:
            return read_ruler(lines, top_code_dn=top, where=where)
    raise AssertionError  # lines come without end


def width(bench: Bench) -> StepResult:
    """Measure millimetres a pixel, which a press file states as object distance, and the register of planes."""
    reading = bench.readings = _read_page(bench)
    scale = reading[0].scale
    bench.passes.append(scale.line_mm.value)
    pixel, how = _on_paper(bench, "sheet.across", "across", scale.pixel_mm)
    camera = bench.camera()
    magnification = camera.sensors[0].pixel_pitch_um * 1e-3 / pixel.value
    distance = camera.lens.focal_length_mm * (1 + 1 / magnification)
    field_mm = pixel.value * bench.line_reader.pixels
    remarks = [
        f"{pixel.value:.6f} +- {pixel.standard_error:.6f} mm a pixel, {field_mm:.1f} mm in all"
        f" ({scale.bars[0]} marks, each within {scale.residual_px[0]:.3f} pixel); {how}",
        f"the page is rotated by {scale.skew_deg.value:+.3f} +- {scale.skew_deg.standard_error:.3f} degrees,"
        f" columns and lines are {abs(scale.shear_deg):.3f} degrees off a right angle",
    ]
    good = abs(scale.shear_deg) < 0.5
    if not good:
        remarks.append("turn the camera until its line is at right angles to the travel")
    if scale.bent_across_mm > 0:
        remarks.append(f"the lens bends the ruler by {1000 * scale.bent_across_mm:.0f} um at most")
        good = good and scale.bent_across_mm < pixel.value
    remarks += _plane_lines(bench, reading)
    edit = Edit(
        block="lens",
        field="object_distance_mm",
        value=round(float(distance), 3),
        why=f"measured: a pixel covers {pixel.value:.6f} +- {pixel.standard_error:.6f} mm",
    )
    return StepResult(good=good, remarks=tuple(remarks), edits=(edit,), values={"pixel_mm": pixel})


def _plane_lines(bench: Bench, reading: tuple[SensorReading, ...]) -> list[str]:
    """Describe the register of planes, by the sensor that sees each best, for a person who adjusts the press."""
    lines = []
    for letter in "CMY":
        seen = [plane for one in reading for plane in one.planes if plane.ink == letter]
        if not seen:
            lines.append(f"plane {letter} is not visible enough to be located")
            continue
        plane = min(seen, key=lambda one: one.across_mm.standard_error)
        lines.append(
            f"plane {letter} is offset by {1000 * plane.across_mm.value:+.0f}"
            f" +- {1000 * plane.across_mm.standard_error:.0f} um across and {1000 * plane.along_mm.value:+.0f}"
            f" +- {1000 * plane.along_mm.standard_error:.0f} um along from black"
        )
    return lines


def _on_paper(bench: Bench, key: str, way: str, by_page: Measured) -> tuple[Measured, str]:
    """Return a pitch in true millimetres: by a person's measurement of the page, or by its nominal size."""
    question = f"Measure the page between its fine lines, {way}: write MEASURED/PRINTED, e.g. 190.4/190"
    answer = bench.ask(key, question, "")
    if not answer:
        error = by_page.value * UNCHECKED
        whole = Measured(value=by_page.value, standard_error=float(np.hypot(by_page.standard_error, error)))
        return whole, f"the page was not measured, and its size may be wrong by {100 * UNCHECKED:g} %"
    try:
        measured, printed = (float(part) for part in answer.split("/"))
    except ValueError:
        measured = printed = -1.0
    if not (printed > 0 and 0.95 < measured / printed < 1.05):
        what = f"{shortly(answer)!r} is not a measured and a printed length"
        raise RequestError(key, what, remedy="give e.g. 190.4/190, or nothing")
    pitch = by_page.times(measured / printed)
    error = pitch.value * RULE_MM / measured
    whole = Measured(value=pitch.value, standard_error=float(np.hypot(pitch.standard_error, error)))
    return whole, f"the page is {100 * (measured / printed - 1):+.2f} % of its size"


def pitch(bench: Bench) -> StepResult:
    """Measure millimetres a line and lines a second, which in a press file are the paper's speed and the line rate."""
    reading = bench.readings = _read_page(bench)
    scale, camera = reading[0].scale, bench.camera()
    bench.passes.append(scale.line_mm.value)
    line, how = _on_paper(bench, "sheet.along", "along", scale.line_mm)
    rate_hz, whose = _line_rate(bench)
    stated = camera.line_pitch_mm
    if not bench.begun and abs(line.value / stated - 1) > 4 * PITCH_OFF:
        times = f"{line.value / stated:.2f} times the pitch in {bench.press.path.name}"
        what = f"has a line pitch of {line.value:.4f} mm, {times}"
        speed = line.value * rate_hz
        remedy = f"set the encoder's divider, or transport.speed_mm_s = {speed:.1f} if this pitch is intended"
        raise ScanError(bench.where, what, remedy=remedy)
    remarks = [
        f"{line.value:.6f} +- {line.standard_error:.6f} mm a line"
        f" ({scale.bars[1]} marks, each within {scale.residual_px[1]:.3f} line); {how}"
    ]
    good = True
    if len(bench.passes) > 1:
        spread = np.ptp(bench.passes) / np.mean(bench.passes)
        remarks.append(
            f"{len(bench.passes)} pages passed, and their line pitches agree within {100 * spread:.3f} %"
        )
        good = bool(spread < PITCH_OFF / 10)
    if scale.bent_along_mm > 0:
        remarks.append(
            f"along the page, lines are off their places by {1000 * scale.bent_along_mm:.0f} um at most"
        )
    pixel = scale.pixel_mm.value
    remarks.append(f"a line is {line.value / pixel:.4f} times as long as a pixel is wide")
    stages = camera.sensors[0].tdi_stages
    smear = stages * abs(line.value / camera.binning_along / pixel - 1)
    if stages > 1 and smear > SMEAR_MOST:
        good = False
        remarks.append(
            f"TDI smears lines over {smear:.1f} pixels: bring the encoder's step to {pixel:.5f} mm"
        )
    speed = line.value * rate_hz
    remarks.append(f"{rate_hz:.2f} lines/s {whose}: the paper runs at {speed:.1f} mm/s")
    edits = [
        Edit(
            block="sensor",
            field="line_rate_hz",
            value=float(f"{rate_hz * camera.binning_along:.6g}"),
            why=f"measured: {whose}",
            number=at,
        )
        for at in range(len(camera.sensors))
    ]
    edits.append(
        Edit(
            block="transport",
            field="speed_mm_s",
            value=float(f"{speed:.6g}"),
            why=f"measured: {line.value:.6f} +- {line.standard_error:.6f} mm a line",
        )
    )
    values = {"line_mm": line, "line_rate_hz": Measured(value=rate_hz, standard_error=0.0)}
    return StepResult(good=good, remarks=tuple(remarks), edits=tuple(edits), values=values)


def _line_rate(bench: Bench) -> tuple[float, str]:
    """Return the lines a second, and their source: the camera's own clock is better than the lines' arrival."""
    counted = bench.line_reader.rate_hz()
    free = bench.press.camera_settings().trigger != "encoder"
    reported = bench.line_reader.feature("line_rate_hz")
    if (
        free
        and reported is not None
        and reported.value
        and abs(float(reported.value) / max(counted, 1e-9) - 1) < 0.2
    ):
        return float(reported.value), f"as the camera reports, {counted:.0f} counted"
    reported_hz = (
        f", the camera reports {float(reported.value):.0f}"
        if free and reported is not None and reported.value
        else ""
    )
    return counted, f"counted as they arrived{reported_hz}"


def paper(bench: Bench) -> StepResult:
    """Set the press file's light so that bare paper of the ruler page has its measured signal."""
    if not bench.readings:
        bench.readings = _read_page(bench)
    camera, top = bench.camera(), bench.top_code_dn
    white = camera.irradiance_photons(bench.press.inks().reflectance(np.zeros((1, 4)))[0])
    shade = float(camera.column_light().mean())
    factors = []
    for sensor, reading in zip(camera.sensors, bench.readings, strict=True):
        dark_dn = sensor.black_level_dn + sensor.dark_e * sensor.dn_per_e
        predicted = float(sensor.electrons(white)) * shade * sensor.dn_per_e
        factors.append((reading.paper_dn - dark_dn) / predicted)
    luminance = camera.light.luminance_cd_m2 * float(np.mean(factors))
    shares = [one.paper_dn / top for one in bench.readings]
    good = min(shares) > 0.4 and max(shares) < 0.95
    remarks = [
        "bare paper " + ", ".join(f"{one.paper_dn:.0f} DN" for one in bench.readings) + f" of {top},"
        " solid black " + ", ".join(f"{one.solid_dn:.0f} DN" for one in bench.readings)
    ]
    if not good:
        remarks.append(
            "bring paper to 40 to 95 % of the top code by exposure, lens or lamp, and repeat from flat on"
        )
    if len(factors) > 1 and np.ptp(factors) > 0.1 * np.mean(factors):
        remarks.append(
            "the sensors' signals of paper are not in the ratio of the press file's light and quantum efficiencies"
        )
    edit = Edit(
        block="light",
        field="luminance_cd_m2",
        value=float(f"{luminance:.5g}"),
        why=f"measured: so that paper reads {bench.readings[0].paper_dn:.0f} DN",
    )
    return StepResult(
        good=good,
        remarks=tuple(remarks),
        edits=(edit,),
        values={"luminance_cd_m2": Measured(value=luminance, standard_error=0.0)},
        unmeasured=("the light's spectrum: it is that of the press file",),
    )


def colour(bench: Bench) -> StepResult:
    """Measure the offsets between the sensors of one camera."""
    if not bench.readings:
        bench.readings = _read_page(bench)
    places = [one.place for one in bench.readings]
    remarks = [
        f"{bench.sensor_name(at)}{one.lines.value:+.3f} +- {one.lines.standard_error:.3f} lines,"
        f" {one.pixels.value:+.3f} +- {one.pixels.standard_error:.3f} pixels from the first"
        for at, one in enumerate(places)
        if at
    ]
    good = all(abs(one.turn_deg) < 0.1 and abs(one.size - 1) < 1e-3 for one in places)
    edits = [
        Edit(
            block="camera",
            field=name,
            value=[round(getattr(one, way).value, 3) for one in places],
            why="measured",
        )
        for name, way in (("offset_lines", "lines"), ("offset_pixels", "pixels"))
    ]
    values = {f"lines.{at + 1}": one.lines for at, one in enumerate(places) if at}
    return StepResult(good=good, remarks=tuple(remarks), edits=tuple(edits), values=values)
