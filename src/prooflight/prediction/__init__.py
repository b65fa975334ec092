"""Numbers without light: the page's raster looked up, filtered and sampled as the camera would (paper, section 3.4)."""
