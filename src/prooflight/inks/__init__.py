"""Ink on paper: what spectrum a printed recipe reflects (paper, section 3.3, equation 1)."""
