"""Ink on paper: spectral reflectance of a printed recipe (paper, section 3.3, equation 1)."""
