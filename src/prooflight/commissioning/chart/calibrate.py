"""Press artefact from scans of a printed chart, with no spectrometer and no data sheet.

Everything is estimated from the scans: the chart's position gives the geometry, its marks the footprint, the
paper the columns' gains, its patches mean and noise of every colour. Values that scans do not give are
assumed and stated: costs and false-alarm rate are the defaults of a press file.

The press is as good as its prints: ink that was 1 % stronger on the day the chart was printed is 1 % stronger
in the tables. Several prints of the chart average that.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS
from prooflight.commissioning.chart.dn_model import FEWEST_RECIPES
from prooflight.commissioning.chart.joint_fit import JointFit, fit_jointly
from prooflight.commissioning.chart.patch_reading import ScanRead, read_scan
from prooflight.commissioning.chart.press import Learned, SignalNoise, assemble_press, fit_noise
from prooflight.commissioning.chart.scan import AUTO
from prooflight.errors import ScanError
from prooflight.inks.chart_layout import PlacedRecipes, read_recipe_file

if TYPE_CHECKING:
    from prooflight.press.artefact import Press

FULLEST: Final = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class PatchResidual:
    """Measured and fitted signal of one patch of one scan."""

    scan: str
    page: int
    row: int
    column: int
    cmyk_percent: tuple[float, ...]
    measured_dn: tuple[float, ...]
    """Signal in each sensor, at column gain 1, without effects of the single print and scan. [DN]"""
    fitted_dn: tuple[float, ...]
    residual_sigma: tuple[float, ...]
    """Measured minus fitted, over a single pixel's temporal noise. [-]"""
    used: bool
    """Whether the patch is used; otherwise it is rejected as an outlier."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """Press and the readings that it was made from."""

    press: Press
    learned: Learned
    patches: tuple[PatchResidual, ...]
    left_out_sigma: tuple[float, ...]
    """Leave-one-out error of each sensor: rms over recipes, in a single pixel's sigma. [-]"""

    @property
    def residual_sigma(self) -> tuple[float, ...]:
        """Return the residual of each sensor: rms over patches used. [-]"""
        left = np.array([patch.residual_sigma for patch in self.patches if patch.used])
        return tuple(np.sqrt((left**2).mean(axis=0)).tolist())


def calibrate(
    chart: Path,
    scans: Sequence[Path],
    *,
    name: str,
    encoding: str = AUTO,
    progress: Callable[[str], None] = lambda _step: None,
) -> Calibration:
    """Calibrate a press from a chart's recipe file and scans of its prints, any pages, any number of each.

    ChartError: no such recipe file. ScanError: a scan that cannot be used; scans that do not belong together;
    another chart; too few patches.
    """
    placed = read_recipe_file(chart)
    read: list[ScanRead] = []
    for path in scans:
        progress(f"reading {path.name}")
        read.append(read_scan(path, placed, encoding=encoding))
    return calibrate_from(read, placed, name=name, origin=_origin(chart, scans, read), progress=progress)


def calibrate_from(
    scans: Sequence[ScanRead],
    placed: PlacedRecipes,
    *,
    name: str,
    origin: Mapping[str, str],
    progress: Callable[[str], None] = lambda _step: None,
) -> Calibration:
    """Calibrate from scans that have been read.

    ScanError: they do not belong together, or show too few patches.
    """
    _refuse_mixed(scans)
    _refuse_few(scans, placed)
    progress("fitting inks")
    fit = fit_jointly([scan.patches for scan in scans], placed)
    progress("measuring edges and noise, filling tables")
    halftone = _halftone_dn2(fit, placed, scans)
    noise = tuple(_noise_of(index, scans, halftone[:, index]) for index in range(len(scans[0].sensors)))
    learned = Learned(scans=tuple(scans), fit=fit, noise=noise)
    return Calibration(
        press=assemble_press(name, placed.layout, learned, origin=origin),
        learned=learned,
        patches=_residuals(learned, placed),
        left_out_sigma=_left_out_sigma(learned),
    )


def _refuse_mixed(scans: Sequence[ScanRead]) -> None:
    """Raise ScanError if a scan is of other sensors, width or encoding than the first."""
    first = scans[0]
    for scan in scans[1:]:
        for what, here, there in (
            ("sensors", ", ".join(scan.sensors), ", ".join(first.sensors)),
            ("pixels a line", scan.pixels, first.pixels),
            ("encoding", scan.encoding, first.encoding),
        ):
            if here != there:
                fault = f"has {what} {here}, {first.name} has {there}"
                raise ScanError(scan.name, fault, remedy="give scans of one scanner in one setting")


