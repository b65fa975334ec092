"""Output of ``prooflight camera``: tables and pictures for people, plain values for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.text import Text

from prooflight.cli.show import table_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.table import Table

    from prooflight.camera.camera import SensorResponse
    from prooflight.camera.sharpness import Sharpness
    from prooflight.commissioning.camera.exploring import Design
    from prooflight.commissioning.camera.sensor_block import SensorBlock


def response_table(answer: SensorResponse) -> Table:
    """Return a table with one line a reflectance."""
    headings = ("patch", "lux", "electrons", "volts", "mean [DN]", "sigma temporal [DN]", "sigma total [DN]")
    table = table_of(f"Sensor {answer.name}", headings)
    columns = (answer.illuminance_lux, answer.electrons, answer.volts)
    noise = (answer.dn_mean, answer.dn_sigma_temporal, answer.dn_sigma_total)
    for patch, row in enumerate(zip(*columns, *noise, strict=True), start=1):
        lux, electrons, volts, mean, temporal, total = (float(value) for value in row)
        table.add_row(
            str(patch),
            f"{lux:.4g}",
            f"{electrons:,.0f}",
            f"{volts:.4f}",
            f"{mean:.2f}",
            f"{temporal:.3f}",
            f"{total:.3f}",
        )
    return table


def sharpness_table(
    title: str, frequency: NDArray[np.float64], sharpness: Sharpness, *, magnification: float
) -> Table:
    """Return a table of MTFs against frequency on the sensor (n,) [cycles/mm] and on the page."""
    headings = ("on sensor [cycles/mm]", "on page [cycles/mm]", "lens", "system across", "system along")
    table = table_of(title, headings)
    for row in zip(frequency, sharpness.lens, sharpness.across, sharpness.along, strict=True):
        table.add_row(f"{row[0]:g}", f"{row[0] * magnification:.3g}", *(f"{value:.4f}" for value in row[1:]))
    return table


def draw_sharpness(
    path: Path, frequency: NDArray[np.float64], sharpness: Sharpness, *, nyquist: float, title: str
) -> None:
    """Draw MTFs against frequency on the sensor (n,) [cycles/mm]."""
    from prooflight.reporting import camera_pictures

    curves = {
        "lens": sharpness.lens,
        "system across the web": sharpness.across,
        "system along the web": sharpness.along,
    }
    camera_pictures.draw_curves(
        path,
        frequency,
        curves,
        x_label="frequency on the sensor [cycles/mm]",
        y_label="modulation transfer",
        title=title,
        mark=(nyquist, "half a cycle a pixel"),
    )


def design_tables(designs: Sequence[Design]) -> list[Table]:
    """Return a table of what all sensors of a design share, then tables of each sensor's signal, noise and
    sharpness.
    """
    fields = [name.removeprefix(name.split(".")[0] + ".") for name in designs[0].vary]
    values = [tuple(str(value) for value in design.vary.values()) for design in designs]
    common = table_of("Designs", (*fields, "field [mm]", "pixel [mm]", "line [mm]", "A4 pages/s"))
    for row, design in zip(values, designs, strict=True):
        pitches = f"{design.pixel_pitch_mm:.4f}", f"{design.line_pitch_mm:.4f}"
        common.add_row(*row, f"{design.field_mm:.1f}", *pitches, f"{design.a4_pages_per_s:.2f}")
    tables = [common]
    for place, first in enumerate(designs[0].sensors):
        signal = table_of(
            f"Sensor {first.name}: signal and temporal signal-to-noise ratio",
            (*fields, "white [DN]", "white", "50 % K", "100 % K"),
        )
        noise = table_of(
            f"Sensor {first.name}: temporal sigma [DN], over the CMYK table; MTF at half a cycle a pixel",
            (*fields, "white", "50 % K", "100 % K", "table min", "table max", "MTF across", "along"),
        )
        for row, design in zip(values, designs, strict=True):
            sensor = design.sensors[place]
            full = " saturates" if sensor.saturates else ""
            ratios = sensor.white_snr, sensor.tint_snr, sensor.solid_snr
            white = Text.assemble(f"{sensor.white_dn:.0f}", (full, "bold red"))
            signal.add_row(*row, white, *(f"{ratio:.1f}" for ratio in ratios))
            sigmas = sensor.white_sigma_dn, sensor.tint_sigma_dn, sensor.solid_sigma_dn
            extremes = sensor.table_sigma_min_dn, sensor.table_sigma_max_dn
            sharp = sensor.mtf_nyquist_across, sensor.mtf_nyquist_along
            noise.add_row(
                *row, *(f"{sigma:.2f}" for sigma in (*sigmas, *extremes)), *(f"{m:.3f}" for m in sharp)
            )
        tables += [signal, noise]
    return tables


def draw_designs(path: Path, designs: Sequence[Design]) -> None:
    """Draw designs with the first varied field along x; every combination of the others has its own curves."""
    from prooflight.reporting import camera_pictures

    field = next(iter(designs[0].vary))
    values = list(dict.fromkeys(design.vary[field] for design in designs))
    panels: dict[str, dict[tuple[str, str], list[float]]] = {}
    for design in designs:
        others = [f"{name} {value}" for name, value in design.vary.items() if name != field]
        for sensor in design.sensors:
            which = ", ".join([sensor.name, *others] if len(design.sensors) > 1 else others)
            for panel, what, number in (
                ("temporal signal-to-noise ratio", "white", sensor.white_snr),
                ("temporal signal-to-noise ratio", "50 % K", sensor.tint_snr),
                ("temporal signal-to-noise ratio", "100 % K", sensor.solid_snr),
                ("table sigma [DN]", "greatest", sensor.table_sigma_max_dn),
                ("table sigma [DN]", "least", sensor.table_sigma_min_dn),
                ("MTF at half a cycle a pixel", "across", sensor.mtf_nyquist_across),
                ("MTF at half a cycle a pixel", "along", sensor.mtf_nyquist_along),
            ):
                panels.setdefault(panel, {}).setdefault((what, which), []).append(number)
    camera_pictures.draw_designs(path, values, panels, field=field)


def block_json(block: SensorBlock) -> dict[str, Any]:
    """Return the block's fields, and the other results of the exposures."""
    transfer = block.transfer
    return {
        **block.fields,
        "standard_errors": block.standard_errors,
        "dn_per_e": block.gain.value,
        "full_well_e": block.full_well_e,
        "saturation_e": block.saturation_e,
        "photon_transfer": {
            "mean_dn": transfer.level_dn,
            "variance_dn2": transfer.variance_dn2,
            "fitted": transfer.used,
            "constant_dn2": transfer.constant_dn2,
        },
        "columns": {"offset_dn": transfer.offset_dn, "gain": transfer.column_gain},
        "sources": block.sources,
        "missing": block.missing,
        "notes": block.notes,
    }


