"""What good prints do anyway: fitted to a scan, and taken out of it."""
