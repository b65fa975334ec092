"""Work on the workers of a Dask cluster, on this machine or on several; they need no common disk."""
