"""The contents of mesh files as arrays, one module per family of formats.

Every reader takes bytes and returns vertices (n, 3) and triangles (m, 3), 0-based, in the order of the file; polygons
are cut into fans. What is not understood raises ``ValueError`` with the reason; :mod:`benchmark.geometry.io` adds the
name of the file. Time and memory are bounded by the size of the file: what a header announces is compared with what
follows before anything is made of it.
"""
