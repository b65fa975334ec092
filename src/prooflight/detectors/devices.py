"""Where images of scans are computed: on the processor, or on a graphics card."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from prooflight.detectors.base import Device

REMEDY: Final = "leave it out, or install prooflight[gpu] on a machine with an NVIDIA card and its driver"


def engine_name(device: Device) -> str:
    """Return the name of what computes: cpu, or gpu with the card's name and the version of its driver."""
    if device == "cpu":
        return "cpu"
    from prooflight.kernels.gpu.runners import card_name

    return f"gpu: {card_name()}"


def refuse_without_card() -> None:
    """Raise RequestError where no card can be used."""
    from prooflight.kernels.gpu.runners import lacking

    if (lacks := lacking()) is not None:
        raise RequestError("--device gpu", lacks, remedy=REMEDY)
