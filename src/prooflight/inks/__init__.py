"""Ink on paper: what spectrum a printed recipe reflects (paper, section 3.2, equation 1)."""
