"""Scans of office scanners: pages of PDF, TIFF, JPEG and PNG files, converted to linear light."""
