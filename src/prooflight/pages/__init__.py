"""Pages to be printed, as CMYK rasters, and the jobs that they come from."""
