"""Composed page designs: what a digital press prints, drawn by chance, straight into CMYK rasters.

Every length is in millimetres and every type size in points until the moment of drawing, and nothing is drawn by
chance while pixels are counted: a design has the same layout, words and pictures at any resolution.
"""
