"""Jobs that come as files into a hot folder: checked, prepared, and queued for a press."""
