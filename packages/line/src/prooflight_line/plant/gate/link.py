"""The wire to the controller: Modbus TCP, in a thread of its own, so that no verdict waits for it.

The link reconnects by itself. The module ``exchange`` defines what is sent over the wire.
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from contextlib import closing
from typing import TYPE_CHECKING, Any, Final, Protocol

from prooflight_line.plant.gate.log import PlantError
from prooflight_line.plant.gate.registers import (
    MAP_ID,
    MAP_VERSION,
    READ_FROM,
    READ_WORDS,
    RING,
    Shown,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.press.gate import PlcSettings
    from prooflight_line.plant.gate.exchange import Exchange

_log = logging.getLogger(__name__)
logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # what it says, `PlantError` says

AGAIN_S: Final = (0.1, 1.0)
"""First and longest wait before the controller is tried again."""


class Wire:
    """One connection. Its methods raise ``PlantError`` if the controller does not answer, or refuses."""

    def __init__(self, plc: PlcSettings) -> None:
        """Connect to the controller; PlantError if it cannot be reached."""
        try:
            from pymodbus.client import ModbusTcpClient
            from pymodbus.exceptions import ModbusException
        except ModuleNotFoundError as error:
            remedy = 'pip install "prooflight-line[plant]"'
            raise PlantError(plc.where, "Modbus needs pymodbus", remedy=remedy) from error
        self._plc = plc
        self._shown_words = READ_WORDS
        self._broken = ModbusException, OSError, AttributeError  # AttributeError: closed within an answer
        self._client = ModbusTcpClient(plc.host, port=plc.port, timeout=plc.timeout_ms / 1e3, retries=0)
        if not self._client.connect():  # type: ignore[no-untyped-call]
            remedy = "check that it is on, that [gate.plc] states its host and port, and that no firewall blocks them"
            raise PlantError(plc.where, "no controller answers", remedy=remedy)

    def close(self) -> None:
        """Close the connection."""
        self._client.close()  # type: ignore[no-untyped-call]

    def write(self, words: list[int]) -> None:
        """Write Prooflight's block of registers in one request."""
        self._request(self._client.write_registers, self._plc.first_register, words)

    def set_coil(self, on: bool) -> None:
        """Switch the single output."""
        self._request(self._client.write_coil, self._plc.coil, on)

    def coil(self) -> bool:
        """Return whether the single output is on."""
        return bool(self._request(self._client.read_coils, self._plc.coil, count=1).bits[0])

    def read(self) -> Shown:
        """Return what the controller shows, with its ring of trays once ``checked`` has seen that it has one."""
        try:
            return Shown.of(self.words(READ_FROM, self._shown_words))
        except ValueError as error:
            raise self._wrong(str(error)) from error

    def words(self, at: int, count: int) -> list[int]:
        """Return ``count`` registers from ``at``, counted as in the map."""
        answer = self._request(
            self._client.read_holding_registers, self._plc.first_register + at, count=count
        )
        return list(answer.registers)

    def feed(self, at: int, words: list[int]) -> None:
        """Write registers outside any plant's map, which only the simulated controller has."""
        self._request(self._client.write_registers, self._plc.first_register + at, words)

    def checked(self) -> Shown:
        """Return what the controller shows; PlantError if it does not have the register map."""
        shown = self.read()
        if (map_id := shown.values["map_id"]) != MAP_ID:
            at = self._plc.first_register + READ_FROM
            raise self._wrong(f"register {at} contains {map_id:#06x}, not {MAP_ID:#06x}")
        if (version := shown.values["map_version"]) not in (1, MAP_VERSION):
            raise self._wrong(f"its map has version {version}, this program's {MAP_VERSION}")
        self._shown_words = READ_WORDS + (RING if version > 1 else 0)
        return shown

    def _request(self, ask: Callable[..., Any], *what: Any, **more: Any) -> Any:
        try:
            answer = ask(*what, device_id=self._plc.unit, **more)
        except self._broken as error:
            ms = self._plc.timeout_ms
            raise PlantError(
                self._plc.where, f"no answer within {ms} ms", remedy="check what delays it"
            ) from error
        if answer.isError():
            raise self._wrong(f"it refuses register or coil {what[0]} ({answer})")
        return answer

    def _wrong(self, what: str) -> PlantError:
        remedy = (
            "provide the map of docs/reference/registers.md there, or set [gate.plc] first_register and unit"
        )
        return PlantError(self._plc.where, what, remedy=remedy)


