"""Train NeuralODEs with knowledge about the eigenvalues of the learned system."""

__version__ = "0.1.0"
