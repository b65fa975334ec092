"""Analysis of scans on a graphics card."""
