"""Weighted split-conformal thresholds from pages drawn with known probabilities, and estimates from a sample.

Theorem (Tibshirani, Barber, Candes, Ramdas 2019, "Conformal prediction under covariate shift", corollary 1):
let scores S_1 .. S_n be drawn independently from a law Q, and S from a law P with dP/dQ = w known up to a
factor. Then

    p = (w(S) + sum of w(S_i) over S_i >= S) / (w(S) + sum of all w(S_i))

is at most a with probability at most a. Here P is the law of the scores of the press's good sheets, and Q
that of the good sheets that people were asked about: with probability pi, so that w = 1 / pi (Horvitz and
Thompson 1952). p decreases as S increases, so that an alarm where p <= a is an alarm above a threshold.

If the press drifts, older pages have less weight: with weights that do not depend on scores, the probability
is at most a plus the weighted mean of the distance of each page's law from the new one's, in total variation
(Barber, Candes, Ramdas, Tibshirani 2023, "Conformal prediction beyond exchangeability", theorem 2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy import special

from prooflight.errors import RequestError
from prooflight.files.schema import ArraySpec, Block, Misfit, check_arrays, checked

CONFIDENCE: Final = 0.95
"""Confidence level of intervals."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelledPages:
    """Good pages of a press, as labelled by people, from which its threshold is set."""

    score: NDArray[np.float64]
    """(pages,)"""
    weight: NDArray[np.float64]
    """(pages,) number of similar sheets that each represents: more than 1 / probability if some were not
    answered, less if the page is old."""
    run: NDArray[np.int64]
    """(pages,) number of the run in the journal."""
    sheet: NDArray[np.int64]
    """(pages,) number of the sheet in the run."""
    passed: NDArray[np.bool_]
    """(pages,) whether a page is of the random sample of those that passed; the others are alarms."""
    rate: float
    """Promised rate. [-]"""
    passed_weight: float
    """Weight of a new page that scores no more than ``alarms_from``: 1 / the least probability with which
    such were drawn."""
    alarms_from: float
    """Score above which every page was asked about: the greatest threshold in force then."""
    replaces: str
    """Digest of the press artefact whose threshold this one replaces."""
    journals: tuple[str, ...] = ()
    """Names of the journal files that contained them."""
    half_life_days: float | None = None
    """Age at which a page counts half; None: all count equally."""
    design: NDArray[np.int64] | None = None
    """(pages,) number of each page's design; None: it is unknown, and each page has one of its own."""
    zones: tuple[str, ...] = ()
    """Digests of the zones that were in force, without their price, and "" for none; empty: none ever
    were."""

    def __post_init__(self) -> None:
        order = np.lexsort((self.sheet, self.run, self.score))
        for name in ("score", "weight", "run", "sheet", "passed", "design"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, np.asarray(getattr(self, name))[order])

    @property
    def sample(self) -> float:
        """Effective size of the random sample (Kish 1965: (sum w)^2 / sum w^2)."""
        weight = self.weight[self.passed]
        return float(weight.sum() ** 2 / (weight**2).sum()) if weight.size else 0.0

    @property
    def missing(self) -> int:
        """Number of further sampled pages that ``rate`` needs: 1 / rate - 1 by count; 0: enough."""
        return max(math.ceil(1 / self.rate - 1 - self.sample - 1e-9), 0)

    def p_value(self, score: float) -> float:
        """Return a bound on the probability that a good page scores so high. [-]"""
        of_alarms = float(self.weight[~self.passed].max(initial=1.0))
        own = self.passed_weight if score <= self.alarms_from else of_alarms
        above = float(self.weight[np.searchsorted(self.score, score, side="left") :].sum())
        return (own + above) / (own + float(self.weight.sum()))

    @property
    def threshold(self) -> float:
        """The least score above which ``p_value`` is at most ``rate``; RequestError: there is none."""
        # p decreases in steps: after each page's score, and where the weight of a new page changes.
        steps = np.unique(np.append(self.score, self.alarms_from))
        if not self.missing:
            for step in steps:
                if self.p_value(np.nextafter(step, np.inf)) <= self.rate * (1 + 1e-12):
                    return float(step)
        raise self.too_few()

    def alike(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return scores as if designs had been drawn with equal probability, one page of each.

        See ``exchangeability``.
        """
        if not self.score.size:
            return self.score
        retained = np.flatnonzero(rng.random(self.score.size) * self.weight.max() < self.weight)
        if self.design is not None:
            retained = rng.permutation(retained)
            retained = retained[np.unique(self.design[retained], return_index=True)[1]]
        return np.asarray(self.score[retained])

    def rests_on(self, zones: str) -> bool:
        """Return whether pages were labelled with these zones in force, by their digest without a price.

        "" means without zones.
        """
        return zones in (self.zones or ("",))

    def too_few(self) -> RequestError:
        """Return an error: these cannot support the guarantee, and how many more are needed."""
        odds = f"one false alarm in {1 / self.rate:,.0f} good pages"
        what = f"{self.sample:.0f} pages of the random sample were labelled good, too few for {odds}"
        more = max(self.missing, 1)
        return RequestError("recalibrate", what, remedy=f"{more} more {'is' if more == 1 else 'are'} needed")

    def __str__(self) -> str:
        runs = np.unique(self.run).size
        alarms = int((~self.passed).sum())
        return (
            f"{int(self.passed.sum())} sampled pages and {alarms} false alarms, labelled by people in {runs} "
            f"{'run' if runs == 1 else 'runs'}"
        )

    # --- in a press artefact ---

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what an artefact stores as tensors."""
        stored = {name: getattr(self, name) for name in TABLE}
        return {name: array.astype(TABLE[name].dtype) for name, array in stored.items() if array is not None}

    def facts(self) -> dict[str, Any]:
        """Return the rest: what JSON can hold."""
        facts: dict[str, Any] = {
            "rate": self.rate,
            "passed_weight": self.passed_weight,
            "alarms_from": self.alarms_from,
            "replaces": self.replaces,
            "journals": list(self.journals),
            "half_life_days": self.half_life_days,
        }
        return facts | ({"zones": list(self.zones)} if self.zones else {})

    @staticmethod
    def check(arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any], *, under: str) -> None:
        """Raise Misfit unless ``from_parts`` makes of them pages that support their guarantee."""
        stated = checked(LabelledFacts, facts, under=under)
        check_arrays(arrays, TABLE, {}, under=under)
        if not 0 < stated.rate < 1:
            raise Misfit(f"{under}rate", f"is {stated.rate:g}, must be between 0 and 1")
        if stated.passed_weight < 1:
            raise Misfit(f"{under}passed_weight", f"is {stated.passed_weight:g}, must be 1 or more")
        if not math.isfinite(stated.alarms_from):
            raise Misfit(f"{under}alarms_from", "is not a finite number")
        try:
            _ = LabelledPages.from_parts(arrays, facts).threshold
        except RequestError as error:
            raise Misfit(f"{under}score", "contains too few pages for its rate") from error

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        """Build pages from ``arrays`` and ``facts`` that ``check`` has passed."""
        stored: dict[str, Any] = {name: arrays[name] for name in TABLE if name in arrays}
        stored |= {**facts, "passed": arrays["passed"].astype(bool)}
        stored |= {name: tuple(facts.get(name, ())) for name in ("journals", "zones")}
        return cls(**stored)


