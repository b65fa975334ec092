"""Zones drawn in the console: pages of a job to draw on, proposals, prices, and saving."""
