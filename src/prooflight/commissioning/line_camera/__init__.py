"""A line camera that is plugged in: what it shows now, and how it is set up step by step."""
