"""The journal of a press: every verdict, and the evidence for it."""
