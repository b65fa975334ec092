"""The paper's two detectors as they are registered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, cast

from prooflight.detectors.entry import DetectorPress, Entry
from prooflight.detectors.paper.bayes import BayesDetector
from prooflight.detectors.paper.chi_square import ChiSquare
from prooflight.detectors.paper.detector import PaperDetector

if TYPE_CHECKING:
    from prooflight.detectors.base import Detector


def _chi_square(press: DetectorPress) -> Detector:
    test = ChiSquare(
        good_pages_per_false_alarm=press.good_pages_per_false_alarm, misprint_rate=press.costs.misprint_rate
    )
    return PaperDetector(press_context=press.press_context(), test=test)


def _bayes(press: DetectorPress) -> Detector:
    return PaperDetector(
        press_context=press.press_context(), test=cast("BayesDetector", press.detectors["bayes"])
    )


CHI_SQUARE: Final = Entry(detector=_chi_square)
BAYES: Final = Entry(
    detector=_bayes, model=BayesDetector, train="prooflight.commissioning.training.cache:trained_models"
)
