"""Inspection of scans of office scanners: found, brought to the press's pixels, and fitted in tone, page by page."""
