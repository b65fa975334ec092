"""A detector trained on simulated and real prints."""

from typing import Final

DESIGNS: Final = 136
"""Printed for our detector alone where nobody says how many."""
