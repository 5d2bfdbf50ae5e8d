"""Numerical kernels that several baselines share."""
