"""Numbers that others computed, in the ``shared`` folder beside the repository."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.sensing.camera import Camera
from prooflight.sensing.light import Light
from prooflight.sensing.optics import Lens
from prooflight.sensing.sensor import LineSensor

if TYPE_CHECKING:
    from collections.abc import Callable

SHARED = Path(__file__).resolve().parents[2] / ".." / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    if not SHARED.is_dir():
        pytest.skip("needs the folder `shared` beside the repository")
    return SHARED


@pytest.fixture(scope="session")
def oracle(shared: Path) -> Callable[[str], dict[str, Any]]:
    """One of ISETCam's files by name."""

    def read(name: str) -> dict[str, Any]:
        path = shared / "oracle" / f"isetcam_{name}.json"
        if not path.is_file():
            pytest.skip(f"needs shared/oracle/{path.name}")
        return json.loads(path.read_text(encoding="utf-8"))

    return read


@pytest.fixture(scope="session")
def isetcam_camera(oracle: Callable[[str], dict[str, Any]]) -> Callable[..., Camera]:
    """A camera with the parameters that stand in the files, at one distance of the page."""
    patches = oracle("patches")

    def make(distance_m: float) -> Camera:
        p = patches["params"]
        gain = p["conversionGain"]
        sensor = LineSensor(
            name="isetcam",
            pixels=96,
            pixel_pitch_um=p["pixelPitch"] * 1e6,
            fill_factor=p["fillFactor"],
            tdi_stages=p["nStages"],
            line_rate_hz=p["lineRate"],
            conversion_gain_uv_per_e=gain * 1e6,
            voltage_swing_v=p["voltageSwing"],
            read_noise_e=p["readNoise"] / gain,
            dark_current_e_per_s=p["darkVoltage"] / gain,
            dsnu_e=p["dsnu"] / gain,
            prnu_percent=p["prnu"],
            bits=12,
            black_level_dn=0,
            quantum_efficiency=np.array(p["QE"]),
        )
        lens = Lens(
            focal_length_mm=p["focalLength"] * 1e3,
            f_number=p["fNumber"],
            transmittance=patches["lens_transmittance"],
            object_distance_mm=distance_m * 1e3,
        )
        power = np.array(patches["illuminant_energy"])
        light = Light(name="isetcam", relative_power=power, luminance_cd_m2=p["Lwhite"])
        return Camera(light=light, lens=lens, sensors=(sensor,))

    return make
