"""Characterisation of a camera: from its exposures to the sensor block of a press file."""
