"""A deformation field: where each point of a surface lies in the canonical pose, learned from fresh bodies.

In the order to read it: ``configuration`` (which fields there are), ``sampling`` (points that stand for a surface),
``network``, ``losses``, ``batches`` (fresh bodies as the network sees them), ``scans`` (the same of scanned bodies),
``training``, ``fitting`` (to a folder with a model), ``detail`` (the form keeps the detail of the input), ``model``
(from files to forms), ``methods``. The pose in space is taken away by ``learned.frame``.
"""
