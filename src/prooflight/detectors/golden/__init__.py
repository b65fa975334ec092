"""Comparison of scans with a golden scan, one that a person took for good."""
