"""The running press: scans against their pages, one verdict each."""
