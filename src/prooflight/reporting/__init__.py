"""Verdicts and studies -> what a person reads."""
