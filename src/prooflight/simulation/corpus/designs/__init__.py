"""Composed page designs like the work of a digital press, drawn at random, straight into CMYK rasters.

Every length is in millimetres and every type size in points until the moment of drawing, and nothing is drawn
at random while pixels are counted: a design has the same layout, words and pictures at any resolution.
"""
