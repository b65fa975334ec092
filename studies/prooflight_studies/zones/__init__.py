"""Zones: what they cost as foretold and as it came, and whether the promise holds with them."""
