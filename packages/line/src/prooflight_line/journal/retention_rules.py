"""Rules of retention by customer and by class of evidence, from a file of the user; the longest rule wins.

Classes are the verdicts, with the evidence that repeats them; the pictures of misprints; and the whole scans of sheets
up for review. Pictures and scans go alone; verdicts go with all that is theirs, so they stay as long as either.
"""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

from pydantic import Field

from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles
from prooflight.files.schema import Block, Misfit, Name, checked

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

Class = Literal["verdicts", "pictures", "scans"]
ARRAYS: Final[Mapping[Class, re.Pattern[str]]] = {
    "pictures": re.compile(r"cut[0-9]+(_mm)?"),
    "scans": re.compile(r"whole(_top|_mm)?"),
}
"""Names of the arrays of each class that goes alone (``inspection.redeciding``, ``journal.arrays``)."""
REMEDY: Final = (
    "write [retention] with verdicts_days, pictures_days and scans_days, and [[retention.customers]]"
)
RULES: Final = GivenFiles(error=RequestError, remedy=REMEDY, largest_mb=1)

_Days = Annotated[float, Field(strict=True, gt=0, le=1e6, allow_inf_nan=False)]


class _Rule(Block):
    verdicts_days: _Days | None = None
    pictures_days: _Days | None = None
    scans_days: _Days | None = None


class _OfCustomer(_Rule):
    name: Name


class _OfAll(_Rule):
    customers: tuple[_OfCustomer, ...] = ()


class _Document(Block):
    retention: _OfAll


@dataclass(frozen=True, slots=True, kw_only=True)
class Days:
    """Days for which each class is stored after its run has ended."""

    verdicts: float = math.inf
    pictures: float = math.inf
    scans: float = math.inf

    def longest(self, other: Days) -> Days:
        """Return the longer time of each class; verdicts stay as long as any class."""
        pictures, scans = max(self.pictures, other.pictures), max(self.scans, other.scans)
        return Days(
            verdicts=max(self.verdicts, other.verdicts, pictures, scans), pictures=pictures, scans=scans
        )

    def over(self, days: float) -> tuple[Class, ...]:
        """Return the classes that are no longer stored so many days after their run; verdicts include the others."""
        if days > self.verdicts:
            return ("verdicts",)
        pictures: tuple[Class, ...] = ("pictures",) if days > self.pictures else ()
        scans: tuple[Class, ...] = ("scans",) if days > self.scans else ()
        return pictures + scans


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """What is stored for how long: of all runs, and of those of a customer."""

    of_all: Days
    of_customer: Mapping[str, Days]
    """Days by the customer's name, folded as ``folded``."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file of rules; RequestError names the wrong field.

        A class that the rule of a customer leaves out is stored as of all runs; one that no rule states, for ever.
        """
        try:
            document = checked(_Document, tomllib.loads(RULES.read_text(path)))
        except OSError as error:
            raise RequestError(path, "cannot be read", remedy=REMEDY) from error
        except Misfit as error:
            raise RequestError(path, f"{error.field}: {error.what}", remedy=REMEDY) from error
        except (ValueError, RecursionError) as error:
            raise RequestError(
                path, f"is not TOML ({str(error)[:200]})", remedy="correct that line"
            ) from error
        rule = document.retention
        of_customer: dict[str, Days] = {}
        for one in rule.customers:
            days = _days(one, otherwise=0.0)
            of_customer[folded(one.name)] = of_customer.get(folded(one.name), days).longest(days)
        return cls(of_all=_days(rule, otherwise=math.inf), of_customer=of_customer)

    def of(self, customers: Collection[str]) -> Days:
        """Return for how long a run of these customers is stored: the longest of all rules that apply."""
        days = self.of_all.longest(self.of_all)
        for customer in customers:
            days = days.longest(self.of_customer.get(folded(customer), days))
        return days


def customers_of(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the customers that a run's settings name: that of ``watch --customer``, and that of the job's ticket."""
    ticket = settings.get("ticket")
    named = (settings.get("customer"), ticket.get("customer") if isinstance(ticket, dict) else None)
    return tuple(dict.fromkeys(name for name in named if isinstance(name, str) and name.strip()))


def folded(name: str) -> str:
    """Return a name without what people write differently: capitals, and spaces.

    >>> folded(" Quay  Coffee")
    'quay coffee'
    """
    return " ".join(name.casefold().split())


def _days(rule: _Rule, *, otherwise: float) -> Days:
    stated = {name: getattr(rule, f"{name}_days") for name in ("verdicts", "pictures", "scans")}
    return Days(**{name: otherwise if days is None else days for name, days in stated.items()})
