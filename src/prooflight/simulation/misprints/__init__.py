"""Misprints: what goes wrong on a press, with the place where it did."""
