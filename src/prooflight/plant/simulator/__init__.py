"""A controller with a gate and two trays, for whoever has none."""
