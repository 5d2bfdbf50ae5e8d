"""A deformation field: the position of each surface point in the canonical pose, learned from fresh bodies.

Modules in reading order: ``configuration`` (named fields), ``sampling`` (points of a surface), ``network``, ``batches``
(fresh bodies as the network sees them), ``scans`` (the same for scanned bodies), ``training`` (losses and plan),
``fitting`` (to a folder with a model), ``detail`` (keeps the detail of the input), ``model`` (from files to forms),
``methods``. ``learned.frame`` removes position, orientation and size.
"""
