"""Sources of scan lines: the geometry of a scan, line cameras, and recorded scans."""
