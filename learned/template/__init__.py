"""One template for all shapes, each of which is deformed into it, after DIF-Net [Deng, Yang and Tong, CVPR 2021].

In the order to read it: ``configuration`` (which models there are), ``distances`` (signed distances around a shape),
``samples`` (the shapes that are trained on), ``network`` (the fields), ``losses``, ``training``, ``fitting`` (to a
folder with a model), ``search`` (the code of a new shape, and how it stands), ``model`` (from files to forms),
``methods``. Where a shape lies, and its axes but for quarter turns, are told by ``learned.frame``.
"""
