"""``prooflight calibrate``: a press from scans of a printed chart."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prooflight.cli import show
from prooflight.cli.options import Json

if TYPE_CHECKING:
    from rich.table import Table

    from prooflight.commissioning.chart.calibrate import Calibration


def register(program: typer.Typer) -> None:
    """Add the command to the program."""
    program.command()(calibrate)


def calibrate(
    chart: Annotated[
        Path, typer.Argument(metavar="CHART", help="Recipe file that `chart make` wrote next to the chart.")
    ],
    scans: Annotated[
        list[Path],
        typer.Argument(metavar="SCAN...", help="Scans of its pages: line camera TIFF, or TIFF, PNG, JPEG."),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="X.press", help="Where to write the artefact.")],
    encoding: Annotated[
        str, typer.Option(help="Encoding of a picture's numbers: auto, linear or srgb.")
    ] = "auto",
    picture: Annotated[
        Path | None, typer.Option(metavar="F.png", help="Draw residuals, noise and edges.")
    ] = None,
    json: Json = False,
) -> None:
    """Compute the press's tables from scans of a printed chart, without a spectrometer or a data sheet."""
    from prooflight.commissioning.chart.calibrate import calibrate as calibrated

    calibration = calibrated(chart, scans, name=out.stem, encoding=encoding, progress=show.steps(quiet=json))
    digest = calibration.press.save(out)
    if picture is not None:
        from prooflight.reporting.calibration_picture import draw_calibration

        draw_calibration(picture, calibration)
    if json:
        show.print_json({"press": str(out), "digest": digest, **_facts(calibration)})
        return
    for scan in calibration.learned.scans:
        chart_there = scan.chart
        show.people.print(
            f"{scan.name}: page {chart_there.page}, turned {chart_there.turn_deg:.2f} degrees, "
            f"{chart_there.marks} marks within {chart_there.residual_px:.2f} pixels"
        )
    show.people.print(_table(calibration))
    show.people.print(show.strong(out), f"written, digest {digest[:16]}")
    if picture is not None:
        show.written(picture)


def _facts(calibration: Calibration) -> dict[str, Any]:
    """Return the JSON object: a summary of each sensor, the chart's position in each scan, and every patch's
    residual.
    """
    return {
        "sensors": _sensors(calibration),
        "scans": [
            {
                "scan": scan.name,
                "page": scan.chart.page,
                "turn_deg": round(scan.chart.turn_deg, 4),
                "pitch_mm": [round(pitch, 6) for pitch in scan.chart.pitch_mm],
                "marks": scan.chart.marks,
                "marks_residual_px": round(scan.chart.residual_px, 4),
                "encoding": scan.encoding,
            }
            for scan in calibration.learned.scans
        ],
        "patches_set_aside": sum(not patch.used for patch in calibration.patches),
        "patches": [asdict(patch) for patch in calibration.patches],
    }


def _sensors(calibration: Calibration) -> list[dict[str, Any]]:
    return [
        {
            "name": sensor.name,
            "white_dn": round(sensor.white_dn, 2),
            "black_dn": round(float(sensor.column_offset_dn.mean()), 2),
            "residual_sigma": round(calibration.residual_sigma[index], 4),
            "left_out_sigma": round(calibration.left_out_sigma[index], 4),
            "white_sigma_dn": round(float(sensor.variance_dn2[0, 0, 0, 0]) ** 0.5, 3),
            "noise_constant_dn2": round(calibration.learned.noise[index].constant_dn2, 4),
            "noise_dn2_per_dn": round(calibration.learned.noise[index].gain_dn, 6),
            "grain": round(calibration.learned.noise[index].grain, 6),
        }
        for index, sensor in enumerate(calibration.press.sensors)
    ]


def _table(calibration: Calibration) -> Table:
    aside = sum(not patch.used for patch in calibration.patches)
    title = f"{len(calibration.patches)} patches read, {aside} excluded; residuals in a pixel's sigma"
    headings = ("sensor", "white [DN]", "black [DN]", "sigma [DN]", "residual", "left out")
    table = show.table_of(title, headings, text_columns=("sensor",))
    for row in _sensors(calibration):
        table.add_row(
            row["name"],
            f"{row['white_dn']:.1f}",
            f"{row['black_dn']:.1f}",
            f"{row['white_sigma_dn']:.2f}",
            f"{row['residual_sigma']:.2f}",
            f"{row['left_out_sigma']:.2f}",
        )
    return table
