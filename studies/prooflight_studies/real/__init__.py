"""Real copies of a paper, scanned on an office feeder and inspected by the drawn way."""
