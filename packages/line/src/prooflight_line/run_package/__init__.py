"""A run as a report in PDF, and as one signed archive with all that its verdicts rest on."""
