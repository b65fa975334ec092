"""The study of resolution: PDFs printed at another resolution than that of the expected raster."""
