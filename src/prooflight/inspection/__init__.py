"""One job against its scans; a verdict made again."""
