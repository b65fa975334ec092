"""Misprints of a press, with their places."""
