"""The interface for programs, under /api/v1."""

from prooflight_console.api import (
    alarms,
    audit,
    events,
    gate,
    incidents,
    monitoring,
    people,
    press,
    queue,
    runs,
    session,
    sheets,
    tolerances,
    zones,
)

ROUTERS = (
    *(session.router, runs.router, sheets.router, incidents.router, alarms.router, press.router, gate.router),
    *(events.router, people.router, audit.router, zones.router, tolerances.router),
    *(queue.router, monitoring.router),
)
