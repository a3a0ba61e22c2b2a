"""Training: stages, updates, optimizers, the loop."""
