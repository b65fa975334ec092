"""Measurements on a ruler page in a scan: position, pitches, sharpness, light and planes.

The functions are pure, on arrays.
"""
