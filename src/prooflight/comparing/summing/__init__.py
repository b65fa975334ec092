"""Compiled loops of the comparison in the press world: residuals, block means and sums over tiles."""
