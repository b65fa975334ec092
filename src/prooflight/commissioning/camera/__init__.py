"""A camera measured: from its exposures to the sensor block of a press file."""
