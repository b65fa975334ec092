"""Designs of a camera to choose from, and the cost of their hardware: the options of ``study design``."""

from __future__ import annotations

import itertools
import math
import tomllib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import tomlkit

from prooflight.commissioning.camera.exploring import Variation, refuse_many, varied
from prooflight.errors import PressFileError, RequestError
from prooflight.files.given import shortly
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

Value = int | float | str
SENSORS: Final = "sensors"
"""Name of a choice that is no field of press files: the number of the file's sensors that a design has."""
EFFICIENCY_FILE: Final = "quantum_efficiency.file"
MOST_CENTS: Final = 1e15
AS_IT_IS: Final = "as it is"
_REMEDY: Final = "give FIELD=a,b,c, or FIELD+FIELD=a+b,c+d for values that go together"


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """Difference of one design from the press file: fields and their values, none for the file as it is."""

    values: tuple[tuple[str, Value], ...] = ()

    def __str__(self) -> str:
        return ", ".join(f"{field.rpartition('.')[2]} {value}" for field, value in self.values) or AS_IT_IS

    def press_file(self, base: PressFile) -> PressFile:
        """Return the press file of this design.

        PressFileError, RequestError: there is no such field, value or sensor.
        """
        values = dict(self.values)
        count = values.pop(SENSORS, None)
        if count is not None:
            base = _with_sensors(base, count)
        for field in values:
            if field.endswith(EFFICIENCY_FILE):
                base = _without_curve(base, field)
        return varied(base, values) if values else base


def choices(texts: Sequence[str], *, each_alone: bool = False) -> tuple[Choice, ...]:
    """Parse ``--vary`` texts into all combinations, the last running fastest.

    each_alone: return the file as it is, then one change at a time. RequestError: a text names no field or no values,
    or a field twice.
    """
    if not texts:
        raise RequestError("--vary", "is missing", remedy=_REMEDY)
    steps = [_steps(text) for text in texts]
    fields = [field for of_text in steps for field, _ in of_text[0].values]
    if len(set(fields)) < len(fields):
        raise RequestError("--vary", "names a field twice", remedy="give all values of a field at once")
    if each_alone:
        refuse_many(1 + sum(map(len, steps)))
        return (Choice(), *itertools.chain.from_iterable(steps))
    refuse_many(math.prod(len(step) for step in steps))
    return tuple(
        Choice(values=tuple(itertools.chain.from_iterable(step.values for step in combination)))
        for combination in itertools.product(*steps)
    )


def _steps(text: str) -> list[Choice]:
    """Parse ``FIELD=a,b`` or ``FIELD+FIELD=a+b,c+d``."""
    names, equals, rows = text.partition("=")
    fields = names.split("+")
    if not equals or not all(field.strip() for field in fields):
        what = f"{shortly(text)!r} does not name a field and its values"
        raise RequestError("--vary", what, remedy=_REMEDY)
    cells = [row.split("+") if len(fields) > 1 else [row] for row in rows.split(",")]
    if any(len(row) != len(fields) or not all(cell.strip() for cell in row) for row in cells):
        what = f"{shortly(text)!r} does not give {'a value' if len(fields) == 1 else f'{len(fields)} values'} each time"
        raise RequestError("--vary", what, remedy=_REMEDY)
    columns = [
        Variation.parse(f"{field}={','.join(column)}")
        for field, column in zip(fields, zip(*cells, strict=True), strict=True)
    ]
    return [
        Choice(values=tuple((column.field, value) for column, value in zip(columns, row, strict=True)))
        for row in zip(*(column.values for column in columns), strict=True)
    ]


def _with_sensors(base: PressFile, count: Value) -> PressFile:
    tree = tomllib.loads(base.text)
    have = len(tree["sensor"])
    if not isinstance(count, int) or not 1 <= count <= have:
        what = f"sensors: {shortly(str(count))} of {have}"
        remedy = f"choose 1 to {have}, or add a [[sensor]] block to the press file (two-sensors.toml has two)"
        raise PressFileError(base.path, what, remedy=remedy)
    tree["sensor"] = tree["sensor"][:count]
    return PressFile(base.path, tomlkit.dumps(tree))


def _without_curve(base: PressFile, field: str) -> PressFile:
    """Replace the curve in the press file, whose numbers would conflict with the file that is set next."""
    tree = tomllib.loads(base.text)
    number = field.split(".")[1]
    for place, sensor in enumerate(tree["sensor"]):
        if not number.isdecimal() or int(number[:9]) == place + 1:
            curve = {"file": str(sensor["quantum_efficiency"].get("file", "to-be-replaced.csv"))}
            sensor["quantum_efficiency"] = curve
    return PressFile(base.path, tomlkit.dumps(tree))


@dataclass(frozen=True, slots=True, kw_only=True)
class Prices:
    """Costs of hardware and computing, as the user states them."""

    sensor_cents: float = 0.0
    """Cost of one sensor with its share of lens and electronics. [cent]"""
    computing_cents: float = 0.0
    """Cost of comparing 10,000 pages of one sensor of the press file; more pixels a page cost more. [cent]"""
    life_pages: float = 1e8
    """Pages over which hardware is written off. assumed: 100 pages a minute in two shifts for four years. [-]"""
    of_values: tuple[tuple[str, str, float], ...] = ()
    """Surcharges (field, value as text, cents): extra cost of a design with that value over the press file. [cent]"""

    def __post_init__(self) -> None:
        for name, value in (("--sensor-cost", self.sensor_cents), ("--computing-cost", self.computing_cents)):
            if not 0 <= value <= MOST_CENTS:
                raise RequestError(name, f"{value} is not a cost", remedy=f"give cents, 0 to {MOST_CENTS:g}")
        if not 1 <= self.life_pages <= MOST_CENTS:
            raise RequestError(
                "--life-pages", f"{self.life_pages} is not a number of pages", remedy="give a number above 0"
            )

    def hardware_cents(self, choice: Choice, sensors: int) -> float:
        """Return the hardware cost of 10,000 pages. [cent]"""
        given = {(field, _as_text(value)) for field, value in choice.values}
        extra = sum(cents for field, value, cents in self.of_values if (field, value) in given)
        return (sensors * self.sensor_cents + extra) * 10_000 / self.life_pages


def parse_prices(texts: Sequence[str], of: Sequence[Choice]) -> tuple[tuple[str, str, float], ...]:
    """Parse texts ``FIELD=VALUE:CENTS``, below 0 where the value is the cheaper one.

    RequestError for anything else, and for a value that no design has.
    """
    return tuple(_price(text, of) for text in texts)


def _price(text: str, of: Sequence[Choice]) -> tuple[str, str, float]:
    what, _, cents = text.rpartition(":")
    field, equals, value = what.partition("=")
    try:
        amount = float(cents)
    except ValueError:
        amount = float("nan")
    if not equals or not abs(amount) <= MOST_CENTS:
        remedy = "give FIELD=VALUE:CENTS, e.g. light.luminance_cd_m2=200:50000"
        raise RequestError("--price", f"{shortly(text)!r} does not state what costs how much", remedy=remedy)
    if (field, value) not in {(name, _as_text(given)) for name, given in _given(of)}:
        remedy = "use a field and value of --vary, written in the same way"
        raise RequestError("--price", f"no design has {shortly(what)}", remedy=remedy)
    return field, value, amount


def _given(of: Sequence[Choice]) -> Iterator[tuple[str, Value]]:
    for choice in of:
        yield from choice.values


def _as_text(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:g}"
