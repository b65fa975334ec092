"""Steps with dark and uniform light: exposures from which photon transfer gives the sensor's block of a press file."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.camera.exposures import Exposure, statistics
from prooflight.commissioning.camera.fixed_pattern import Measured
from prooflight.commissioning.camera.sensor_block import Given, characterise_sensor
from prooflight.commissioning.file_edit import Edit
from prooflight.errors import ScanError
from prooflight_line.camera_set_up.bench import StepResult
from prooflight_line.camera_set_up.seen import smoothed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.camera.sensor import LineSensor
    from prooflight.commissioning.camera.sensor_block import SensorBlock
    from prooflight_line.camera_set_up.bench import Bench

LINES: Final = 256
"""Number of lines of an exposure: temporal noise of 2,000 columns is then known to 0.2 %."""
LEVELS: Final = 10
"""Number of levels of light, for photon transfer (EMVA 1288 asks for 8 or more)."""
BRIGHTEST: Final = 0.9
"""Brightest level as a share of the top code; photon transfer fits up to 0.7."""
AT_WORK: Final = 0.8
"""Level of the brightest column in operation, as a share of the top code.

assumed: leaves room for brighter paper and lamp.
"""
DARK_MOST: Final = 0.2
"""Greatest level of a dark exposure, as a share of the top code."""
EVEN_LEAST: Final = 0.7
"""Least light over the greatest along the line. assumed: prediction follows columns, noise does not."""

QUANTITIES: Final = {
    "conversion_gain_uv_per_e": ("conversion gain", "uV/e-"),
    "read_noise_e": ("read noise", "e-"),
    "dark_current_e_per_s": ("dark current", "e-/s"),
    "dsnu_e": ("DSNU", "e-"),
    "prnu_percent": ("PRNU", "%"),
    "black_level_dn": ("black level", "DN"),
}
"""Fields of a sensor's block that flat exposures measure, with their names for people and their units."""


def dark(bench: Bench) -> StepResult:
    """Measure black level and noise with the lens covered, at two exposure times where they can be set."""
    line_reader, top = bench.line_reader, bench.top_code_dn
    times = _dark_times(bench)
    bench.dark = {}
    for at in times:
        if at:
            line_reader.set("exposure_us", at)
        lines = line_reader.lines(LINES)
        _refuse_light(bench, lines, top)
        bench.dark[at] = _exposures(bench, lines, f"dark at {at:g} us" if at else "dark")
    if times[0]:
        line_reader.set("exposure_us", times[0])
    usual = bench.dark[times[0]]
    remarks, good = [], True
    for at, one in enumerate(usual):
        name = bench.sensor_name(at)
        line = f"{name}black {one.mean_dn:.2f} DN, noise {np.sqrt(one.variance_dn2):.2f} DN from line to line"
        if one.lowest_share > 0.001:
            good = False
            line += (
                f"; {100 * one.lowest_share:.0f} % at code 0: raise the camera's black level by some codes"
            )
        remarks.append(line)
    values = {f"black_dn.{at + 1}": _mean(one) for at, one in enumerate(usual)}
    unmeasured = (
        ()
        if len(times) > 1
        else ("dark current, separate from the black level: there is only one exposure time",)
    )
    return StepResult(good=good, remarks=tuple(remarks), values=values, unmeasured=unmeasured)


def _dark_times(bench: Bench) -> list[float]:
    """Return the present exposure time, and another far from it; [0]: the camera has none that can be set."""
    one = bench.line_reader.feature("exposure_us")
    if one is None or not one.writable or not one.value:
        return [0.0]
    now, least, greatest = float(one.value), one.least or 1.0, one.greatest or np.inf
    other = (
        max(now / 8, least) if now > np.sqrt(max(least, 1.0) * min(greatest, 1e6)) else min(8 * now, greatest)
    )
    return [now, other] if abs(np.log(other / now)) > 0.5 else [now]


