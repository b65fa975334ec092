"""A printed chart's scans: found, read, and made a press."""
