"""Commands on jobs: printing, scanning, inspection; their zones and codes; the demonstration."""
