"""Work of one command on many worker processes: what it costs, whether it changes a bit, and what a plant needs."""
