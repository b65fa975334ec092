"""Line cameras: found, opened, asked what they can do, and read as endless lines, whatever is lost on the way."""
