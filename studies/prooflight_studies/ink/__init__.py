"""The study of ink."""
