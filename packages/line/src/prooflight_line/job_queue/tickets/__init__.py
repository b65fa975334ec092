"""Job tickets, XJDF 2.x and JDF 1.x: what the order of a job says beside its file."""
