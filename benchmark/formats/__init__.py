"""Formats of mesh files: a module for each says what it reads, and from where it counts vertices.

A module that assigns a :class:`~benchmark.formats.base.Format` to ``FORMAT`` is found by itself. It
is in the keys of the shapes that are read with it, and of no others.
"""
