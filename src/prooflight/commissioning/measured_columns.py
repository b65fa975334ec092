"""Columns of a real camera, as the protocol of its set-up records them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.characterise import ColumnCalibration
from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.camera.camera import Camera

PROTOCOLS: Final = GivenFiles(
    error=RequestError, remedy="give the protocol of a set-up, or delete it to begin anew", largest_mb=64
)
LEAST_GAIN: Final = 0.02
"""Least gain of a column over the mean of all: one that sees less is dead or covered."""


def measured_columns(path: Path, camera: Camera) -> list[ColumnCalibration]:
    """Read the columns of a real camera from the protocol of its set-up; RequestError: it holds none.

    A press counts its light on the lens's axis: all columns combined see as much of it as cos^4 leaves.
    """
    try:
        records = json.loads(PROTOCOLS.read_text(path))["columns"]
        columns = [
            (np.array(one["offset_dn"], np.float32), np.array(one["gain"], np.float64)) for one in records
        ]
        fit = bool(columns) and all(
            offset.ndim == gain.ndim == 1
            and offset.size == gain.size
            and np.isfinite(offset).all()
            and ((gain > LEAST_GAIN) & (gain < 1 / LEAST_GAIN)).all()
            for offset, gain in columns
        )
    except (ValueError, TypeError, KeyError) as error:
        raise RequestError(path, "is no protocol of a set-up", remedy=PROTOCOLS.remedy) from error
    if not fit:
        what = "holds no columns of a camera, or some that see no light"
        raise RequestError(path, what, remedy="repeat the steps dark and flat of `prooflight camera set-up`")
    shade = float(camera.column_light().mean())
    return [
        ColumnCalibration(offset_dn=offset, gain=(shade * gain).astype(np.float32))
        for offset, gain in columns
    ]
