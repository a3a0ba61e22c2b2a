"""Data: what was measured, what is known of the initial state and of the spectrum, and how both are simulated."""
