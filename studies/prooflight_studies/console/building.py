"""A coarse press that the console builds and trains from its press file, with a new lamp each time."""

from __future__ import annotations

import itertools
import re
import shutil
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

from prooflight.commissioning.build import build_press
from prooflight.press.artefact import Press
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

COARSER: Final = 8
"""Factor by which pixels are fewer and wider, and lines thicker, than the prototype's: a build takes minutes."""
DIMMER: Final = 0.99
"""Light of each new lamp, as a share of the one before: a build from a file that was built before is not computed."""
TRANSPORT: Final = "\n[transport]\nlead_in_mm = 20.0\nlead_out_mm = 20.0\n"
"""Space around a sheet: its edge is located to a pixel or two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Buildable:
    """A press without a trained detector, and the file from which the console builds it with one."""

    press: Path
    press_file: Path
    digest: str
    """Digest of the press before it is built."""
    _lamps: Iterator[int] = field(default_factory=itertools.count)

    @classmethod
    def create(cls, folder: Path, *, seed: int) -> Self:
        """Write the press file, and build the press in use, which is not trained."""
        folder.mkdir()
        press_file, original = folder / "press.toml", folder / "before.press"
        press_file.write_text(_coarse(PressFile.prototype().text, light=1.0), encoding="utf-8")
        press = build_press(PressFile.read(press_file), seed=seed)
        press.save(original)
        created = cls(press=folder / "x.press", press_file=press_file, digest=press.digest)
        created.begin_again()
        return created

    def begin_again(self) -> None:
        """Put the press back as it was, without versions, and change its lamp."""
        again = self.press.with_name("again.press")
        shutil.copyfile(self.press.with_name("before.press"), again)
        again.replace(self.press)  # the console maps the file: one that is written over would end it
        shutil.rmtree(self.press.with_name(f"{self.press.name}.versions"), ignore_errors=True)
        light = DIMMER ** next(self._lamps)
        self.press_file.write_text(_coarse(PressFile.prototype().text, light=light), encoding="utf-8")

    @property
    def is_built(self) -> bool:
        """Whether the press in use is another one now, with a trained detector."""
        press = Press.load(self.press)
        return press.digest != self.digest and bool(press.detectors)


def _coarse(text: str, *, light: float) -> str:
    """Return a press file with fewer, wider pixels and thicker lines, which see the same field in ``light``."""
    for name, factor in (
        ("pixels", 1 / COARSER),
        ("pixel_pitch_um", COARSER),
        ("line_rate_hz", 1 / COARSER),
        ("luminance_cd_m2", light / COARSER**3),
    ):
        value = re.search(rf"^{name} = ([\d.]+)", text, re.MULTILINE)
        assert value is not None
        scaled = float(value[1]) * factor
        shown = f"{scaled:.0f}" if name == "pixels" else f"{scaled:.9g}"
        text = text[: value.start(1)] + shown + text[value.end(1) :]
    return text + TRANSPORT
