"""Inspection of one job against its scans, and the repetition of a verdict from stored evidence."""
