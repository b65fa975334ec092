"""The ranking that Prooflight ships: learned once, from simulated prints."""
