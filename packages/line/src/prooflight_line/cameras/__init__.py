"""Line cameras: discovery, control, and endless lines with an account of all losses."""
