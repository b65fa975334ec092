"""Imposition of a job on sheets: sides, positions of pages on them, sets, and the order in which sides pass."""
