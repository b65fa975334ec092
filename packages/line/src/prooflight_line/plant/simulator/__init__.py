"""A simulated controller with a gate and two trays, for use without a real one."""
