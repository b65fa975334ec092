"""Statistics of the residuals of a scan, each with its place."""
