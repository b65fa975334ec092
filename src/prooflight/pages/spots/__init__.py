"""Spot inks: their spectra as jobs and files beside them state them, and what a press prints of them."""
