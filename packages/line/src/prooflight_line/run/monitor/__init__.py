"""Monitoring of a run by control charts of inks, register and streaks, for changes too small for one page to show."""
