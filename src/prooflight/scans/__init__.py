"""Where lines come from: the geometry of a scan, and recorded scans."""
