"""One small press and one page that many tests share."""

from __future__ import annotations

import gc
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from _pytest.doctest import DoctestItem, DoctestModule  # pytest has no public names for them
from hypothesis import settings
from tests import durations
from tests.stand_ins import SHARED
from tests.turns import in_turn
from tests.two_sensors import BLUE_SENSOR

from prooflight.camera.camera import Camera
from prooflight.camera.optics import Lens, Light
from prooflight.camera.sensor import LineSensor
from prooflight.commissioning.build import build_press
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.pages import process
from prooflight.pages.raster import Page
from prooflight.press.artefact import Press
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator

# The same examples on every machine; `--hypothesis-profile=explore` looks for new ones.
settings.register_profile("same everywhere", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=300)
settings.load_profile("same everywhere")


def pytest_addoption(parser: pytest.Parser, pluginmanager: pytest.PytestPluginManager) -> None:
    """Slow tests are marked wherever they lie; a conftest's own hooks would see its folder's alone."""
    pluginmanager.register(durations)


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(file_path: Path) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Look for doctests only where a prompt stands: for these alone each process would import all 1,200 files."""
    collectors = yield
    if any(isinstance(one, DoctestModule) for one in collectors) and b">>> " not in file_path.read_bytes():
        return [one for one in collectors if not isinstance(one, DoctestModule)]
    return collectors


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Print arrays in doctests as NumPy does by itself; colour-science has NumPy 1.13's way from its import on."""
    if not isinstance(item, DoctestItem):
        return (yield)
    with np.printoptions(legacy=False):
        return (yield)


def pytest_collection_finish() -> None:
    """Exclude all tests and modules from garbage collection: each full one would visit them, for a second or two."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def session_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of this test run, which its processes share."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="session", autouse=True)
def caches_of_the_tests(session_folder: Path) -> None:
    """Give commands that tests start a cache folder of this test run alone, which its processes share."""
    os.environ["XDG_CACHE_HOME"] = str(session_folder / "cache")


@pytest.fixture(scope="session", autouse=True)
def runs_collect_no_garbage() -> Iterator[None]:
    """Let runs begin at once, and leave what was frozen after collection so; a run freezes and collects all objects."""
    spared = SimpleNamespace(collect=lambda: 0, freeze=lambda: None, unfreeze=lambda: None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "gc", spared)
        yield


@pytest.fixture(scope="session", autouse=True)
def on_one_processor() -> Iterator[None]:
    """Let commands start no processes: each would load all kernels again, while other tests use the other cores.

    Tests of several processes ask for so many.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "cpu_count", lambda: 1)
        yield


def built_once(path: Path, build: Callable[[], Press]) -> Press:
    """Return the press of a file of the test run; the process that needs it first makes it, and the others read it."""
    with in_turn(path):
        if not path.exists():
            build().save(path)
    return Press.load(path)


@pytest.fixture(scope="session")
def prototype() -> PressFile:
    return PressFile.prototype()


@pytest.fixture(scope="session")
def press(prototype: PressFile, session_folder: Path) -> Press:
    """The paper's rig with a line of 400 pixels, 42 mm."""
    return built_once(session_folder / "rig.press", lambda: build_press(prototype, seed=1, pixels=400))


@pytest.fixture(scope="session")
def two_sensor_file(prototype: PressFile) -> PressFile:
    """The rig with a second sensor: blue-sensitive, 10 bits, with a black level."""
    assert prototype.text.count("[costs]") == 1
    return PressFile(Path("two.toml"), prototype.text.replace("[costs]", BLUE_SENSOR))


@pytest.fixture(scope="session")
def two_sensor_press(two_sensor_file: PressFile, session_folder: Path) -> Press:
    return built_once(session_folder / "two.press", lambda: build_press(two_sensor_file, seed=2, pixels=400))


@pytest.fixture(scope="session")
def make_page() -> Callable[..., Page]:
    """A page like those of a real job: paper, bars as wide as letters' stems, flat tints, a noisy picture."""

    def make(
        seed: int, *, width_mm: float = 36.0, height_mm: float = 44.0, dpi: float = 481.8, number: int = 1
    ) -> Page:
        rng = np.random.default_rng(seed)
        rows, columns = (round(extent * dpi / 25.4) for extent in (height_mm, width_mm))
        cmyk = np.zeros((rows, columns, 4), np.uint8)
        third = rows // 3
        stem = max(round(0.4 * dpi / 25.4), 1)
        for top in range(stem, third - 4 * stem, 6 * stem):  # black text
            bars = np.repeat(rng.random(-(-columns // stem)) < 0.4, stem)[:columns]
            cmyk[top : top + 4 * stem, :, 3] = np.where(bars, 255, 0)
        for patch in range(8):  # tints of one and two inks
            left, right = patch * columns // 8, (patch + 1) * columns // 8
            inks = rng.choice(3, size=1 + patch % 2, replace=False)
            for ink in inks:
                cmyk[third : 2 * third, left:right, ink] = rng.integers(60, 230)
        coarse = rng.integers(0, 200, (6, 8, 4)).astype(np.float32)
        smooth = cv2.resize(coarse, (columns, rows - 2 * third), interpolation=cv2.INTER_CUBIC)
        grain = rng.normal(0, 12, smooth.shape)
        cmyk[2 * third :] = np.clip(smooth + grain, 0, 255)
        return Page(cmyk=cmyk, dpi=dpi, name=f"p{number:04}", number=number)

    return make


@pytest.fixture(scope="session")
def page(make_page: Callable[..., Page]) -> Page:
    return make_page(7)


@dataclass(frozen=True, kw_only=True)
class Made:
    """Pages of ``make_page`` as designs that teach; many alike, so that few teach enough."""

    make: Callable[..., Page]

    def page(self, index: int) -> Page:
        """Design ``index``, from 0."""
        return self.make(1000 + index, number=index + 1, height_mm=30.0)


@pytest.fixture(scope="session")
def trained_press(press: Press, make_page: Callable[..., Page], session_folder: Path) -> Press:
    """The press with the matched filter, made fit by 18 of 24 designs, which lets one good page in ten alarm."""
    often = replace(press, good_pages_per_false_alarm=10.0)

    def build() -> Press:
        from prooflight.commissioning.training.train import trained

        designs = Made(make=make_page)
        return trained(often, designs, designs=24, seed=1, false_alarm_rate=0.1, processes=1)

    return often.with_detector(
        "matched_filter", model_of(built_once(session_folder / "trained.press", build))
    )


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
