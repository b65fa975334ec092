"""Compiled loops of the matched-filter detector: binning, moving, fitting, taking away."""
