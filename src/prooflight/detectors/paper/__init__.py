"""The paper's detectors: chi-square and Bayesian network (sections 4.1 to 4.4)."""
