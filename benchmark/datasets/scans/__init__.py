"""Simulated scans of random bodies, for training networks on complete surfaces.

Suggested reading order: ``surfaces`` (fused parts, other triangulations), ``noise`` (misaligned views, noise, holes),
``sampler`` (bodies, and the faults of each scan). The faults are independent of :mod:`benchmark.datasets.scanning`.
"""
