"""What a short separable footprint misses of a round and endless lens, put back at the camera's own resolution."""
