"""Engines: what computes the loss Jacobian."""