def _refuse_light(bench: Bench, lines: NDArray[np.uint16], top: int) -> None:
    level = float(lines.mean())
    spread = max(float(np.ptp(smoothed(image.mean(axis=0)))) for image in lines)
    if level > DARK_MOST * top or spread > DARK_MOST / 4 * top:
        what = f"is not dark: {level:.0f} DN of {top}, {spread:.0f} DN of difference along the line"
        raise ScanError(bench.where, what, remedy="cover the lens")


def flat(bench: Bench) -> StepResult:
    """Measure gain, noise, fixed pattern and flatness in uniform light at many levels.

    The exposure is then set for operation.
    """
    if not bench.dark:
        raise ScanError(bench.where, "has no dark exposure yet", remedy="repeat the step dark first")
    line_reader = bench.line_reader
    timed = 0.0 not in bench.dark
    flats, at_work = _timed_flats(bench) if timed else (_lit_flats(bench), 0.0)
    if timed:
        line_reader.set("exposure_us", at_work)
    remarks, values, edits = list[str](), dict[str, Measured](), list[Edit]()
    columns = []
    for at, sensor in enumerate(bench.camera().sensors):
        block = _characterised(bench, sensor, at, [one[at] for one in flats], at_work)
        columns.append((block.transfer.offset_dn, block.transfer.column_gain))
        remarks += _remarks(bench.sensor_name(at), block)
        for key in QUANTITIES:
            value, error = block.fields[key], block.standard_errors.get(key, 0.0)
            values[f"{key}.{at + 1}"] = Measured(value=value, standard_error=error)
            if error:
                why = f"measured: +- {error:.2g}"
                edits.append(Edit(block="sensor", field=key, value=value, why=why, number=at))
    bench.columns = columns
    flatness = _flatness(bench, flats[-1])
    good = flatness >= EVEN_LEAST
    remarks.append(
        f"light along the line: least {100 * flatness:.0f} % of the greatest"
        + ("" if good else "; move the lamp: below 70 % dark ends are noisy")
    )
    values["flatness"] = Measured(value=flatness, standard_error=0.0)
    if timed:
        why = "measured: light at 80 % of full"
        edits.append(Edit(block="camera", field="exposure_us", value=round(at_work, 2), why=why))
        remarks.append(
            f"exposure for operation {at_work:.4g} us: the brightest column at {100 * AT_WORK:.0f} %"
        )
    return StepResult(
        good=good,
        remarks=tuple(remarks),
        edits=tuple(edits),
        values=values,
        unmeasured=("quantum efficiency, fill factor, voltage swing: from a data sheet",),
    )


def _remarks(name: str, block: SensorBlock) -> list[str]:
    """Return what is said to a person of one sensor, whose name begins each line."""
    parts = [
        f"{label} {block.fields[key]:.4g} +- {block.standard_errors.get(key, 0.0):.2g} {unit}"
        for key, (label, unit) in QUANTITIES.items()
    ]
    notes = [note for note in block.notes if not note.startswith("saturation was not reached")]
    return [name + ", ".join(parts), *(name + note for note in notes)]


def _flatness(bench: Bench, brightest: Sequence[Exposure]) -> float:
    """Return the least light along the line over the greatest, of the sensor that is lit least evenly."""
    dark = next(iter(bench.dark.values()))
    light = [
        smoothed(brightest[at].column_mean_dn - dark[at].mean_dn) for at in range(bench.line_reader.sensors)
    ]
    return min(float(one.min() / max(one.max(), 1e-9)) for one in light)


def _characterised(
    bench: Bench, sensor: LineSensor, at: int, flats: list[Exposure], at_work: float
) -> SensorBlock:
    """Return the sensor's block; where exposure times are known, dark current over them."""
    times = list(bench.dark)
    here, *others = (replace(bench.dark[time][at], line_rate_hz=None) for time in times)
    like = sensor
    if at_work:
        like = replace(sensor, line_rate_hz=sensor.tdi_stages / (times[0] * 1e-6))
        others = [
            replace(one, line_rate_hz=sensor.tdi_stages / (time * 1e-6))
            for one, time in zip(others, times[1:], strict=True)
        ]
    given = Given(like=like, like_name=bench.press.path.name)
    block = characterise_sensor([here, *others], flats, given=given, number=at + 1)
    if at_work:
        # A press exposes for stages / line rate; what its dark current gathers in that time is the camera's in its own.
        times_longer = at_work * 1e-6 / sensor.exposure_s
        for one in (block.fields, block.standard_errors):
            if "dark_current_e_per_s" in one:
                one["dark_current_e_per_s"] = float(f"{one['dark_current_e_per_s'] * times_longer:.6g}")
    return block


