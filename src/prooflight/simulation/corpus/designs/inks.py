"""Ink mixtures, separation of screen colours, and the palette of one design."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prooflight.simulation.corpus.designs.chance import count, often, pick, some

Ink = tuple[int, int, int, int]
"""C M Y K, 0 = no ink, 255 = full ink."""

PAPER: Ink = (0, 0, 0, 0)
BLACK: Ink = (0, 0, 0, 255)
GREY_BALANCE = np.array([1.0, 0.90, 0.88], np.float32)
"""Magenta and yellow for each part of cyan in a neutral grey.

Assumed, about the 50/41/41 of offset's grey-balance patches.
"""
TOTAL_INK_MAX = 3.2
"""Usual limit of total ink on coated paper, in full inks; assumed."""
LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # ITU-R BT.601


@dataclass(frozen=True, slots=True, kw_only=True)
class Separation:
    """Separation of a design's pictures: black alone, or four inks with grey component replacement."""

    black_alone: bool
    replaced: float
    """Share of the grey component printed with black."""
    from_grey: float
    """Grey component above which black is used."""

    def inks(self, rgb: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Separate encoded RGB (rows, columns, 3), 0..1 -> (rows, columns, 4) bytes.

        The argument is overwritten.
        """
        cmyk = np.zeros((*rgb.shape[:2], 4), np.float32)
        np.clip(rgb, 0.0, 1.0, out=rgb)
        if self.black_alone:
            cmyk[..., 3] = 1.0 - rgb @ LUMA
            return _bytes(cmyk)
        cmy = np.subtract(1.0, rgb, out=rgb)
        grey = np.minimum(np.minimum(cmy[..., 0], cmy[..., 1]), cmy[..., 2])
        black = np.clip((grey - self.from_grey) / (1.0 - self.from_grey), 0.0, 1.0) ** 1.4
        taken = np.minimum(self.replaced * black, 0.95)
        cmy -= (0.85 * taken)[..., None]
        np.clip(cmy, 0.0, 1.0, out=cmy)
        cmy *= GREY_BALANCE
        cmyk[..., 3] = taken
        room = (TOTAL_INK_MAX - taken) / np.maximum(cmy.sum(axis=2), 1e-3)
        cmy *= np.minimum(room, 1.0)[..., None]
        cmyk[..., :3] = cmy
        return _bytes(cmyk)

    def ink(self, red: float, green: float, blue: float) -> Ink:
        """Separate one flat colour, as ``inks``."""
        values = self.inks(np.array([[[red, green, blue]]], np.float32))[0, 0]
        return (int(values[0]), int(values[1]), int(values[2]), int(values[3]))


def _bytes(cmyk: NDArray[np.float32]) -> NDArray[np.uint8]:
    cmyk *= 255.0
    cmyk += 0.5
    return cmyk.astype(np.uint8)


def grey(share: float) -> Ink:
    """Return a tint of black alone."""
    return (0, 0, 0, round(255 * share))


def lighter(ink: Ink, share: float) -> Ink:
    """Return the same mixture with this share of every ink."""
    c, m, y, k = (round(share * part) for part in ink)
    return (c, m, y, k)


def between(start: Ink, end: Ink, share: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return mixtures at a share (...) of the way from one to the other, (..., 4), rounded down."""
    way = share[..., None]
    return (np.array(start, np.float32) * (1 - way) + np.array(end, np.float32) * way).astype(np.uint8)


def is_dark(ink: Ink) -> bool:
    """Return whether type on it should be light.

    Weights: about the share of white light that each ink absorbs, K nearly all.
    """
    c, m, y, k = ink
    return 0.7 * c + 0.75 * m + 0.15 * y + k > 135


@dataclass(frozen=True, slots=True, kw_only=True)
class Palette:
    """Colours of one design."""

    text: Ink
    """Colour of running text."""
    strong: Ink
    """Colour of headings and marks."""
    bright: Ink
    """Accent colour."""
    third: Ink
    tint: Ink
    """Pale ground."""
    deep: Ink
    """Dark ground."""

    @property
    def chart(self) -> tuple[Ink, ...]:
        """Return the colours of a chart's series, from strong to pale."""
        return (
            self.strong,
            self.bright,
            self.third,
            lighter(self.strong, 0.55),
            lighter(self.bright, 0.5),
            lighter(self.third, 0.45),
        )

    @classmethod
    def draw(cls, rng: np.random.Generator, separation: Separation) -> Palette:
        """Draw a harmonious palette: one hue, its neighbour or opposite, and their tints; or greys."""
        if separation.black_alone:
            return cls(
                text=BLACK,
                strong=pick(rng, (BLACK, BLACK, grey(some(rng, 0.7, 0.95)))),
                bright=grey(some(rng, 0.45, 0.7)),
                third=grey(some(rng, 0.25, 0.45)),
                tint=grey(some(rng, 0.05, 0.17)),
                deep=grey(some(rng, 0.78, 1.0)),
            )
        hue = rng.random()
        second = hue + pick(rng, (0.06, -0.08, 0.33, 0.5, 0.45, -0.33)) + some(rng, -0.03, 0.03)
        third = hue + pick(rng, (0.16, -0.16, 0.6, 0.5))

        def mixed(hue: float, saturation: float, value: float) -> Ink:
            return separation.ink(*colorsys.hsv_to_rgb(hue % 1.0, saturation, value))

        strong = mixed(hue, some(rng, 0.55, 1.0), some(rng, 0.35, 0.8))
        return cls(
            text=BLACK if often(rng, 0.85) else mixed(hue, 0.4, 0.2),
            strong=strong,
            bright=mixed(second, some(rng, 0.6, 1.0), some(rng, 0.75, 1.0)),
            third=mixed(third, some(rng, 0.4, 0.9), some(rng, 0.6, 0.95)),
            tint=mixed(pick(rng, (hue, second)), some(rng, 0.05, 0.2), some(rng, 0.93, 1.0)),
            deep=_deep(rng, strong),
        )


def _deep(rng: np.random.Generator, strong: Ink) -> Ink:
    """Draw a dark ground: black enriched by colour, or the design's own colour made darker."""
    if often(rng, 0.35):
        return (count(rng, 60, 150), count(rng, 40, 130), count(rng, 30, 110), count(rng, 225, 255))
    c, m, y, k = strong
    return (min(c + 30, 255), min(m + 25, 255), min(y + 10, 255), min(k + count(rng, 70, 150), 255))
