"""Corrections that are offered, as nodes of the OPC UA server: read by a client, and never applied from here.

They are no part of OPC 40100-1, and have a namespace of their own. Under the press stands ``Corrections``, with an
object for the density and for each register of an ink, whose variables are those of ``FIELDS``.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, Final

from asyncua import ua

from prooflight.cmyk import NAME_OF_INK
from prooflight_line.plant.events import RunStarted
from prooflight_line.run.monitor.corrections import INK_CHANNELS, SHEETS, correction_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from asyncua.common.node import Node
    from asyncua.server.server import Server

    from prooflight_line.plant.events import SheetJudged
    from prooflight_line.run.monitor.corrections import Correction

URI: Final = "urn:prooflight:corrections"
FIELDS: Final = (
    ("Deviation", ua.VariantType.Double),
    ("StandardDeviation", ua.VariantType.Double),
    ("Offset", ua.VariantType.Double),
    ("Unit", ua.VariantType.String),
    ("Sheets", ua.VariantType.UInt32),
    ("FirstSheet", ua.VariantType.UInt32),
    ("LastSheet", ua.VariantType.UInt32),
)
"""Variables of a correction: mean deviation of the latest sheets and its standard deviation, the offset that is offered
(0: none), their unit, the number of sheets that they rest on (0: too few, and nothing else counts), and which."""


class OfferedCorrections:
    """The ``Corrections`` of a press."""

    def __init__(self, server: Server, nodes: dict[tuple[str, str], Node]) -> None:
        self._server, self._nodes = server, nodes
        self._measured = {channel.name: deque[tuple[int, float]](maxlen=SHEETS) for channel in INK_CHANNELS}

    @classmethod
    async def begin(cls, server: Server, press: Node) -> OfferedCorrections:
        """Add the nodes under the press, without an offer."""
        index = await server.register_namespace(URI)
        folder = await press.add_folder(index, "Corrections")
        nodes = {}
        for channel in INK_CHANNELS:
            own = await folder.add_object(index, channel.name)
            for field, kind in FIELDS:
                value = channel.unit if field == "Unit" else ua.get_default_value(kind)
                nodes[channel.name, field] = await own.add_variable(index, field, value, kind)
        return cls(server, nodes)

    async def note(self, event: RunStarted | SheetJudged) -> None:
        """Offer anew after a sheet; a run begins without an offer."""
        if isinstance(event, RunStarted):
            for name, measured in self._measured.items():
                measured.clear()
                await self._write(name, "Sheets", 0)
            return
        values = dict(_measured(event))
        for channel in INK_CHANNELS:
            if channel.name not in values:
                continue
            self._measured[channel.name].append((event.sheet, values[channel.name]))
            offer = correction_of(channel, list(self._measured[channel.name]))
            if offer is not None:
                await self._offer(offer)

    async def _offer(self, offer: Correction) -> None:
        name, scale = offer.channel.name, offer.channel.scale
        values = {
            "Deviation": scale * offer.deviation,
            "StandardDeviation": scale * offer.sd,
            "Offset": scale * offer.offset,
            "FirstSheet": offer.first_sheet,
            "LastSheet": offer.last_sheet,
            "Sheets": offer.sheets,
        }
        for field, value in values.items():
            await self._write(name, field, value)

    async def _write(self, channel: str, field: str, value: Any) -> None:
        variant = ua.Variant(value, dict(FIELDS)[field])
        await self._server.write_attribute_value(self._nodes[channel, field].nodeid, ua.DataValue(variant))


def _measured(sheet: SheetJudged) -> Iterator[tuple[str, float]]:
    """Yield name and deviation of each channel that was measured on a sheet, in the channel's own unit."""
    for one in sheet.inks:
        ink = NAME_OF_INK[one.ink]
        gain = None if one.gain_percent is None else one.gain_percent / 100
        of_ink = (
            (f"gain-{ink}", gain),
            (f"register-{ink}-x", one.register_x_mm),
            (f"register-{ink}-y", one.register_y_mm),
        )
        for name, value in of_ink:
            if value is not None:
                yield name, value
