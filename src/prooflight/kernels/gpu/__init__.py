"""Loops of an inspection by place: each runs as a CUDA kernel, or as a plain loop for reference."""
