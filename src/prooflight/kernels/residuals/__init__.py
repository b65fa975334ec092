"""Compiled loops of the matched-filter detector: binning, displacement, fit and subtraction."""
