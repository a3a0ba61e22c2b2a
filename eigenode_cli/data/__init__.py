"""Data: what was observed, what is known, and how it is simulated."""
