"""A press made ready: physics to tables, a camera's columns calibrated, one artefact written."""
