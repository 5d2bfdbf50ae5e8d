"""Methods and scorers of plugins, each in a process of its own: prepared arrays go in, arrays come out.

Processes that make shapes, signatures, distances, scores and records never import a plugin.
"""