class GateProtocol(Protocol):
    """Protocol of what a link does on an open wire, exchange after exchange."""

    def begin(self, wire: Wire) -> None:
        """Begin on a wire that has just been opened."""
        ...

    def turn(self, wire: Wire) -> None:
        """Do one exchange; PlantError if the wire must be opened again."""
        ...

    def end(self, wire: Wire) -> None:
        """Finish when the run is over and the wire is still open."""
        ...

    def lost(self, why: str) -> None:
        """Note that the wire broke, or could not be opened."""
        ...

    @property
    def wake(self) -> threading.Event:
        """Signal that is set when the next exchange should not wait."""
        ...


class RegisterProtocol:
    """A ``GateProtocol`` that does the handshake by registers."""

    def __init__(self, exchange: Exchange, *, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin with an exchange; ``clock`` is that of the lines."""
        self._exchange, self._clock = exchange, clock
        self.wake = exchange.wake

    def begin(self, wire: Wire) -> None:
        """Begin a session if the controller has the register map; see ``GateProtocol``."""
        shown = wire.checked()
        self._exchange.connected(shown, session=_session(shown.values["session_taken"]))

    def turn(self, wire: Wire) -> None:
        """Write the registers and read the controller's; see ``GateProtocol``."""
        wire.write(self._exchange.words())
        self._exchange.wrote()
        request_s = self._clock()
        shown = wire.read()
        if not self._exchange.answered(shown, request_s=request_s, answered_s=self._clock()):
            raise PlantError("PLC", "its heartbeat has stopped", remedy="check whether it runs")
        if self._exchange.dropped(session=_session(shown.values["session_taken"], self._exchange.session)):
            self.wake.set()

    def end(self, wire: Wire) -> None:
        """Write 0 to all registers, which reports that Prooflight has gone; see ``GateProtocol``."""
        wire.write([0] * len(self._exchange.words()))

    def lost(self, why: str) -> None:
        """Report the loss to the exchange; see ``GateProtocol``."""
        self._exchange.lost(why)


class PlcLink:
    """Thread that keeps the protocol running, and reconnects whenever the controller is lost."""

    def __init__(
        self,
        plc: PlcSettings,
        protocol: GateProtocol,
        *,
        open_wire: Callable[[PlcSettings], Wire] = Wire,
        pace: float = 1.0,
    ) -> None:
        """Prepare the link; with ``pace``, which studies use, it runs so many times faster than its settings."""
        self._plc, self._protocol, self._open, self._pace = plc, protocol, open_wire, pace
        self.closing = threading.Event()
        """Event that is set when the link is to end."""
        self._thread = threading.Thread(target=self._run, name="plc", daemon=True)

    def start(self) -> None:
        """Start the thread and return at once."""
        self._thread.start()

    def close(self) -> None:
        """Finish with the controller if it answers, and end the thread."""
        self.closing.set()
        self._protocol.wake.set()
        self._thread.join()

    def _run(self) -> None:
        wait_s = AGAIN_S[0]
        while not self.closing.is_set():
            try:
                with closing(self._open(self._plc)) as wire:
                    self._protocol.begin(wire)
                    wait_s = AGAIN_S[0]
                    self._turns(wire)
            except PlantError as error:
                self._protocol.lost(error.what)
            except Exception as error:  # whatever it is, the gate must be tried again
                _log.exception("the link to the controller")
                self._protocol.lost(str(error))
            self.closing.wait(wait_s / self._pace)
            wait_s = min(2 * wait_s, AGAIN_S[1])

    def _turns(self, wire: Wire) -> None:
        wake = self._protocol.wake
        while not self.closing.is_set():
            wake.clear()
            self._protocol.turn(wire)
            wake.wait(self._plc.cycle_ms / 1e3 / self._pace)
        self._protocol.end(wire)


def _session(*taken: int) -> int:
    """Draw a number for a session that is none of these, nor 0.

    The operating system draws it, because a restart must not repeat it.
    """
    while (drawn := secrets.randbelow(0xFFFF) + 1) in taken:
        pass
    return drawn
