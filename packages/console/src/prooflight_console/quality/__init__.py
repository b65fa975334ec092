"""Quality of print over all runs: an index of the journal, search, Pareto charts, and trends."""