def _refuse_few(scans: Sequence[ScanRead], placed: PlacedRecipes) -> None:
    """Raise ScanError if all scans combined show too few recipes, or never an ink."""
    seen = np.unique(np.concatenate([scan.patches.recipe for scan in scans]))
    missing = sorted(set(range(1, placed.pages + 1)) - {scan.patches.page for scan in scans})
    more = f"scan page {missing[0]} as well" if missing else "make and print a larger chart"
    if len(seen) < FEWEST_RECIPES:
        what = f"only {len(seen)} patches in all scans"
        raise ScanError(scans[0].name, what, remedy=f"{FEWEST_RECIPES} are needed: {more}")
    for ink, levels in zip(INK_LETTERS, placed.cmyk[seen].T, strict=True):
        if levels.max() < FULLEST:
            what = f"no patch has more than {levels.max():.0%} of ink {ink}"
            raise ScanError(scans[0].name, what, remedy=more)


def _halftone_dn2(fit: JointFit, placed: PlacedRecipes, scans: Sequence[ScanRead]) -> NDArray[np.float64]:
    """Return the halftone's signal variance of every reading, (2, sensors, readings). [DN^2]

    First is sum_i (d signal / d ink_i)^2 a_i (1 - a_i), second the same without a (1 - a) over inks that are
    there.
    """
    cmyk = placed.cmyk[fit.recipe]
    recipes, which = np.unique(cmyk, axis=0, return_inverse=True)
    white = np.mean([scan.patches.white_dn for scan in scans], axis=0)
    slopes = 2 * fit.model.root(recipes)[:, :, None] * fit.model.root_slopes(recipes)
    shares = recipes * (1 - recipes), (recipes > 0).astype(np.float64)
    spread = [(slopes**2 * share[:, None, :]).sum(axis=2)[which].T for share in shares]
    return np.asarray(np.stack(spread) * white[:, None] ** 2)


def _noise_of(sensor: int, scans: Sequence[ScanRead], halftone: NDArray[np.float64]) -> SignalNoise:
    """Fit the noise of one sensor to all patches and the bare paper of each scan."""
    readings = [scan.patches for scan in scans]
    dn = np.concatenate([reading.dn[sensor] for reading in readings])
    variance = np.concatenate([reading.pixel_variance_dn2[sensor] for reading in readings])
    pixels = np.concatenate([reading.pixels for reading in readings])
    paper_dn = [reading.white_dn[sensor] * np.nanmean(reading.column_gain[sensor]) for reading in readings]
    paper = [reading.paper_variance_dn2[sensor] for reading in readings]
    return fit_noise(
        np.concatenate([dn, paper_dn]),
        np.concatenate([variance, paper]),
        np.concatenate([halftone[0], np.zeros(len(paper))]),
        np.concatenate([halftone[1], np.zeros(len(paper))]),
        np.concatenate([pixels, np.full(len(paper), pixels.max())]),
    )


def _origin(chart: Path, scans: Sequence[Path], read: Sequence[ScanRead]) -> dict[str, str]:
    """Return the origin of the press."""
    return {
        "inks": "read from a printed chart",
        "chart": chart.name,
        "chart_digest": hashlib.sha256(chart.read_bytes()).hexdigest(),
        "scans": ", ".join(path.name for path in scans),
        "encoding": read[0].encoding,
        "scans_sha256": hashlib.sha256(
            b"".join(hashlib.sha256(path.read_bytes()).digest() for path in scans)
        ).hexdigest(),
    }


def _residuals(learned: Learned, placed: PlacedRecipes) -> tuple[PatchResidual, ...]:
    """Return all readings as rows for people."""
    fit = learned.fit
    white, black = learned.white_dn, learned.black_dn
    measured, fitted = (light * white - black for light in (fit.light, fit.fitted))
    return tuple(
        PatchResidual(
            scan=learned.scans[scan].name,
            page=page,
            row=row,
            column=column,
            cmyk_percent=tuple(recipe),
            measured_dn=tuple(own),
            fitted_dn=tuple(predicted),
            residual_sigma=tuple(away),
            used=used,
        )
        for scan, (page, row, column), recipe, own, predicted, away, used in zip(
            fit.scan.tolist(),
            placed.place[fit.recipe].tolist(),
            np.round(100 * placed.cmyk[fit.recipe], 2).tolist(),
            np.round(measured, 3).tolist(),
            np.round(fitted, 3).tolist(),
            np.round((measured - fitted) / learned.sigma_dn(fit.fitted), 4).tolist(),
            fit.used.tolist(),
            strict=True,
        )
    )


def _left_out_sigma(learned: Learned) -> tuple[float, ...]:
    """Compute ``Calibration.left_out_sigma``."""
    model = learned.fit.model
    light = model.light(model.cmyk)
    error = 2 * np.sqrt(light) * model.left_out * learned.white_dn
    return tuple(np.sqrt(((error / learned.sigma_dn(light)) ** 2).mean(axis=0)).tolist())
