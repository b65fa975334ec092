"""Pictures like photographs: 1/f textures, smooth shading, occlusion edges, grain, in colours of sky, leaf and skin.

All are float RGB (rows, columns, 3), 0..1, encoded as sRGB is. They are made at the resolution of a placed image and
not of the press, so that a picture is the same at whatever resolution its page is drawn.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.simulation.corpus.designs.chance import count, often, pick_weighted, some

Field = NDArray[np.float32]
Scene = Callable[[np.random.Generator, int, int], Field]

PIXEL_MM = 0.13
"""Side of a picture pixel, 195 pixels an inch; print handbooks ask for 150 to 300."""
LARGE_PIXEL_MM = 0.19
"""Side of a pixel of pictures as large as the page, about 130 pixels an inch.

The value is assumed, and keeps them fast.
"""


def photograph(rng: np.random.Generator, width_mm: float, height_mm: float) -> Field:
    """Draw one picture of a random subject, developed at random: white balance, contrast, vignette, grain."""
    pixel_mm = float(np.clip(PIXEL_MM * np.sqrt(width_mm * height_mm) / 90, PIXEL_MM, LARGE_PIXEL_MM))
    rows, columns = max(round(height_mm / pixel_mm), 8), max(round(width_mm / pixel_mm), 8)
    scene = pick_weighted(rng, SCENES)
    return _developed(rng, scene(rng, rows, columns))


def clouds(
    rng: np.random.Generator, rows: int, columns: int, *, falling: float = 1.1, coarse: float = 2.0
) -> Field:
    """Draw a field whose amplitude falls as 1 / frequency ** falling, mean 0 and deviation about 1.

    coarse: waves over the longer side in the first octave. Each octave is added on a grid of its own size,
    which is then enlarged, so that all of them cost about as much as the finest.
    """
    longer = max(rows, columns)
    octaves = max(int(np.log2(longer / coarse)), 1)
    field = np.zeros((1, 1), np.float32)
    for octave in range(octaves):
        enlarged = 2.0 ** (octave - octaves)
        grid = max(round(rows * enlarged), 1), max(round(columns * enlarged), 1)
        noise = rng.standard_normal(grid, dtype=np.float32)
        field = cv2.resize(field, grid[::-1], interpolation=cv2.INTER_CUBIC)
        cv2.scaleAdd(noise, 2.0 ** (-falling * octave), field, dst=field)
    total = sum(4.0 ** (-falling * octave) for octave in range(octaves))
    field = cv2.resize(field, (columns, rows), interpolation=cv2.INTER_CUBIC)
    field *= np.float32(1 / (0.85 * np.sqrt(total)))  # enlarging takes about a sixth of each octave
    return field


def ramp(value: Field, *colours: tuple[float, float, float]) -> Field:
    """Map a field of 0..1 through colours -> (rows, columns, 3)."""
    steps = np.clip(value * 255, 0, 255).astype(np.uint8)
    places = np.linspace(0, 255, len(colours))
    curve = np.stack(
        [np.interp(np.arange(256), places, [colour[band] for colour in colours]) for band in range(3)], axis=1
    ).astype(np.float32)
    return curve[steps]


def _developed(rng: np.random.Generator, rgb: Field) -> Field:
    rows, columns = rgb.shape[:2]
    down, across = _grid(rows, columns, start=-1)
    balance = rng.normal(1.0, 0.04, 3).astype(np.float32) * np.float32(some(rng, 0.85, 1.12))
    vignette = 1 - np.float32(some(rng, 0.0, 0.16)) * (down**2 + across**2)
    grain = rng.standard_normal((rows, columns), dtype=np.float32)
    grain *= np.float32(some(rng, 0.004, 0.03))
    rgb *= balance
    rgb *= vignette[..., None]
    rgb += grain[..., None]
    contrast, middle = np.float32(some(rng, 0.9, 1.3)), np.float32(0.5)
    rgb -= middle
    rgb *= contrast
    rgb += middle
    return rgb


def _grid(rows: int, columns: int, *, start: float = 0) -> tuple[Field, Field]:
    """Return height from the top (rows, 1) and distance from the left (1, columns), both ``start`` to 1."""
    down, across = (np.linspace(start, 1, count, dtype=np.float32) for count in (rows, columns))
    return down[:, None], across[None]


def _colour(rng: np.random.Generator, *middle: float, spread: float = 0.06) -> tuple[float, float, float]:
    red, green, blue = np.clip(rng.normal(middle, spread), 0, 1).tolist()
    return (red, green, blue)


def landscape(rng: np.random.Generator, rows: int, columns: int) -> Field:
    """Draw sky with clouds, ranges of hills one after another, and a foreground of grass, sand or water."""
    down, _ = _grid(rows, columns)
    horizon = some(rng, 0.3, 0.7)
    evening = often(rng, 0.35)
    top = _colour(rng, 0.25, 0.3, 0.5) if evening else _colour(rng, 0.28, 0.5, 0.8)
    low = _colour(rng, 0.95, 0.65, 0.4) if evening else _colour(rng, 0.78, 0.87, 0.94)
    rgb = np.empty((rows, columns, 3), np.float32)
    rgb[:] = ramp(down / horizon, top, low)
    cover = np.clip(clouds(rng, rows, columns, falling=1.0, coarse=3) * 0.5 + some(rng, -0.5, 0.45), 0, 1)
    white = np.array(_colour(rng, 0.97, 0.9, 0.85) if evening else (0.97, 0.97, 0.98), np.float32)
    rgb += (cover * (1.0 - 0.6 * down / horizon))[..., None] * (white - rgb)
    ground = [_colour(rng, 0.16, 0.26, 0.08, spread=0.05), _colour(rng, 0.5, 0.52, 0.2, spread=0.1)]
    if often(rng, 0.4):
        ground = [_colour(rng, 0.08, 0.2, 0.28), _colour(rng, 0.6, 0.72, 0.78)]
    ranges = count(rng, 2, 4)
    for place in range(ranges):
        near = (place + 1) / ranges
        ridge = horizon + (0.85 - horizon) * 0.7 * near**1.5
        profile = clouds(rng, 1, columns, falling=1.3, coarse=3)[0] * 0.05 * (0.4 + near)
        below = down > ridge - profile[None]
        texture = clouds(rng, rows, columns, falling=0.75, coarse=12) * 0.18 + 0.45
        shade = ramp(texture + 0.25 * (down - ridge), ground[0], ground[1])
        haze = np.array(low, np.float32) * 0.85
        mixed = shade * near + haze * (1 - near)
        np.copyto(rgb, mixed, where=below[..., None])
    return rgb


def foliage(rng: np.random.Generator, rows: int, columns: int) -> Field:
    """Draw leaves or flowers close by: overlapping shaded ellipses, those in front larger and lighter."""
    ground = clouds(rng, rows, columns, falling=0.9, coarse=6) * 0.2 + 0.3
    rgb = ramp(ground, (0.03, 0.06, 0.02), _colour(rng, 0.15, 0.3, 0.1), _colour(rng, 0.4, 0.5, 0.2))
    size = max(rows, columns)
    flowers = often(rng, 0.5)
    petal = _colour(rng, 0.85, 0.35, 0.4, spread=0.25)
    for place in range(140):
        front = place / 140
        length = size * some(rng, 0.02, 0.05) * (0.6 + 2.0 * front)
        colour = petal if flowers and front > 0.75 else _colour(rng, 0.25, 0.42, 0.12, spread=0.09)
        shade = 0.45 + 0.6 * front + some(rng, -0.15, 0.15)
        centre = count(rng, 0, columns), count(rng, 0, rows)
        axes, turn = (round(length), round(length * some(rng, 0.25, 0.6))), some(rng, 0, 180)
        for step in (1.0, 0.72, 0.45):
            inner = tuple(float(part * shade * (1.25 - 0.35 * step)) for part in colour)
            shown = round(axes[0] * step), round(axes[1] * step)
            cv2.ellipse(rgb, centre, shown, turn, 0, 360, inner, -1, cv2.LINE_AA)
    rgb *= (1 + 0.1 * clouds(rng, rows, columns, falling=0.6, coarse=16))[..., None]
    return cv2.GaussianBlur(rgb, (0, 0), 0.8)


def portrait(rng: np.random.Generator, rows: int, columns: int) -> Field:
    """Draw head and shoulders before a blurred ground: skin shaded as a ball, hair, cloth."""
    ground = clouds(rng, rows, columns, falling=1.9) * 0.22 + 0.5
    rgb = ramp(ground, _colour(rng, 0.2, 0.22, 0.25, spread=0.08), _colour(rng, 0.75, 0.73, 0.7, spread=0.09))
    down, across = _grid(rows, columns)
    aspect = columns / rows
    unit = min(1.0, aspect)
    x, y = 0.5 * aspect + some(rng, -0.08, 0.08), some(rng, 0.38, 0.46)
    wide, tall = some(rng, 0.15, 0.19) * unit, some(rng, 0.2, 0.25) * unit
    dx, dy = across * aspect - x, down - y
    tone = some(rng, 0.35, 1.0)
    skin = np.array(_colour(rng, 0.94 * tone, 0.74 * tone**1.2, 0.62 * tone**1.35, spread=0.02), np.float32)
    cloth = np.array(_colour(rng, 0.4, 0.4, 0.45, spread=0.25), np.float32)
    hair = np.array(_colour(rng, 0.25, 0.17, 0.1, spread=0.05), np.float32)
    weave = 0.85 + 0.12 * clouds(rng, rows, columns, falling=0.7, coarse=8)
    light = some(rng, -1, 1)

    def over(inside: NDArray[np.bool_], colour: Field, shade: Field) -> None:
        np.copyto(rgb, colour * shade[..., None], where=inside[..., None])

    strands = 0.8 + 0.35 * clouds(rng, rows, columns, falling=0.8, coarse=30)
    volume = 1.12 + 0.5 * light * dx / wide - 0.55 * (dx / wide) ** 2 - 0.25 * (dy / tall) ** 2
    over((dx / (wide * 1.25)) ** 2 + ((dy + 0.06 * unit) / (tall * 1.15)) ** 2 < 1, hair, strands)
    shoulders = dy > tall * (1.3 + 0.5 * (dx / (2.2 * wide)) ** 2)
    over((np.abs(dx) < 0.5 * wide) & (dy > 0) & ~shoulders, skin, 0.62 * volume)
    over(shoulders, cloth, weave * (1 + 0.25 * light * dx / unit))
    fade = 0.03 * clouds(rng, rows, columns, falling=1.0, coarse=4)
    over((dx / wide) ** 2 + (dy / tall) ** 2 < 1, skin, np.clip(volume + fade, 0.15, 1.2))
    _features(rgb, round((x / aspect) * columns), round(y * rows), wide * rows, tall * rows, hair)
    return cv2.GaussianBlur(rgb, (0, 0), 1.0)


def _features(rgb: Field, x: int, y: int, wide: float, tall: float, hair: Field) -> None:
    dark = tuple(float(part * 0.5) for part in hair)
    for side in (-1, 1):
        eye = round(x + side * 0.42 * wide), round(y - 0.12 * tall)
        cv2.ellipse(rgb, eye, (round(0.15 * wide), round(0.06 * tall)), 0, 0, 360, (0.93, 0.91, 0.88), -1)
        cv2.ellipse(rgb, eye, (round(0.07 * wide), round(0.055 * tall)), 0, 0, 360, dark, -1)
        brow = eye[0], round(eye[1] - 0.1 * tall)
        axes = (round(0.2 * wide), round(0.06 * tall))
        cv2.ellipse(rgb, brow, axes, 0, 190, 350, dark, max(round(0.06 * wide), 1))
    mouth = (x, round(y + 0.5 * tall))
    cv2.ellipse(rgb, mouth, (round(0.27 * wide), round(0.08 * tall)), 0, 0, 180, (0.68, 0.33, 0.31), -1)


def still_life(rng: np.random.Generator, rows: int, columns: int) -> Field:
    """Draw balls, fruit or cups on a table by a window: highlights, cast shadows, out-of-focus background lights."""
    down, _ = _grid(rows, columns)
    table = some(rng, 0.45, 0.7)
    light = clouds(rng, rows, columns, falling=1.8) * 0.15 + 0.5
    wall = ramp(light, *(_colour(rng, 0.55, 0.54, 0.52, spread=0.13) for _ in range(2)))
    grain = clouds(rng, 1, columns * 3, falling=0.8, coarse=10)[:, :columns]
    wood = ramp(
        clouds(rng, rows, columns, falling=1.2, coarse=4) * 0.12 + 0.1 * grain + down * 0.4 + 0.2,
        _colour(rng, 0.3, 0.2, 0.12, spread=0.12),
        _colour(rng, 0.75, 0.6, 0.45, spread=0.15),
    )
    rgb = np.where((down > table)[..., None], wood, wall)
    for _ in range(count(rng, 0, 14)):
        spot = np.zeros((rows, columns), np.float32)
        centre = count(rng, 0, columns), count(rng, 0, round(table * rows))
        cv2.circle(spot, centre, round(min(rows, columns) * some(rng, 0.02, 0.07)), 1.0, -1, cv2.LINE_AA)
        rgb += spot[..., None] * np.array(_colour(rng, 0.2, 0.15, 0.1), np.float32)
    for _ in range(count(rng, 2, 6)):
        radius = min(rows, columns) * some(rng, 0.08, 0.22)
        _ball(rng, rgb, some(rng, 0.12, 0.88) * columns, some(rng, table, 0.9) * rows - 0.4 * radius, radius)
    return rgb


def _ball(rng: np.random.Generator, rgb: Field, x: float, y: float, radius: float) -> None:
    rows, columns = rgb.shape[:2]
    top, bottom = max(int(y - 1.5 * radius), 0), min(int(y + 2 * radius), rows)
    left, right = max(int(x - 2 * radius), 0), min(int(x + 3 * radius), columns)
    if top >= bottom or left >= right:
        return
    part = rgb[top:bottom, left:right]
    dy, dx = np.mgrid[top:bottom, left:right].astype(np.float32)
    dx, dy = (dx - x) / radius, (dy - y) / radius
    shadow = np.exp(-((dx - 0.7) ** 2) / 1.2 - ((dy - 0.9) / 0.28) ** 2)
    part *= (1 - 0.6 * shadow)[..., None]
    inside = dx**2 + dy**2 < 1
    height = np.sqrt(np.clip(1 - dx**2 - dy**2, 0, 1))
    lit = np.clip(0.55 * height - 0.5 * dx - 0.55 * dy, 0.0, 1.0) * 0.95 + 0.12
    shine = np.clip(height * 0.6 - 0.45 * dx - 0.6 * dy, 0, 1) ** 24
    colour = np.array(_colour(rng, 0.7, 0.45, 0.3, spread=0.28), np.float32)
    skin = 1 + 0.07 * clouds(rng, *lit.shape, falling=0.7, coarse=12)
    ball = colour * (lit * skin)[..., None] + (0.7 * shine)[..., None]
    np.copyto(part, ball, where=inside[..., None])


def town(rng: np.random.Generator, rows: int, columns: int) -> Field:
    """Draw buildings with rows of windows against a sky, by day or by night."""
    down, _ = _grid(rows, columns)
    night = often(rng, 0.4)
    top = _colour(rng, 0.03, 0.05, 0.14, spread=0.03) if night else _colour(rng, 0.4, 0.58, 0.8)
    low = _colour(rng, 0.3, 0.2, 0.3) if night else _colour(rng, 0.85, 0.87, 0.88)
    rgb = np.empty((rows, columns, 3), np.float32)
    rgb[:] = ramp(down + 0.1 * clouds(rng, rows, columns, falling=1.1, coarse=3), top, low)
    for place in range(count(rng, 9, 20)):
        near = place / 20
        wide, tall = round(columns * some(rng, 0.08, 0.24)), round(rows * some(rng, 0.25, 0.8 - 0.3 * near))
        left, roof = count(rng, -wide // 2, columns - wide // 2), rows - tall
        wall = np.array(_colour(rng, 0.5, 0.45, 0.42, spread=0.13), np.float32) * (
            0.16 if night else 0.55 + 0.45 * near
        )
        x0, x1 = max(left, 0), min(left + wide, columns)
        if x0 >= x1:
            continue
        rgb[roof:, x0:x1] = wall * (0.9 + 0.2 * np.linspace(1, 0, x1 - x0, dtype=np.float32)[None, :, None])
        pitch_x, pitch_y = max(wide // count(rng, 4, 11), 5), max(round(rows * some(rng, 0.018, 0.04)), 5)
        for y in range(roof + pitch_y, rows - pitch_y, pitch_y):
            for x in range(x0 + pitch_x // 3, x1 - pitch_x // 2, pitch_x):
                lit = rng.random() < 0.35
                glass = (0.95, 0.8, 0.45) if night and lit else wall * (0.75 if lit else 0.5)
                rgb[y : y + pitch_y // 2, x : x + pitch_x // 2] = glass
    rgb *= (1 + 0.06 * clouds(rng, rows, columns, falling=0.8, coarse=10))[..., None]
    return cv2.GaussianBlur(rgb, (0, 0), 0.7)


def matter(rng: np.random.Generator, rows: int, columns: int) -> Field:
    """Draw marble, water, cloth, rust, fur: 1/f fields bent by one another, through three colours."""
    bend = clouds(rng, rows, columns, falling=some(rng, 1.2, 1.9), coarse=some(rng, 1.5, 5))
    fine = clouds(rng, rows, columns, falling=some(rng, 0.6, 1.2), coarse=some(rng, 4, 20))
    down, across = _grid(rows, columns)
    stripes = np.sin(
        some(rng, 2, 30) * (across * some(rng, -1, 1) + down * some(rng, -1, 1)) + some(rng, 1, 4) * bend
    )
    value = 0.5 + some(rng, 0.1, 0.3) * stripes + some(rng, 0.05, 0.14) * fine
    colours = [_colour(rng, base, base, base, spread=0.13) for base in (0.12, 0.45, 0.85)]
    return ramp(value.astype(np.float32), *colours)


SCENES: dict[Scene, float] = {
    landscape: 4.0,
    portrait: 2.0,
    still_life: 3.0,
    town: 2.0,
    foliage: 2.5,
    matter: 2.0,
}
"""Frequency of each subject."""
