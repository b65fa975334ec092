"""The press of the tests of commands."""

from tests.cli.conftest import press_file, warning_press

__all__ = ["press_file", "warning_press"]
