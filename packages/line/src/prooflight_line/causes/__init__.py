"""Causes of a run's defects: repeat distances, nozzles, drifts, corrections, and the roll map."""
