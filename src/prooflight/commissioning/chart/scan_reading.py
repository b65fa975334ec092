"""Reading of one scan of a chart: position, patches and edges; the picture itself is released."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import spearmanr

from prooflight.commissioning.chart.edge_spread import mark_samples
from prooflight.commissioning.chart.finding import find_chart
from prooflight.commissioning.chart.patch_reading import read_patches
from prooflight.commissioning.chart.scan import AUTO, read_chart_scan
from prooflight.errors import ScanError
from prooflight.inks.built_in import built_in_inks

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.commissioning.chart.edge_spread import EdgeSample
    from prooflight.commissioning.chart.finding import DetectedChart
    from prooflight.commissioning.chart.patch_reading import PatchReadings
    from prooflight.inks.chart_layout import PlacedRecipes

_AGREES: Final = 0.6
"""assumed: rank correlation of patches with usual inks is above 0.9 for a chart's own recipes, about 0 for others'."""
_FEWEST_PATCHES: Final = 12  # fewer patches than that say nothing of whose they are


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanRead:
    """Measurements of one scan of a chart."""

    name: str
    """Name of the file."""
    sensors: tuple[str, ...]
    lines: int
    pixels: int
    top_code_dn: int
    encoding: str
    chart: DetectedChart
    patches: PatchReadings
    edges: tuple[tuple[tuple[EdgeSample, ...], tuple[EdgeSample, ...]], ...]
    """Edges of the marks in each sensor, across the columns and across the lines."""


def read_scan(path: Path, placed: PlacedRecipes, *, encoding: str = AUTO) -> ScanRead:
    """Read one scan of a page of a chart; ScanError if that cannot be done."""
    image = read_chart_scan(path, encoding=encoding)
    chart = find_chart(image, placed.layout)
    if not 1 <= chart.page <= placed.pages:
        what = f"the scan is of another chart: it is page {chart.page}, the recipe file has {placed.pages}"
        raise ScanError(path, what, remedy="give the recipe file of the chart that was scanned")
    patches = read_patches(image, chart, placed)
    _refuse_other_chart(path, patches, placed)
    edges = []
    for dn, white, columns in zip(image.dn, patches.white_dn, patches.column_gain, strict=True):
        flat = dn / (white * np.where(np.isfinite(columns), columns, 1.0)).astype(np.float32)
        edges.append(mark_samples(flat, chart, placed.layout))
    return ScanRead(
        name=path.name,
        sensors=image.names,
        lines=image.dn.shape[1],
        pixels=image.dn.shape[2],
        top_code_dn=image.top_code_dn,
        encoding=image.encoding,
        chart=chart,
        patches=patches,
        edges=tuple(edges),
    )


def _refuse_other_chart(path: Path, patches: PatchReadings, placed: PlacedRecipes) -> None:
    """Raise ScanError if patches are not as dark as their recipes would be in any usual inks."""
    usual = built_in_inks().reflectance(placed.cmyk[patches.recipe]).mean(axis=1)
    if usual.size < _FEWEST_PATCHES or np.ptp(usual) == 0:
        return
    agreement = float(spearmanr(usual, patches.light.mean(axis=0)).statistic)
    if not agreement >= _AGREES:
        what = (
            f"the scan is of another chart: patches and recipes agree with rank correlation {agreement:.2f}"
        )
        raise ScanError(path, what, remedy="give the recipe file of the chart that was scanned")
