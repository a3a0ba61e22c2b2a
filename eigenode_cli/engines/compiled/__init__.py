"""The compiled engine: solve, sensitivities, spectra and terms of a multilayer perceptron, fused by Numba."""