class LabelledFacts(Block):
    """Schema of ``LabelledPages.facts``."""

    rate: float
    passed_weight: float
    alarms_from: float
    replaces: str
    journals: tuple[str, ...]
    half_life_days: float | None
    zones: tuple[str, ...] = ()


TABLE: Final = {
    "score": ArraySpec(dtype="float64", shape=("pages",)),
    "weight": ArraySpec(dtype="float64", shape=("pages",), above=0),
    "run": ArraySpec(dtype="int64", shape=("pages",), low=1),
    "sheet": ArraySpec(dtype="int64", shape=("pages",), low=0),
    "passed": ArraySpec(dtype="uint8", shape=("pages",), low=0, high=1),
    "design": ArraySpec(dtype="int64", shape=("pages",), low=0, absent=True),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """An estimate with its interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleCounts:
    """Counts of labelled sheets: alarms, all of which are asked about, and a sample of those that passed.

    Sheets without an answer are ``unknown``; answers are taken to be missing at random within alarms and
    within the sample.
    """

    alarms: int
    alarms_good: int
    """Number of labelled alarms that were good."""
    alarms_misprints: int
    passed: int
    passed_good: int
    """Number of labelled sheets of the sample that were good."""
    passed_misprints: int

    @property
    def labelled_alarms(self) -> int:
        """Number of labelled alarms."""
        return self.alarms_good + self.alarms_misprints

    @property
    def labelled_passed(self) -> int:
        """Number of labelled sheets of the sample."""
        return self.passed_good + self.passed_misprints

    @property
    def missed(self) -> Estimate | None:
        """Misprints among the sheets that passed; None: none is labelled. Clopper and Pearson (1934)."""
        if not self.labelled_passed:
            return None
        share = self.passed_misprints / self.labelled_passed
        low, high = exact_interval(self.passed_misprints, self.labelled_passed)
        least = self.passed_misprints  # these are certain
        return Estimate(
            value=share * self.passed, low=max(low * self.passed, least), high=max(high * self.passed, least)
        )

    @property
    def false_alarms(self) -> Estimate | None:
        """Share of good sheets that alarms; None: no alarm is labelled, or no sheet of the sample.

        It is the number of labelled false alarms over good sheets in proportion, with Clopper and Pearson's
        interval, as if sheets of a day were independent and the number of good sheets were known.
        """
        if (self.alarms and not self.labelled_alarms) or (self.passed and not self.labelled_passed):
            return None
        labelled = self.labelled_alarms / self.alarms if self.alarms else 1.0
        good_passed = self.passed * self.passed_good / self.labelled_passed if self.passed else 0.0
        trials = labelled * good_passed + self.alarms_good
        if trials <= 0:
            return None
        low, high = exact_interval(self.alarms_good, trials)
        return Estimate(value=self.alarms_good / trials, low=low, high=high)


def exact_interval(hits: float, trials: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return Clopper and Pearson's (1934) interval of a share; trials need not be a whole number."""
    tail = (1 - confidence) / 2
    # scipy.stats is avoided: its import takes longer than the judgement of a page.
    low = float(special.betaincinv(hits, trials - hits + 1, tail)) if hits > 0 else 0.0
    high = float(special.betaincinv(hits + 1, trials - hits, 1 - tail)) if hits < trials else 1.0
    return low, high
