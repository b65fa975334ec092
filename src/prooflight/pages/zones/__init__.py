"""Zones on the pages of a job: areas that are ignored, and areas that are tested with a false-alarm rate of
their own.
"""
