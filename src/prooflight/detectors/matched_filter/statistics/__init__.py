"""What is left of a scan, as statistics with a place."""
