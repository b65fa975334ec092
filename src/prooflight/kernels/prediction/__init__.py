"""Compiled loops of prediction: look up, filter, sample, correct."""
