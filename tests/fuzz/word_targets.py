"""The small languages of the command line: a mutant is an argument's text."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

import numpy as np
from tests.fuzz.harness import Target
from tests.fuzz.spoiling import spoil_text

if TYPE_CHECKING:
    from pathlib import Path

NUL = "\x00"


def _words(path: Path) -> str:
    """As an argument holds them: text without the NUL that no argument can hold, at most 128 KiB (Linux)."""
    text = path.read_bytes().replace(b"\x00", b"")[: 2**17 - 1]
    return text.decode("utf-8", errors="surrogateescape")


def pages_samples() -> list[bytes]:
    return [b"1,4-6", b"7-9, 1,2", b"24"]


def read_pages(path: Path) -> None:
    from prooflight.pages.job import parse_pages

    assert set(parse_pages(_words(path), 24)) <= set(range(1, 25))


def misprint_samples() -> list[bytes]:
    return [b"streak:0.8", b"missing-plane", b"wrong-page:1"]


def read_misprint(path: Path) -> None:
    from prooflight.simulation.scans import MisprintRequest

    request = MisprintRequest.parse(_words(path))
    assert request.severity is None or 0 <= request.severity <= 1


def vary_samples() -> list[bytes]:
    return [
        b"lens.f_number=2.8,4,5.6",
        b"sensor.1.bits=8,10,12",
        b"sensor.pixels=1024,2048",
        b"transport.speed_mm_s=292,300",
        b"light.illuminant=D50,A",
        b"inks.model=auto",
        b"lens.f_number+sensor.tdi_stages=2.8+96,4+48",
    ]


def read_vary(path: Path) -> None:
    from prooflight.press.press_file import PressFile
    from prooflight_studies.design.choices import choices

    base = PressFile.prototype()
    for choice in choices([_words(path)])[:50]:
        choice.press_file(base).camera()


def explored_samples() -> list[bytes]:
    return vary_samples()[:5]


def read_explored(path: Path) -> None:
    from prooflight.commissioning.camera.exploring import Variation, designs
    from prooflight.press.press_file import PressFile

    designs(
        PressFile.prototype(), [Variation.parse(_words(path))]
    )  # cameras are made, exploring has not begun


def price_samples() -> list[bytes]:
    return [b"lens.f_number=4:50000", b"lens.f_number=2.8:-1e3"]


def read_price(path: Path) -> None:
    from prooflight_studies.design.choices import Prices, choices, parse_prices

    of = choices(["lens.f_number=2.8,4"])
    prices = Prices(sensor_cents=1.0, of_values=parse_prices([_words(path)], of))
    assert np.isfinite([prices.hardware_cents(choice, 2) for choice in of]).all()


def exposure_samples() -> list[bytes]:
    return [b"dark.tif@277", b"dark.tif", b"folder/d@1e3"]


def read_exposure(path: Path) -> None:
    from prooflight.commissioning.camera.exposures import ExposureRequest

    request = ExposureRequest.parse(_words(path))
    assert request.line_rate_hz is None or np.isfinite(request.line_rate_hz)


def frequency_samples() -> list[bytes]:
    return [b"0,10,20", b"38.46"]


def read_frequencies(path: Path) -> None:
    from prooflight.errors import RequestError

    press = resources.files("prooflight.press").joinpath("presets", "prototype.toml")
    _run(["camera", "mtf", str(press), f"--freq={_words(path)}", "--json"], RequestError)


def _run(arguments: list[str], refusal: type[Exception]) -> None:
    """The whole command line; what it refuses in one line is raised again."""
    import contextlib
    import io

    from prooflight.cli import run

    said, shown = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(shown):
        code = run(arguments)
    if code == 2:
        where, _, why = said.getvalue().rstrip("\n").partition(": ")
        raise refusal(where, why, remedy="as it says")
    assert code == 0
    assert "NaN" not in shown.getvalue()


def _target(name: str, samples: object, read: object) -> Target:
    return Target(name=name, suffix=".words", samples=samples, mutate=spoil_text, read=read, named=False)


TARGETS = (
    _target("pages", pages_samples, read_pages),
    _target("misprint", misprint_samples, read_misprint),
    _target("vary-design", vary_samples, read_vary),
    _target("vary-explore", explored_samples, read_explored),
    _target("price", price_samples, read_price),
    _target("exposure", exposure_samples, read_exposure),
    _target("frequencies", frequency_samples, read_frequencies),
)
