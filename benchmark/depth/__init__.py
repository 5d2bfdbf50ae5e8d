"""Depth images of real cameras.

From a depth file, its intrinsics and mask to the surface of the object.

Suggested reading order: ``reading`` (depths in metres, masks), ``intrinsics``, ``segmentation``
(planes, and the object if no mask is given), ``frame`` (from pixels to an upright surface, and the
whole pipeline, from files or arrays).
"""
