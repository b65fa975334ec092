"""What a line camera would see of a covered lens, white paper and printed pages, at any exposure time, with its noise.

For cameras to plug in: one of this process (``PlayedCamera``), and one on loopback (``scene_peer``).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.errors import RequestError
from prooflight_line.cameras.camera import CameraInfo, Feature, Grab, Health

if TYPE_CHECKING:
    from collections.abc import Mapping

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

SCENE_OF = {"dark": "dark", "flat": "flat", "focus": "ruler", "width": "ruler", "pitch": "ruler"}
"""What a technician puts under the camera before answering a question."""


@dataclass(slots=True)
class Scenes:
    """Everything in digital numbers at the reference exposure time."""

    images: dict[str, np.ndarray]
    """By scene: (sensors, lines, pixels) mean, over and over."""
    base: np.ndarray
    """(sensors, pixels) without charge: black level and DSNU."""
    gain: np.ndarray
    """(sensors,) [DN/e-]"""
    read_e: np.ndarray
    top: int
    reference_us: float
    scene: str = "dark"
    at: int = 0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(11))

    @classmethod
    def of(cls, truth: PressFile, press: Press, pages: Mapping[str, Page], *, reference_us: float) -> Scenes:
        """truth: the press file of which the press was built; pages by scene; dark and white paper beside them."""
        from prooflight.prediction.predict import predict

        sensors, columns = truth.camera().sensors, press.sensors
        pages = {**pages, "flat": _blank(press)}
        images = {
            name: predict(page, sensors=columns, geometry=press.geometry, threads=1).expected_dn
            for name, page in pages.items()
        }
        images["flat"] = images["flat"][:, 200:232]
        base = np.stack(
            [
                one.column_offset_dn - sensor.dark_e * sensor.dn_per_e
                for one, sensor in zip(columns, sensors, strict=True)
            ]
        )
        images["dark"] = np.stack([one.column_offset_dn for one in columns])[:, None, :]
        return cls(
            images=images,
            base=base,
            gain=np.array([one.dn_per_e for one in sensors]),
            read_e=np.array([one.read_noise_e for one in sensors]),
            top=sensors[0].top_code_dn,
            reference_us=reference_us,
        )

    def save(self, path: Path) -> None:
        np.savez(
            path,
            base=self.base,
            gain=self.gain,
            read_e=self.read_e,
            facts=np.array([self.top, self.reference_us]),
            **{f"image-{name}": image.astype(np.float32) for name, image in self.images.items()},
        )

    @classmethod
    def load(cls, path: Path) -> Scenes:
        held = np.load(path)
        top, reference_us = held["facts"]
        images = {name.removeprefix("image-"): held[name] for name in held.files if name.startswith("image-")}
        return cls(images, held["base"], held["gain"], held["read_e"], int(top), float(reference_us))

    def lines(self, count: int, exposure_us: float) -> np.ndarray:
        """The next lines (sensors, count, pixels) uint16."""
        image = self.images[self.scene]
        rows = np.arange(self.at, self.at + count) % image.shape[1]
        self.at += count
        base, gain = self.base[:, None, :], self.gain[:, None, None]
        charge = np.maximum(image[:, rows] - base, 0) / gain * (exposure_us / self.reference_us)
        noise = self.rng.standard_normal(charge.shape, np.float32)
        seen = base + gain * (charge + noise * np.sqrt(charge + self.read_e[:, None, None] ** 2))
        return np.clip(np.floor(seen + 0.5), 0, self.top).astype(np.uint16)

    def follow(self, file: Path) -> None:
        """Show what a technician would, by the protocol of a set-up or by a scene's name in a file."""
        try:
            text = file.read_text()
        except OSError:
            return
        if text.startswith("{"):
            told = json.loads(text)
            key = str(told["asking"]).split(".")[0]
            wanted = "job" if told["finished"] and "job" in self.images else SCENE_OF.get(key, "")
        else:
            wanted = text.strip()
        if wanted in self.images and wanted != self.scene:
            self.scene, self.at = wanted, 0


def _blank(press: Press) -> Page:
    from prooflight.pages.raster import Page

    wide, dpi = press.geometry.field_mm - 0.2, 254.0
    return Page(cmyk=np.zeros((600, round(wide * 10), 4), np.uint8), dpi=dpi, name="blank", number=1)


class PlayedCamera:
    """A camera of this process; see ``Camera``. Its clock goes on as lines come."""

    info = CameraInfo(id="Played-1", maker="Played", model="P", serial="1", address="here", backend="none")

    def __init__(
        self, scenes: Scenes, *, form: str = "Mono12", rate_hz: float = 2770.0, **features: Any
    ) -> None:
        self.scenes, self.rate_hz, self.now_s, self.blocks = scenes, rate_hz, 0.0, 0
        self.silent = False
        pixels = scenes.base.shape[1]
        self.values: dict[str, Any] = {
            "Width": pixels,
            "Height": 64,
            "PixelFormat": form,
            "AcquisitionLineRate": rate_hz,
            "ExposureTime": scenes.reference_us,
            "DeviceTemperature": 41.5,
            **features,
        }
        self.limits = {"ExposureTime": (1.0, 1e5)}

    def clock(self) -> float:
        return self.now_s

    def features(self) -> dict[str, Feature]:
        return {name: one for name in self.values if (one := self.feature(name)) is not None}

    def feature(self, name: str) -> Feature | None:
        if self.values.get(name) is None:
            return None
        least, greatest = self.limits.get(name, (None, None))
        kind = "float" if isinstance(self.values[name], float) else "integer"
        return Feature(name=name, kind=kind, value=str(self.values[name]), least=least, greatest=greatest)

    def set(self, name: str, value: str) -> None:
        if name not in self.values:
            raise RequestError(name, "there is none", remedy="look")
        self.values[name] = type(self.values[name])(value)

    def start(self) -> None:
        pass

    def grab(self, timeout_s: float) -> Grab | None:
        if self.silent:
            self.now_s += timeout_s
            return None
        if timeout_s == 0.0:
            return None  # nothing waits
        self.blocks += 1
        self.now_s += 64 / self.rate_hz
        lines = self.scenes.lines(64, float(self.values.get("ExposureTime") or self.scenes.reference_us))
        data = np.ascontiguousarray(lines.transpose(1, 2, 0)).astype("<u2").view(np.uint8).ravel()
        return Grab(
            block_id=self.blocks,
            id_wraps=False,
            data=data,
            missing=(),
            pixel_format=self.values["PixelFormat"],
            lines=64,
            pixels=lines.shape[2],
            padding=0,
            time_s=self.now_s,
        )

    def health(self) -> Health:
        return Health(temperature_c=41.5)

    def close(self) -> None:
        pass
