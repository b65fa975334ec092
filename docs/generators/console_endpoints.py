"""Write reference/console-endpoints.md: every endpoint of the console, and who may ask it.

Run ``python -m docs.generators.console_endpoints`` in the root of the repository.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prooflight_console.access import endpoint_rows
from prooflight_console.app import console_app
from prooflight_console.settings import ConsoleSettings

if TYPE_CHECKING:
    from fastapi import FastAPI

HEAD: Final = """# Endpoints of the console

Made by `python -m docs.generators.console_endpoints` from the application itself; a test compares.
An endpoint that names no role is refused when the console is made. Each of viewer, operator, engineer, admin may all
that the one before may. `open` asks for nobody. A token needs the scope as well; none will do where there is a dash.

| method | path | role | scope of a token |
|---|---|---|---|
"""


def endpoints_page(app: FastAPI) -> str:
    """Return the text of ``docs/reference/console-endpoints.md``."""
    rows = [
        f"| {method} | `{path}` | {role} | {scope} |\n" for method, path, role, scope in endpoint_rows(app)
    ]
    return HEAD + "".join(rows)


def main() -> None:
    """Make a console of nothing, and list what it answers."""
    page = Path(__file__).parents[1] / "reference" / "console-endpoints.md"
    with tempfile.TemporaryDirectory() as folder:
        app = console_app(ConsoleSettings.of(Path(folder) / "journal.sqlite"))
        page.write_text(endpoints_page(app))
    print(page)


if __name__ == "__main__":
    main()
