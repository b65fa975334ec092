"""The pages for people."""

from prooflight_console.pages import (
    alarms,
    assets,
    camera,
    engineering,
    history,
    incident,
    kiosk,
    now,
    press,
    presses,
    provider,
    quality,
    queue,
    recalculation,
    report,
    reprint,
    search,
    setup,
    sign_in,
    zones,
)

ROUTERS = (
    *(assets.router, sign_in.router, kiosk.router, provider.router),
    *(now.router, incident.router, alarms.router, reprint.router, queue.router),
    *(report.router, search.router, recalculation.router, quality.router, history.router),
    *(press.router, engineering.router, presses.router, setup.router, camera.router, zones.router),
)
