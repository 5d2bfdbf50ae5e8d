"""Varied training bodies in anatomically possible poses, as seen by depth cameras.

Suggested reading order: ``poses`` (joint limits), ``bodies`` (phenotype and local shape), ``model`` (batches of
meshes), ``camera`` (perturbations), ``sampler`` (self-intersections, batches of pairs), ``joints`` and ``coarse``
(faster posing), ``wide`` (a wider stream).
"""
