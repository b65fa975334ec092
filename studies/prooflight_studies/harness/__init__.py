"""The tools that the studies share."""
