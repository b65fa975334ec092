"""What a package registers of a detector, and what training found for it: the contract outside a run.

``detectors.base`` holds what a detector does with pages, ``detectors.optional`` what it may do besides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import Detector, PressContext
    from prooflight.detectors.cost import RunningCosts
    from prooflight.pages.parallel import Processes

Item = TypeVar("Item")


class TrainedModel(Protocol):
    """What training found for one detector on one press; the press artefact stores it under the detector's name."""

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Return what the artefact stores as tensors."""
        ...

    def facts(self) -> Mapping[str, Any]:
        """Return the rest: what JSON can hold."""
        ...

    @staticmethod
    def check(
        arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any], *, sensors: int, under: str = ""
    ) -> None:
        """Raise ``files.schema.Misfit`` unless ``from_parts`` makes a model of them for so many sensors.

        under: prefix of their names in the error.
        """
        ...

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        """Build the model from ``arrays`` and ``facts`` that ``check`` has passed."""
        ...


class DetectorPress(Protocol):
    """What a detector is made from: the part of ``press.artefact.Press`` that it may read."""

    @property
    def name(self) -> str:
        """Name of the press."""
        ...

    @property
    def costs(self) -> RunningCosts:
        """Costs of its owner."""
        ...

    @property
    def good_pages_per_false_alarm(self) -> float:
        """Inverse of the target false-alarm rate."""
        ...

    @property
    def detectors(self) -> Mapping[str, TrainedModel]:
        """Models of the detectors that were trained for it, by the detector's name."""
        ...

    def press_context(self, threads: int | None = None) -> PressContext:
        """Return the part of the press that a detector needs while it inspects."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """How `press build` asks for detectors to be trained."""

    designs: int
    """Number of page designs to print."""
    seed: int
    false_alarm_rate: float
    progress: Callable[[str], None] = lambda _step: None
    """Called with the name of each step."""
    shown: Callable[[Iterable[Any], int, str], Iterator[Any]] = lambda items, _total, _what: iter(items)
    """Passes items on as they are consumed and shows how many of how many are done."""
    processes: Processes = None
    """Processes or workers that print designs."""


Train = Callable[[Any, Sequence[str], Training], Mapping[str, TrainedModel]]
"""Function that trains the detectors of these names for a ``Press`` and returns their models; RequestError."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A detector as it is registered. A detector without a model may be registered by ``detector`` alone."""

    detector: Callable[[DetectorPress], Detector]
    """Makes the detector for a press, which holds its model if it has one."""
    model: type[TrainedModel] | None = None
    """Type of its model; None: it needs no training."""
    train: str = ""
    """``Train`` that trains it, as ``package.module:function``.

    It is a name because training prints on the simulated press, which lies above detectors.
    """
    family_text: Callable[[str], str | None] = lambda _family: None
    """Describes a family of evidence (``Verdict.family``); None: there are no words for it."""