def _timed_flats(bench: Bench) -> tuple[list[tuple[Exposure, ...]], float]:
    """Take exposures at ``LEVELS`` times up to nearly full; return them and the time for operation. [us]"""
    line_reader, top = bench.line_reader, bench.top_code_dn
    black = min(one.mean_dn for one in next(iter(bench.dark.values())))
    time_us = next(iter(bench.dark))
    for _ in range(12):
        requested_us = time_us
        time_us = line_reader.set("exposure_us", requested_us)
        lines = line_reader.lines(32)
        bright = max(float(np.percentile(image.mean(axis=0), 99.5)) for image in lines)
        if bright > 0.985 * top:
            wanted = time_us / 4
        else:
            wanted = time_us * float(np.clip((BRIGHTEST * top - black) / max(bright - black, 1e-3), 0.25, 16))
        if abs(wanted / time_us - 1) < 0.05 or time_us < 0.7 * requested_us or time_us > 1.4 * requested_us:
            break
        time_us = wanted
    if bright - black < max(0.01 * top, 5.0):
        what = f"sees no light: {bright - black:.1f} DN above black at {time_us:.4g} us"
        raise ScanError(bench.where, what, remedy="uncover the lens, and switch on the lamp")
    if bright > 0.985 * top:
        what = f"is saturated by this light even at {time_us:.4g} us"
        raise ScanError(bench.where, what, remedy="dim the light, or close the lens")
    if bright < 0.5 * top:
        what = f"gets too little light: {bright:.0f} DN of {top} at {time_us:.4g} us, its longest exposure"
        raise ScanError(bench.where, what, remedy="open the lens, or bring the lamp closer")
    flats = []
    for share in np.linspace(1 / LEVELS, 1, LEVELS):
        set_us = line_reader.set("exposure_us", share * time_us)
        flats.append(_exposures(bench, line_reader.lines(LINES), f"flat at {set_us:.4g} us"))
    return flats, time_us * (AT_WORK * top - black) / (bright - black)


def _lit_flats(bench: Bench) -> list[tuple[Exposure, ...]]:
    """Take exposures at as many levels of light as a person makes: the camera has no exposure time to set."""
    flats, top = [], bench.top_code_dn
    for level in range(1, LEVELS + 1):
        lines = bench.line_reader.lines(LINES)
        share = float((lines >= top).mean())
        if share > 0.001:
            what = f"is saturated: {100 * share:.3g} % of its pixels are at {top} DN"
            raise ScanError(
                bench.where, what, remedy="dim the light, and start again with the brightest level"
            )
        flats.append(_exposures(bench, lines, f"flat {level}"))
        if level == LEVELS:
            break
        question = f"Level {level}: {flats[-1][0].mean_dn:.0f} DN. Change the light to another level"
        if bench.ask("flat.level", f"{question}; d: this was the last level", "") == "d":
            break
    black = next(iter(bench.dark.values()))[0]
    if max(one[0].mean_dn for one in flats) - black.mean_dn < 5.0:
        raise ScanError(bench.where, "sees no light", remedy="uncover the lens, and switch on the lamp")
    return sorted(flats, key=lambda one: one[0].mean_dn)


def _exposures(bench: Bench, lines: NDArray[np.uint16], name: str) -> tuple[Exposure, ...]:
    return tuple(statistics(image, name=f"{bench.where}, {name}") for image in lines)


def _mean(one: Exposure) -> Measured:
    error = float(np.sqrt(one.variance_dn2 / one.lines / one.column_mean_dn.size))
    return Measured(value=one.mean_dn, standard_error=error)
