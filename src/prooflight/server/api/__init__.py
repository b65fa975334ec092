"""The interface for programs, under /api/v1."""

from prooflight.server.api import audit, events, incidents, people, press, runs, session, sheets, zones

ROUTERS = (
    *(session.router, runs.router, sheets.router, incidents.router, press.router),
    *(events.router, people.router, audit.router, zones.router),
)
