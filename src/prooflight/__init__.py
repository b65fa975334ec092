"""Prooflight: predict what a line camera must see of a printed page, compare, decide.

Read the packages in the order of the light: pages, printing, sensing, acquiring, predicting, comparing, deciding.
"""

__version__ = "0.2.0"
