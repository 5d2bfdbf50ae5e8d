"""Readers of mesh files, one module per family of formats.

Every reader takes bytes and returns vertices (n, 3) and triangles (m, 3), 0-based, in the order of the file; polygons
are split into fans. Unsupported content raises ``ValueError`` with the reason; :mod:`benchmark.geometry.io` adds the
file name. Time and memory are bounded by the file size: sizes in the header are checked against the content before any
allocation.
"""
