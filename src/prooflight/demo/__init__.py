"""The demonstration: a job that the project makes itself, printed and inspected on the simulated press."""
