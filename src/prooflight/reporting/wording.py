"""Words and numbers of reports."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from prooflight.detectors.disposition import DecidedBy, Disposition, without_gate
from prooflight.detectors.registry import family_text
from prooflight.reporting.defect_phrases import KINDS
from prooflight.reporting.defect_text import describe

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Verdict

DISPOSITIONS: dict[Disposition, str] = {
    "accept": "accepted",
    "hold": "held until a person has seen it",
    "divert": "diverted",
    "stop": "press stopped",
}
BY_COSTS = "accepted by the costs of the press file: stopping costs more"
WORLDS = {
    "ideal": "ideal world: a good print differs from the expected picture by the sensor's noise alone",
    "press": "press world: good prints differ as those of a real press do",
    "measured": "measured world: good prints are screened, and differ as public series of real sheets show",
}


def disposition(what: Disposition, by: DecidedBy) -> str:
    """Describe the disposition of a sheet.

    >>> disposition("hold", "default"), disposition("accept", "costs")
    ('held until a person has seen it', 'accepted by the costs of the press file: stopping costs more')
    """
    return BY_COSTS if by == "costs" else DISPOSITIONS[what]


def kind(name: str | None) -> str:
    """Describe a misprint kind.

    >>> kind("scum")
    'Ink on blank paper (scum)'
    >>> kind(None)
    'Small deviations on the whole page'
    """
    return KINDS["en"].get(name or "unknown", name or "")


def judged(verdict: Verdict, size_mm: tuple[float, float] | None) -> str:
    """Describe the verdict of a page of size_mm (width, height; None: unknown), in one sentence or two."""
    if verdict.verdict == "not-inspected":
        why = f": {verdict.reason}" if verdict.reason else ""
        return f"{verdict.page} was not inspected{why}. Decision: {disposition(*without_gate(verdict))}."
    text = f"{verdict.page} is good."
    if verdict.verdict == "misprint":
        what = describe(verdict, size_mm=size_mm).sentence
        text = f"{verdict.page} is a misprint: {what}. Decision: {disposition(*without_gate(verdict))}."
    note = widened(verdict.widened)
    return f"{text} {note[0].upper()}{note[1:]}." if note else text


def widened(times: float) -> str:
    """Describe the wider tolerance of a page, with the reason; empty if it is not widened.

    >>> widened(1.28)
    'more colours than the fit can follow: tolerances 1.28 times as wide'
    """
    return f"more colours than the fit can follow: tolerances {times:g} times as wide" if times > 1 else ""


def family(name: str | None, detector: str) -> str:
    """Describe a family of evidence of a detector.

    >>> family("streak/void", "matched_filter"), family(None, "chi-square")
    ('lines along the travel (streak/void)', '–')
    """
    if name is None:
        return "–"
    what = family_text(detector, name)
    return f"{what} ({name})" if what else name


def cents(value: float) -> str:
    """Format money to three digits.

    >>> cents(0.0903), cents(0.00001234)
    ('0.0903 cents', '1.23e-05 cents')
    """
    return f"{value:.3g} cents"


def count(number: int, noun: str) -> str:
    """Format a number with its noun.

    >>> count(1, "page"), count(2, "page")
    ('1 page', '2 pages')
    """
    return f"{number:,} {noun}" + ("" if number == 1 else "s")


def not_inspected(of_what: str, number: int, first: str) -> str:
    """State how many were not inspected, and the reason of the first.

    >>> not_inspected("2 of 9 pages", 2, "p0003: the scan is missing")
    '2 of 9 pages were not inspected (the first p0003: the scan is missing)'
    >>> not_inspected("1 sheet", 1, "")
    '1 sheet was not inspected'
    """
    verb, which = ("was", "") if number == 1 else ("were", "the first ")
    return f"{of_what} {verb} not inspected" + (f" ({which}{first})" if first else "")


def suspended(number: int) -> str:
    """State how many verdicts, the last of their run, have no guaranteed false-alarm rate.

    >>> suspended(57)
    'promise suspended: the promised false-alarm rate does not hold for the last 57 sheets'
    """
    sheets = "sheet" if number == 1 else f"{number:,} sheets"
    return f"promise suspended: the promised false-alarm rate does not hold for the last {sheets}"


def millimetres(value: float) -> str:
    """Format millimetres to a tenth, without a sign on zero.

    >>> millimetres(-0.04), millimetres(83.26)
    ('0.0', '83.3')
    """
    return f"{round(value, 1) + 0.0:.1f}"


def mark_size(size_mm: float) -> str:
    """Format a size with two digits, or as none if no size is enough.

    >>> mark_size(0.2468), mark_size(float("inf"))
    ('0.25', 'none')
    """
    return f"{size_mm:.2g}" if isfinite(size_mm) else "none"


def score(value: float | None) -> str:
    """Format a score with three digits, or with all of those before the point.

    >>> score(61.0983), score(1234567.8), score(None)
    ('61.1', '1,234,568', '–')
    """
    if value is None:
        return "–"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def p_value(value: float | None) -> str:
    """Format a p-value, down to the least double.

    >>> p_value(0.034), p_value(2.13e-12), p_value(0.0), p_value(None)
    ('0.034', '2.1 × 10⁻¹²', 'below 10⁻³⁰⁰', '–')
    """
    if value is None:
        return "–"
    if value < 1e-300:
        return "below 10⁻³⁰⁰"
    if value >= 1e-3:
        return f"{value:.2g}"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa} × 10" + str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def probability(value: float | None) -> str:
    """Format a probability in per cent, never rounded to certainty.

    >>> probability(0.35), probability(1.0), probability(0.0002), probability(None)
    ('35 %', 'over 99.9 %', 'below 0.1 %', '–')
    """
    if value is None:
        return "–"
    if value > 0.999:
        return "over 99.9 %"
    if value < 0.001:
        return "below 0.1 %"
    return f"{100 * value:.3g} %"
