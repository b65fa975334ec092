"""The page docs/reference/registers.md for a controller's programmer, from the tables that the program uses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from prooflight_line.plant.gate.deciding import CODE_TEXTS
from prooflight_line.plant.gate.handshake import HANDSHAKE, State
from prooflight_line.plant.gate.registers import READ, READ_WORDS, RING, RING_FROM, WRITTEN, Fault, Result

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from prooflight_line.plant.gate.registers import Register

STATES: Final = {
    State.AWAY: "no connection, or no answer in time; it is tried again",
    State.JOINING: "connected; the controller has not yet taken this session",
    State.ALIGNING: "the session is taken; count and lines do not yet go together",
    State.READY: "results are written, one by one",
}
FAULTS: Final = {
    Fault.NONE: "none",
    Fault.ENCODER: "encoder count and camera lines do not go together",
    Fault.NOT_TAKEN: "the controller has not taken the session",
    Fault.PLC_HEARTBEAT: "`plc_heartbeat` stands still",
}
RESULTS: Final = {
    Result.ACCEPT: "accept",
    Result.DIVERT: "divert",
    Result.STOP: "divert, and stop the press",
}
LADDER: Final = """\
(* Once a scan. In: the block that Prooflight writes. Eye: rising edge of the gate's photo-eye, with the encoder's count
   latched at that edge. Out: gate_open, press_stop. Store: 32 results {used, tag, result, position, tolerance}. *)

plc_heartbeat := plc_heartbeat + 1;
encoder := high_speed_counter;

IF heartbeat <> heartbeat_seen THEN          (* watchdog *)
    heartbeat_seen := heartbeat;
    alive_timer(IN := FALSE, PT := T#500ms);
    alive := TRUE;
END_IF;
alive_timer(IN := TRUE);
IF alive AND alive_timer.Q THEN
    alive := FALSE;
    forget_all_results();
    session_dropped := session_taken;
    session_taken := 0;                      (* this session is over: another must begin *)
END_IF;

IF alive AND session <> session_taken AND session <> session_dropped THEN
    forget_all_results();                    (* another start, or another connection *)
    session_taken := session;
    result_taken := 0;
    press_stop := FALSE;
END_IF;

IF alive AND session = session_taken AND session <> 0 THEN
    policy_kept := policy;
    IF status.5 THEN press_stop := TRUE; END_IF;
    IF status.2 AND result_number <> result_taken THEN
        store(tag, result, position, tolerance);
        result_taken := result_number;       (* the acknowledgement *)
    END_IF;
END_IF;

IF eye THEN                                  (* a sheet is at the gate *)
    found := results_within_tolerance_of(eye_count);
    IF found.count = 1 THEN
        gate_open := (found.result = 1);
        last_tag := found.tag;
    ELSE                                     (* none, or two: doubt *)
        gate_open := (policy_kept = 1);
        IF policy_kept = 2 THEN press_stop := TRUE; END_IF;
        last_tag := 0;
    END_IF;
    last_tray := SEL(gate_open, 2, 1);
    short_tag := SEL(last_tag > 0, 0, (last_tag - 1) MOD 16383 + 1);
    trays[sheets_at_gate MOD 64] := short_tag * 4 + last_tray;
    sheets_at_gate := sheets_at_gate + 1;
    forget_results_up_to(eye_count + tolerance);
END_IF;
"""


def register_page() -> str:
    """Return the text of the page."""
    return f"""\
# The gate's registers

Written by `python -m docs.generators.plant` from the tables that Prooflight itself goes by
(`prooflight_line.plant.gate.registers`, `prooflight_line.plant.gate.handshake`).
How to use a gate: [how-to](../how-to/gate.md).
Why it is built so: [decision 26](../explanation/decisions/plant-and-console/0026-gate.md).

Prooflight is the Modbus TCP client, the controller the server. Registers are holding registers. Addresses here count
from `first_register` of `[gate.plc]`, as the protocol counts: 0 is what many controllers call 40001. A number of two
registers has its high word first. All that Prooflight writes it writes in one request (function 16, {_words(WRITTEN)}
registers), and all that it reads it reads in one (function 3, {READ_WORDS + RING} registers): neither is ever seen in
halves where the controller takes requests between two scans.

## What Prooflight writes

{_table(WRITTEN)}

## What the controller shows

{_table(READ)}

## The trays of the last {RING} sheets

Registers {RING_FROM} to {RING_FROM + RING - 1} are a ring `trays`, one register a sheet, so that none is missed between
two exchanges: sheet number n at the gate, from 1, is in `trays[(n - 1) MOD {RING}]`. Bits 0 and 1 are its tray as in
`last_tray`; bits 2 to 15 its tag as `(tag - 1) MOD 16383 + 1`, or 0 if no result was found for it. A controller without
the ring shows `map_version` 1: of two sheets between two exchanges it then reports the second alone.

## Results and codes

| `result` | says |
|---|---|
{_numbered(RESULTS)}

| `code` | why |
|---|---|
{_numbered(CODE_TEXTS)}

| `fault` | says |
|---|---|
{_numbered(FAULTS)}

## The handshake

![The handshake](../results/running/gate-handshake.png)

| state | says |
|---|---|
{_rows((state.value, what) for state, what in STATES.items())}

| from | when | to |
|---|---|---|
{_rows((one.state.value, one.event.value, one.then.value) for one in HANDSHAKE)}

1. Prooflight connects, looks for `map_id`, and writes a `session` that the controller has not seen.
2. The controller forgets all results, and copies `session` to `session_taken`.
3. Prooflight lays the encoder's count beside the camera's lines for a second or so. Then `status` says ready.
4. Of each sheet it writes `tag`, `result`, `code` and `position`, with the next `result_number`. They stay until
   `result_taken` is that number. The next result follows.
5. Either side counts its heartbeat. Where the other's stands still for `heartbeat_ms`, the controller forgets all
   results and sets `session_taken` to 0, and Prooflight connects again. A new session begins, and Prooflight writes
   once more the results of all sheets that have not reached the gate.

A result is of a place, not of a turn: the controller takes the one whose `position` lies within `tolerance` counts of
the encoder's count when a sheet reaches the eye. A sheet that the camera did not see has no result, and a result that
comes late meets no sheet; neither moves the results of others.

## The controller's ladder

```text
{LADDER}```

`prooflight plant simulate` plays this ladder, so a controller's program can be compared with it.

## One output

With `style = "coil"` there are no registers. Prooflight writes one coil (function 5) every `cycle_ms`: on while a sheet
passes the gate that is accepted, off for all others. The output must fall off by itself when nobody has written it for
`heartbeat_ms`; couplers call this a watchdog.
"""


def _words(registers: tuple[Register, ...]) -> int:
    return registers[-1].at + registers[-1].words - registers[0].at


def _table(registers: tuple[Register, ...]) -> str:
    head = "| register | name | bits | what |\n|---|---|---|---|\n"
    return head + _rows(
        (
            f"{one.at}" if one.words == 1 else f"{one.at}, {one.at + 1}",
            f"`{one.name}`",
            16 * one.words,
            one.what,
        )
        for one in registers
    )


def _numbered(words: Mapping[Any, str]) -> str:
    return _rows((int(number), text) for number, text in words.items())


def _rows(rows: Iterable[tuple[object, ...]]) -> str:
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)
