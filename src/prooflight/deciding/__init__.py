"""Evidence to verdict: let it pass, or stop (paper, sections 4 and 5)."""
