"""Comparison of scans with the page itself, drawn as an office scanner would show a good print of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.base import Inspection, PreparedOnly
from prooflight.detectors.golden.chain import SignalChain, grown_light, light_of, to_numbers
from prooflight.detectors.golden.detector import Golden, GoldenDetector, GoldenSheet, PictureDetector
from prooflight.detectors.placing import WRONG_PAGE_KIND
from prooflight.detectors.verdict import Verdict
from prooflight.errors import RequestError
from prooflight.scans.scan import Scan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import PlannedPage
    from prooflight.prediction.tables import SensorModel

NAME: Final = "drawn"
GUARANTEE: Final = "none: docs/results/detector/real.md says how often sheets of two real copies alarm"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnDetector(PictureDetector):
    """Detector that compares with the page as the chain of a scanner would show it."""

    chains: Mapping[str, SignalChain]
    """Chains by page name; under the empty name: of every page that has none of its own."""
    name: str = NAME
    guarantee: str = GUARANTEE

    def prepare(self, planned: PlannedPage) -> DrawnSheet:
        """See ``Detector``; RequestError: nothing states the chain of this page."""
        page = planned.page
        chain = self.chains.get(page.name) or self.chains.get("")
        if chain is None:
            remedy = "scan more of its pages, or choose --detector matched_filter"
            raise RequestError(page.name, "no sheet tells how its scanner shows print", remedy=remedy)
        numbers = chain.numbers(grown_light(page, self.press_context), page.pixel_mm)
        golden = Golden(name=page.name, light=numbers, spread=chain.spread(numbers))
        pictures = replace(
            self.press_context, sensors=()
        )  # the drawn page is compared with numbers, not with light
        sheet = GoldenDetector(press_context=pictures, goldens={page.name: golden}).prepare(planned)
        return DrawnSheet(golden=sheet, sensors=self.press_context.sensors, expected=planned)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnSheet(PreparedOnly):
    """One page as its scan should look."""

    golden: GoldenSheet
    sensors: tuple[SensorModel, ...]
    expected: PlannedPage

    def inspect(self, scan: Scan, *, seed: int = 0) -> Inspection:
        """See ``PreparedPage``. A scan that cannot be laid on its page is not inspected."""
        numbers: NDArray[np.float32] = to_numbers(light_of(scan.dn, self.sensors))
        done = self.golden.inspect(Scan(dn=numbers, name=scan.name))
        verdict = done.verdict
        if verdict.kind == WRONG_PAGE_KIND:
            verdict = Verdict.skipped(verdict.page, f"the page could not be placed: {verdict.reason}")
            verdict = replace(verdict, detector=NAME)
        else:
            reason = verdict.reason.replace("the golden", "the page").replace("its golden", "its page")
            verdict = replace(verdict, detector=NAME, reason=reason)
        planned = self.expected
        return replace(
            done, verdict=verdict, measured_dn=scan.dn[:, *done.area], expect=lambda: planned.expected
        )
