"""From a shape to the record of a row: prepared shapes, forms, distances and scores.

Also where they are kept: the cache of arrays, and records.
"""
