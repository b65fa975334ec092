"""Prediction of a scan: a page's raster is looked up, filtered and sampled as by the camera (paper, section 3.4)."""
