"""The study of stress: nuisances and misprints on which no detector is trained, for evaluation only."""
