"""Networks that are trained on fresh bodies without end; no body is seen twice.

In the order to read it: ``configuration`` (which networks there are), ``crop`` (the image without its frame),
``images`` (a batch of fresh bodies), ``network``, ``losses``, ``training``, ``fitting`` (to a folder with a model),
``stitching`` (front and back become one closed surface), ``model`` (from files to forms), ``methods``.
"""
