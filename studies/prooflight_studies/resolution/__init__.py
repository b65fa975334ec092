"""PDFs printed at another resolution than the one at which they were expected."""
