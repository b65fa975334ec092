"""The table of endpoints and of who may call them, as a document."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from prooflight.server.access import endpoint_rows

if TYPE_CHECKING:
    from fastapi import FastAPI

HEAD: Final = """# Endpoints of the console

Made by `python docs/console_endpoints.py` from the application itself; a test compares. An endpoint that names no role
is refused when the console is made. Each of viewer, operator, engineer, admin may all that the one before may. `open`
asks for nobody. A token needs the scope as well, and none will do where there is a dash.

| method | path | role | scope of a token |
|---|---|---|---|
"""


def endpoints_page(app: FastAPI) -> str:
    """Return the text of ``docs/reference/console-endpoints.md``."""
    rows = [
        f"| {method} | `{path}` | {role} | {scope} |\n" for method, path, role, scope in endpoint_rows(app)
    ]
    return HEAD + "".join(rows)
