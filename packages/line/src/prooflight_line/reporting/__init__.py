"""The state of a run and of a camera, for people."""
