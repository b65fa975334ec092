"""Nuisances and misprints that no detector is taught by, and what scans say of them: for judging alone."""
