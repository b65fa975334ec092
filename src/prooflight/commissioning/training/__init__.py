"""A detector trained on simulated and real prints."""

from typing import Final

DESIGNS: Final = 136
"""Number of designs that are printed for the matched-filter detector alone where none is given."""
