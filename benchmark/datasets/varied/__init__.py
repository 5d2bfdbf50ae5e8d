"""Bodies for training that differ as people do, in poses that joints allow, as depth cameras see them.

What makes them, in the order to read it: ``poses`` (limits of joints), ``bodies`` (phenotype and local shape),
``model`` (meshes, many at a time), ``overlap`` (no body through itself), ``camera`` (perturbations), ``sampler``
(a batch of pairs).
"""
