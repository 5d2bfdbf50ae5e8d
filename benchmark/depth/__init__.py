"""Depth images of real cameras: from a file with its intrinsics and mask to the surface of the object that it shows.

In the order to read it: ``reading`` (pixels in metres), ``intrinsics``, ``mask``, ``planes`` and ``segmentation`` (the
object, where no mask names it), ``projection`` (pixels become a surface, upright), ``frame`` (all of it, from files or
arrays).
"""
