"""Nuisances of good prints on which no detector is trained: a class for each, with the amounts that a file states.

A nuisance changes one of four: the session, the true press, the page's placement, or the light. All else stays as it
is, to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

import cv2
import numpy as np
from pydantic import Field

from prooflight import spectra
from prooflight.camera.optics import Light
from prooflight.commissioning.characterise import tables
from prooflight.files.schema import Block, NotNegative, Positive
from prooflight.prediction.predict import predict
from prooflight.prediction.sampling_grid import NODE_PITCH
from prooflight.press.press_file import PressFile
from prooflight.scans.placement import Warp
from prooflight.simulation.sheets import smooth_field
from prooflight.simulation.worlds import RANGES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement
    from prooflight.simulation.session import Session
    from prooflight.simulation.worlds import Amounts

Percent = Annotated[float, Field(strict=True, ge=0, le=100, allow_inf_nan=False)]
Columns = Annotated[int, Field(strict=True, ge=1, le=1000)]

MIDDLE: Final = 0.4
"""assumed: share of the field, about its middle, that has bad columns, to be under narrow designs and off edges."""
WAVE_NODES: Final = 32
"""Nodes of a warp to a period: a line between them differs from a sine by 0.5 % of its amplitude at most."""
TILT_NM: Final = (400.0, 700.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Passing:
    """A sheet that passes under the camera."""

    press: Press
    page: Page
    placement: Placement
    place: tuple[float, float]
    """Two numbers in [0, 1) that select the bad column and sensor; constant for the day."""
    others: Sequence[int]
    """Designs that may be on the other side of the sheet."""
    fetch: Callable[[int], Page] | None
    """Function that returns these designs."""

    @property
    def lines(self) -> int:
        """Number of lines of its scan."""
        return self.press.geometry.lines(self.page.height_mm)

    def seen_mm(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the points of the page that the camera's pixels see, x and y, (lines, pixels) each. [mm]"""
        page, geometry = self.page, self.press.geometry
        x, y = np.meshgrid(geometry.centres_x_mm(page.width_mm), geometry.centres_y_mm(self.lines))
        return self.placement.seen_mm(x, y, page_width_mm=page.width_mm, page_height_mm=page.height_mm)

    def on_page(self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points are on the sheet."""
        return _on(self.page, x_mm, y_mm)

    @property
    def column(self) -> int:
        """The day's bad column, or the first of several."""
        pixels = self.press.geometry.pixels
        return int(pixels * (0.5 + MIDDLE * (self.place[0] - 0.5)))

    @property
    def sensor(self) -> int:
        """The day's bad sensor."""
        return int(self.place[1] * len(self.press.sensors))


class Nuisance(Block):
    """One nuisance; the base class changes nothing."""

    what: str

    def session(self, session: Session) -> Session:
        """Return the day under the nuisance."""
        return session

    def true_press(self, press: Press, press_file: PressFile | None) -> Press:
        """Return the press as it truly is under the nuisance, whatever its tables say.

        press_file: that it was built from.
        """
        return press

    def moved(
        self, placement: Placement, page: Page, geometry: ScanGeometry, rng: np.random.Generator
    ) -> Placement:
        """Return the placement of a print under the nuisance."""
        return placement

    def light_change(self, passing: Passing, rng: np.random.Generator) -> NDArray[np.floating[Any]] | None:
        """Return the term added to 1 in the factor of the light; None: nothing. [-]

        It broadcasts to (sensors, lines, pixels).
        """
        return None


class Formation(Nuisance):
    """Paper's cloudiness: texture of one grain, alike for all sensors, on the sheet and not on what surrounds it."""

    rms_percent: Percent
    grain_mm: Positive
    where: Literal["sheet"]

    def light_change(self, passing: Passing, rng: np.random.Generator) -> NDArray[np.floating[Any]]:
        """Sample the field at each pixel's middle; a grain is many pixels wide."""
        x_mm, y_mm = passing.seen_mm()
        field = SheetTexture.draw(passing.page, self.grain_mm, rng).at(x_mm, y_mm)
        return field * (passing.on_page(x_mm, y_mm) * np.float32(self.rms_percent / 100))


class LightRipple(Nuisance):
    """Ripple of the lamp, not locked to the lines."""

    amplitude_percent: Percent
    period_lines: Positive

    def light_change(self, passing: Passing, rng: np.random.Generator) -> NDArray[np.floating[Any]]:
        """Return a sine over the scan's lines, of one phase for each sheet."""
        turns = np.arange(passing.lines) / self.period_lines + rng.random()
        return (self.amplitude_percent / 100) * np.sin(2 * np.pi * turns)[:, None]


class WebWobble(Nuisance):
    """Periodic variation of the web's speed."""

    amplitude_mm: NotNegative
    period_mm: Positive

    def moved(
        self, placement: Placement, page: Page, geometry: ScanGeometry, rng: np.random.Generator
    ) -> Placement:
        """Add a sine along the travel to the print's own warp, whose nodes stay among the new ones.

        Scans are sampled at nodes ``NODE_PITCH`` lines apart with straight lines between. That attenuates a sine by
        sinc^2 of the pitch over the period, which is compensated here; the shorter waves that it adds stay, at most 4 %
        of the amplitude for nodes a sixth of a period apart.
        """
        phase = rng.random()
        if self.amplitude_mm == 0:
            return placement
        left = np.sinc(NODE_PITCH * geometry.line_pitch_mm / self.period_mm) ** 2
        warp = finer(placement.warp, page, self.period_mm / WAVE_NODES)
        y_mm = warp.first_mm[1] + np.arange(len(warp.nodes_mm)) * warp.pitch_mm
        wave = self.amplitude_mm / left * np.sin(2 * np.pi * (y_mm / self.period_mm + phase))
        nodes = warp.nodes_mm.copy()
        nodes[..., 1] += wave[:, None].astype(np.float32)
        return replace(placement, warp=replace(warp, nodes_mm=nodes))


class ShowThrough(Nuisance):
    """The other side of the sheet: another design, mirrored across, and blurred by the paper."""

    amplitude_percent: Percent
    blur_mm: Positive
    """assumed: standard deviation of a Gaussian."""

    def light_change(self, passing: Passing, rng: np.random.Generator) -> NDArray[np.floating[Any]]:
        """Subtract ``amplitude_percent`` of the light that the other side absorbs, by each sensor's own tables."""
        x_mm, y_mm = passing.seen_mm()
        mirrored_mm = passing.page.width_mm - x_mm
        back, press = self._back(passing, rng), passing.press
        column = (mirrored_mm + press.geometry.left_mm(back.width_mm)) / press.geometry.pixel_pitch_mm - 0.5
        row = (y_mm + press.geometry.lead_in_mm) / press.geometry.line_pitch_mm - 0.5
        places = column.astype(np.float32), row.astype(np.float32)
        taken = [
            cv2.remap(each, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
            for each in _light_taken(press, back, self.blur_mm)
        ]
        return np.stack(taken) * (passing.on_page(x_mm, y_mm) * np.float32(-self.amplitude_percent / 100))

    def _back(self, passing: Passing, rng: np.random.Generator) -> Page:
        if passing.fetch is None or not passing.others:
            raise ValueError("show-through needs other designs: give `others` and `fetch`")
        for index in rng.permutation(passing.others).tolist():
            other = passing.fetch(index)
            if other.number != passing.page.number:
                return other
        raise ValueError(f"show-through: `others` has no design but page {passing.page.number} itself")


class Dust(Nuisance):
    """Dust on the glass: neighbouring columns of all sensors lose light, the same all day."""

    columns: Columns
    loss_percent: Percent

    def light_change(self, passing: Passing, rng: np.random.Generator) -> NDArray[np.floating[Any]]:
        """Attenuate whole columns, including the backing's light."""
        change = np.zeros((1, passing.press.geometry.pixels))
        change[:, passing.column : passing.column + self.columns] = -self.loss_percent / 100
        return change


class DeadColumn(Nuisance):
    """Columns of one sensor that lost gain, the same all day."""

    columns: Columns
    loss_percent: Percent

    def light_change(self, passing: Passing, rng: np.random.Generator) -> NDArray[np.floating[Any]]:
        """Attenuate whole columns, including the backing's light."""
        change = np.zeros((len(passing.press.sensors), 1, passing.press.geometry.pixels))
        change[passing.sensor, :, passing.column : passing.column + self.columns] = -self.loss_percent / 100
        return change


class LooserPress(Nuisance):
    """Variation of good prints, all amounts multiplied by a factor."""

    times: NotNegative

    def session(self, session: Session) -> Session:
        """Return the same day's draws, scaled.

        Its prints are the same prints, scaled, up to their specks, of which there are more: what is drawn after these
        (the print's lamp, flicker and noise) is drawn again.
        """
        times = self.times
        sensors = tuple(
            replace(
                sensor,
                sigma_error=sensor.sigma_error**times,
                table_gain=1 + (sensor.table_gain - 1) * times,
                table_shape_sd=sensor.table_shape_sd * times,
                column_gain=1 + (sensor.column_gain - 1) * times,
            )
            for sensor in session.sensors
        )
        return replace(
            session,
            amounts=multiplied(session.amounts, times),
            ink_gain=session.ink_gain * times,
            lamp=1 + (session.lamp - 1) * times,
            sensors=sensors,
        )


class PatchyTables(Nuisance):
    """The tables' error that is smooth in CMYK, multiplied by a factor."""

    times: NotNegative

    def session(self, session: Session) -> Session:
        """Return the day with the same errors, stronger."""
        sensors = (replace(each, table_shape_sd=each.table_shape_sd * self.times) for each in session.sensors)
        return replace(session, sensors=tuple(sensors))


class AgeingLamp(Nuisance):
    """A tilt of the lamp's spectrum without recalibration."""

    tilt_percent: Percent
    """Tilt between the ends of ``TILT_NM``; assumed: towards red, as the blue of LEDs fades first."""

    def true_press(self, press: Press, press_file: PressFile | None) -> Press:
        """Scale tables and backing by the ratio of what the same camera has under the tilted lamp and under its own."""
        if press_file is None:
            raise ValueError("the ageing lamp needs the spectra of a press file: give `press_file`")
        changes = lamp_changes(press_file.path, press_file.text, self.tilt_percent)
        sensors = (
            replace(
                sensor,
                mean_dn=sensor.mean_dn * change.mean,
                variance_dn2=sensor.variance_dn2 * change.variance,
                backing_dn=sensor.backing_dn * change.backing,
            )
            for sensor, change in zip(press.sensors, changes, strict=True)
        )
        return replace(press, sensors=tuple(sensors))


NUISANCES: Final[Mapping[str, type[Nuisance]]] = {
    "formation_half": Formation,
    "formation_one": Formation,
    "light_ripple": LightRipple,
    "web_wobble": WebWobble,
    "show_through": ShowThrough,
    "dust": Dust,
    "looser_press": LooserPress,
    "much_looser_press": LooserPress,
    "patchy_tables": PatchyTables,
    "ageing_lamp": AgeingLamp,
    "dead_column": DeadColumn,
}
"""Classes by the name of a file's table."""


def finer(warp: Warp | None, page: Page, pitch_mm: float) -> Warp:
    """Return the same warp with nodes at most ``pitch_mm`` apart; a warp of zeros over the page for None."""
    if warp is None:
        rows, columns = (int(extent / pitch_mm) + 2 for extent in (page.height_mm, page.width_mm))
        return Warp(nodes_mm=np.zeros((rows, columns, 2), np.float32), pitch_mm=pitch_mm)
    parts = int(np.ceil(warp.pitch_mm / pitch_mm))
    pitch_mm = warp.pitch_mm / parts
    rows, columns = ((count - 1) * parts + 1 for count in warp.nodes_mm.shape[:2])
    x_mm, y_mm = (
        first + np.arange(count) * pitch_mm
        for first, count in zip(warp.first_mm, (columns, rows), strict=True)
    )
    nodes = np.stack(warp.at(*np.meshgrid(x_mm, y_mm)), axis=-1).astype(np.float32)
    return Warp(nodes_mm=nodes, pitch_mm=pitch_mm, first_mm=warp.first_mm)


def multiplied(amounts: Amounts, times: float) -> Amounts:
    """Multiply all amounts as ``all_times`` of ``[variation]`` does it, including those that a press file states."""

    def more(name: str, value: Any) -> Any:
        if isinstance(value, tuple):
            return value if name in RANGES else tuple(bound**times for bound in value)
        return value * times

    def of_block(block: Any) -> Any:
        if block is None:  # not of this world
            return None
        return replace(
            block, **{each.name: more(each.name, getattr(block, each.name)) for each in fields(block)}
        )

    return replace(amounts, **{each.name: of_block(getattr(amounts, each.name)) for each in fields(amounts)})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LampChange:
    """Effect of another lamp on one sensor: new over old. [-]"""

    mean: NDArray[np.float32]
    """(33, 33, 33, 33)"""
    variance: NDArray[np.float32]
    """(33, 33, 33, 33)"""
    backing: float


@lru_cache(maxsize=2)
def lamp_changes(path: Path, text: str, tilt_percent: float) -> tuple[LampChange, ...]:
    """Return the change for every sensor of a press file.

    Results are cached by the file's text, since the tables of two lamps take seconds.
    """
    press_file = PressFile(path, text)
    camera, inks = press_file.camera(), press_file.inks()
    aged = replace(camera, light=tilted(camera.light, tilt_percent))
    backing = np.full(spectra.BANDS, press_file.backing_reflectance)
    return tuple(
        LampChange(
            mean=_ratio(new_mean, old_mean),
            variance=_ratio(new_variance, old_variance),
            backing=_backing(aged, index, backing) / _backing(camera, index, backing),
        )
        for index, ((old_mean, old_variance), (new_mean, new_variance)) in enumerate(
            zip(tables(camera, inks), tables(aged, inks), strict=True)
        )
    )


def tilted(light: Light, tilt_percent: float) -> Light:
    """Return the light with its power times a line in wavelength, level beyond ``TILT_NM``.

    Its mean power is unchanged.
    """
    low, high = TILT_NM
    place = (np.clip(spectra.WAVE_NM, low, high) - (low + high) / 2) / (high - low)
    power = light.relative_power * (1 + tilt_percent / 100 * place)
    power *= light.relative_power.sum() / power.sum()
    eye = spectra.luminous_efficiency()
    luminance = light.luminance_cd_m2 * float((eye @ power) / (eye @ light.relative_power))
    return replace(light, relative_power=power, luminance_cd_m2=luminance)


def _ratio(new: NDArray[np.float32], old: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.divide(new, old, out=np.ones_like(old), where=old > 0)


def _backing(camera: Camera, index: int, reflectance: NDArray[np.float64]) -> float:
    return float(camera.sensors[index].electrons(camera.irradiance_photons(reflectance)))


def _light_taken(press: Press, page: Page, blur_mm: float) -> NDArray[np.float32]:
    """Return the share of the paper's light that a page absorbs, blurred: (sensors, lines, pixels) of its scan. [-]

    It is 0 beyond the page.
    """
    geometry = press.geometry
    seen = predict(page, sensors=press.sensors, geometry=geometry, threads=1).expected_dn
    taken = np.zeros_like(seen)
    on_page = geometry.on_page(page.width_mm, page.height_mm)
    sigma = blur_mm / geometry.pixel_pitch_mm, blur_mm / geometry.line_pitch_mm
    for sensor, light, share in zip(press.sensors, seen, taken, strict=True):
        white = sensor.column_gain * sensor.mean_dn[0, 0, 0, 0]
        share[on_page] = (1 - (light - sensor.column_offset_dn) / white)[on_page]
        cv2.GaussianBlur(share, (0, 0), sigma[0], dst=share, sigmaY=sigma[1])
    return taken


def _on(page: Page, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> NDArray[np.bool_]:
    return (x_mm >= 0) & (x_mm < page.width_mm) & (y_mm >= 0) & (y_mm < page.height_mm)


# --- texture of a sheet ---

NODES_A_GRAIN: Final = 6
"""Nodes of the field per grain; a cubic through these omits less than 0.1 % of the field's variance."""
REACH_NODES: Final = 2
"""Nodes beyond the page that a cubic needs."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetTexture:
    """A field over a page, of mean 0 and standard deviation 1 everywhere."""

    nodes: NDArray[np.float32]
    """Values at nodes ``pitch_mm`` apart, (rows, columns); the first is ``REACH_NODES`` beyond the page's corner.
    [-]
    """
    pitch_mm: float

    @classmethod
    def draw(cls, page: Page, grain_mm: float, rng: np.random.Generator) -> Self:
        """Draw a field.

        grain_mm: full width at half maximum of the correlation, exp(-(d / l)^2) at a distance d. [mm]
        """
        pitch_mm = grain_mm / NODES_A_GRAIN
        rows, columns = (
            int(extent / pitch_mm) + 2 + 2 * REACH_NODES for extent in (page.height_mm, page.width_mm)
        )
        length_mm = grain_mm / (2 * np.sqrt(np.log(2)))
        nodes = smooth_field(rows, columns, pitch_mm=pitch_mm, length_mm=length_mm, rng=rng)
        return cls(nodes=nodes.astype(np.float32), pitch_mm=pitch_mm)

    def at(self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> NDArray[np.float32]:
        """Interpolate at points of the page, two arrays (rows, columns) -> (rows, columns).

        The field is mirrored beyond the nodes.
        """
        column, row = ((each / self.pitch_mm + REACH_NODES).astype(np.float32) for each in (x_mm, y_mm))
        values: NDArray[np.float32] = cv2.remap(
            self.nodes, column, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
        )
        return values
