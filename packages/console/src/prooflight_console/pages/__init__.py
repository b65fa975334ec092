"""The pages for people."""

from prooflight_console.pages import (
    alarms,
    assets,
    camera,
    incident,
    now,
    press,
    presses,
    provider,
    queue,
    report,
    reprint,
    search,
    setup,
    sign_in,
    zones,
)

ROUTERS = (
    *(assets.router, sign_in.router, provider.router),
    *(now.router, incident.router, alarms.router, reprint.router, queue.router),
    *(report.router, search.router, press.router, presses.router, setup.router, camera.router, zones.router),
)
