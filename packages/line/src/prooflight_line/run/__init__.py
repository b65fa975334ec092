"""Inspection of a running press: a continuous stream of lines in, one verdict per sheet out."""
