"""What computes the matched filter's images: the processor, or a graphics card."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.detectors.matched_filter.scan_images import HostImages

if TYPE_CHECKING:
    from prooflight.detectors.base import Device
    from prooflight.detectors.matched_filter.scan_images import Engine


def engine_of(device: Device) -> Engine:
    """Return what computes the images of a scan; CUDA is loaded when a card is asked for."""
    if device == "cpu":
        return HostImages
    from prooflight.detectors.matched_filter.card_images import card_engine

    return card_engine()
