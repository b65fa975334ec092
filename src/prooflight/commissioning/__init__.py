"""Commissioning of a press: tables from physics, calibration of a camera's columns, and the artefact."""
