"""What should be printed: pages as CMYK rasters, and the jobs they come from."""
