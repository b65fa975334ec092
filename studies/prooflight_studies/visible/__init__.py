"""Marks that a person would see, and how many of them are caught, by kind, place and size."""
