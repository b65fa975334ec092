"""Commands on jobs: printed, scanned, inspected; their zones and codes; the demonstration."""
