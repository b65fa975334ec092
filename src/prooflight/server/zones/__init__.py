"""Zones drawn in the console: pages of a job to draw on, what they propose, the price, and saving."""