def block_table(block: SensorBlock) -> Table:
    """Return a table with one line a field, with standard error and origin."""
    from prooflight.commissioning.camera.sensor_block import FIELDS

    headings = ("field", "value", "+-", "from")
    table = table_of(f"Sensor {block.fields['name']}", headings, text_columns=("field", "from"))
    for name in FIELDS:
        value = block.fields.get(name)
        shown = "" if value is None else "a curve" if isinstance(value, dict) else str(value)
        error = block.standard_errors.get(name)
        table.add_row(name, shown, f"{error:.2g}" if error else "", block.sources[name])
    if block.full_well_e is not None:
        table.add_row("full well, e-", f"{block.full_well_e:,.0f}", "", "2^bits over the gain")
    if block.saturation_e is not None:
        table.add_row(
            "saturation, e-", f"{block.saturation_e:,.0f}", "", "where the temporal variance is greatest"
        )
    return table


def draw_photon_transfer(path: Path, blocks: Sequence[SensorBlock]) -> None:
    """Draw variance against mean with the fitted line."""
    from prooflight.reporting import camera_pictures

    camera_pictures.draw_photon_transfer(
        path,
        {
            str(block.fields["name"]): (
                block.transfer.level_dn,
                block.transfer.variance_dn2,
                block.transfer.used,
                block.transfer.constant_dn2,
                block.gain.value,
            )
            for block in blocks
        },
    )
