"""The matched-filter detector as it is registered."""

from __future__ import annotations

from typing import Final, cast

from prooflight.detectors.entry import DetectorPress, Entry
from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
from prooflight.detectors.matched_filter.detector import MatchedFilterDetector
from prooflight.detectors.matched_filter.naming import family_text
from prooflight.detectors.matched_filter.statistics.statistic import Statistic
from prooflight.errors import RequestError

NAME: Final = "matched_filter"


def model_of(press: DetectorPress) -> CalibratedDetector:
    """Return this detector's model on a press; RequestError: the press was not trained with it."""
    if NAME not in press.detectors:
        what = f"{press.name} was not trained for {NAME!r}"
        raise RequestError("press", what, remedy="build it with `prooflight press build --detector quick`")
    return cast("CalibratedDetector", press.detectors[NAME])


ENTRY: Final = Entry(
    detector=lambda press: MatchedFilterDetector(
        press_context=press.press_context(), calibrated=model_of(press)
    ),
    model=CalibratedDetector,
    train="prooflight.commissioning.training.cache:trained_models",
    family_text=lambda family: family_text(Statistic.parse(family).label),
)
