"""Zones on the pages of a job: what is not judged, and what is judged with a share of the promise of its own."""
