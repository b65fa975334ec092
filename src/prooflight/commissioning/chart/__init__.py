"""Calibration of a press from the scans of a printed chart: location, reading, and the artefact."""
