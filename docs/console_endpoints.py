"""Writes reference/console-endpoints.md: every endpoint of the console, and who may ask it."""

from __future__ import annotations

import tempfile
from pathlib import Path

from prooflight.server.app import console_app
from prooflight.server.endpoints import endpoints_page
from prooflight.server.settings import ConsoleSettings


def main() -> None:
    """Make a console of nothing, and list what it answers."""
    page = Path(__file__).parent / "reference" / "console-endpoints.md"
    with tempfile.TemporaryDirectory() as folder:
        app = console_app(ConsoleSettings.of(Path(folder) / "journal.sqlite"))
        page.write_text(endpoints_page(app))
    print(page)


if __name__ == "__main__":
    main()
