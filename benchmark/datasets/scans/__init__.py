"""Fresh bodies as scanners leave them, for the training of networks of complete surfaces.

What makes them, in the order to read it: ``bodies`` (fresh bodies in wide poses), one module for each fault,
``welding`` and ``wrapping`` (parts that nearly touch become one), ``triangles`` (other triangulations), ``noise``,
``holes``, and ``sampler`` (which faults a scan has). Nothing here is shared with :mod:`benchmark.datasets.scanning`.
"""
